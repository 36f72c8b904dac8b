r"""Generalized-alpha where velocities are known and accelerations follow, and impulses of forces.

With

.. math::
    (1 - \alpha_m) A_{n+1} + \alpha_m A_n = (1 - \alpha_f)\, \ddot b_{n+1} + \alpha_f\, \ddot b_n, \qquad
    \dot b_{n+1} = \dot b_n + h ((1 - \gamma) A_n + \gamma A_{n+1})

the rates of the directions give their accelerations; forces F have impulses
:math:`h ((1 - \gamma) \tilde F_n + \gamma \tilde F_{n+1})` with the same recursion.  So momenta of constant matrices
are those that the scheme has of the whole, whose stability is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.scheme import GeneralizedAlpha

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Weights:
    """Of one length of step."""

    method: GeneralizedAlpha

    def smoothed(self, new: Array, old: Array, before: Array) -> Array:
        """A or F~ at the end of a step, from what it is of at its end and beginning, and itself before."""
        a_m, a_f = self.method.alpha_m, self.method.alpha_f
        return np.asarray(((1.0 - a_f) * new + a_f * old - a_m * before) / (1.0 - a_m))

    def of_smoothed(self, smoothed: Array, before: Array, old: Array) -> Array:
        """What it is of at the end of a step: the other way round."""
        a_m, a_f = self.method.alpha_m, self.method.alpha_f
        return np.asarray(((1.0 - a_m) * smoothed + a_m * before - a_f * old) / (1.0 - a_f))

    def impulse(self, smoothed: Array, before: Array) -> Array:
        """Of a step."""
        h, gamma = self.method.step, self.method.gamma
        return np.asarray(h * ((1.0 - gamma) * before + gamma * smoothed))

    def by_impulse(self, impulse: Array, before: Array) -> Array:
        """A or F~ at the end of a step that has such an impulse."""
        h, gamma = self.method.step, self.method.gamma
        return np.asarray((impulse / h - (1.0 - gamma) * before) / gamma)

    def moved(self, value: Array, rate: Array, before: Array, smoothed: Array) -> Array:
        """Where a direction is at the end of a step."""
        h, beta = self.method.step, self.method.beta
        return np.asarray(value + h * rate + h**2 * ((0.5 - beta) * before + beta * smoothed))
