r"""Residual flexibility: what the truncated coordinates would have answered at once, as small tables in s.

With R the flexibility that a basis leaves out and q = V p + R (B f - C^T lambda), the rows and outputs become

.. math::
    C V p + H f - (G + 1/k) \lambda = 0, \qquad y = O V p + W f - X \lambda, \qquad
    G = C R C^T, \quad H = C R B, \quad X = O R C^T, \quad W = O R B

(static correction after MacNeal 1971 and Rubin 1975, here with rows C(s) that move).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.constraints.polynomials import evaluate
from pmr.reduced.inertia import Inertia
from pmr.reduced.soundness import misfit

Array = NDArray[np.float64]
#: Steps for which the outputs' tables are evaluated at once.
BLOCK = 4096


@dataclass(frozen=True)
class Flexibility:
    """Tables of the residual flexibility of a body with m rows, i inputs and o outputs.

    Attributes
    ----------
    rows : PPoly with values (m, m), m/N
        G(s) = C R C^T: displacement at one row under a unit force at another.
    inputs : PPoly with values (m, i), m/N
        H(s) = C R B.
    outputs : PPoly with values (o, m), m/N
        X(s) = O R C^T.
    direct : (o, i) array, m/N
        W = O R B.
    energy : (i, i) array, m/N
        B^T R B: twice the residual strain energy under unit inputs.
    inertia : Inertia, optional
        What is neglected with the inertia of the residual part, or kept (`pmr.reduced.inertia`).
    """

    rows: PPoly
    inputs: PPoly
    outputs: PPoly
    direct: Array
    energy: Array
    inertia: Inertia | None = None

    @property
    def keeps_inertia(self) -> bool:
        """Whether the equations of motion keep the inertia of the residual part."""
        return self.inertia is not None and self.inertia.kept

    def row_motion(self, s: Array, multipliers: Array, loads: Array) -> Array:
        """H(s) f - G(s) lambda, (T, m) in m: what the residual part adds at the rows, along a trajectory."""
        G, H = evaluate(self.rows, s), evaluate(self.inputs, s)
        return np.einsum("tmi,ti->tm", H, loads) - np.einsum("tmn,tn->tm", G, multipliers)

    def displacement(self, s: Array, multipliers: Array, loads: Array) -> Array:
        """W f - X(s) lambda, (T, o) in m: what the residual part adds to the outputs."""
        result = np.asarray(loads @ self.direct.T)
        for first in range(0, len(s), BLOCK):  # the tables' values take far more than what comes of them
            part = slice(first, first + BLOCK)
            result[part] -= np.einsum("tom,tm->to", evaluate(self.outputs, s[part]), multipliers[part])
        return result

    def strain_energy(self, s: Array, multipliers: Array, loads: Array) -> Array:
        """g^T R g / 2 with g = B f - C^T lambda, (T,) in J."""
        doubled = np.einsum("ti,ij,tj->t", loads, self.energy, loads)
        G, H = evaluate(self.rows, s), evaluate(self.inputs, s)
        doubled += np.einsum("tm,tmn,tn->t", multipliers, G, multipliers)
        return (doubled - 2.0 * np.einsum("tm,tmi,ti->t", multipliers, H, loads)) / 2.0

    def input_motion(self, s: Array, multipliers: Array, loads: Array) -> Array:
        """B^T R g, (T, i) in m: what the residual part adds to the motion of the loads' points."""
        return loads @ self.energy - np.einsum("tmi,tm->ti", evaluate(self.inputs, s), multipliers)

    def contradiction(self, m: int, i: int, o: int) -> str | None:
        """What is wrong with the shapes for m rows, i inputs and o outputs, in words; None where all is sound."""
        shapes = {"rows": (m, m), "inputs": (m, i), "outputs": (o, m), "direct": (o, i), "energy": (i, i)}
        wrong = misfit(self, shapes, "flexibility.")
        return wrong or (self.inertia.contradiction(m, i) if self.inertia else None)
