r"""Generalized-alpha for the compiled loop of `march`: its parameters as factors of what a step adds up.

.. math::
    (1 - \alpha_m) a_{n+1} + \alpha_m a_n = (1 - \alpha_f) \ddot z_{n+1} + \alpha_f \ddot z_n, \quad
    z_{n+1} = z_n + h \dot z_n + h^2 ((1/2 - \beta) a_n + \beta a_{n+1}), \quad
    \dot z_{n+1} = \dot z_n + h ((1 - \gamma) a_n + \gamma a_{n+1})

Arnold, Bruels: Convergence of the generalized-alpha scheme for constrained mechanical systems, Multibody System
Dynamics 18, 2007, equations 5 to 7.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.arrays import Memory, Scheme

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GeneralizedAlpha:
    """The parameters of Chung and Hulbert, Journal of Applied Mechanics 60, 1993, eq. 25."""

    step: float  # s
    rho_inf: float

    @property
    def alpha_m(self) -> float:
        return (2.0 * self.rho_inf - 1.0) / (self.rho_inf + 1.0)

    @property
    def alpha_f(self) -> float:
        return self.rho_inf / (self.rho_inf + 1.0)

    @property
    def gamma(self) -> float:
        return 0.5 + self.alpha_f - self.alpha_m

    @property
    def beta(self) -> float:
        return (self.gamma + 0.5) ** 2 / 4.0

    def scheme(self) -> Scheme:
        """Factors of predicted quantities and of the new acceleration."""
        h, gamma, beta, a_m, a_f = self.step, self.gamma, self.beta, self.alpha_m, self.alpha_f
        a_gain = (1.0 - a_f) / (1.0 - a_m)  # a = predicted a + a_gain acceleration, and so on
        z_gain, v_gain = beta * h**2 * a_gain, gamma * h * a_gain
        a_from_a, a_from_acceleration = -a_m / (1.0 - a_m), (a_f - a_m * a_gain) / (1.0 - a_m)
        z_from_a, v_from_a = h**2 * (0.5 - beta + beta * a_from_a), h * (1.0 - gamma + gamma * a_from_a)
        return Scheme(
            z_gain=z_gain,
            v_gain=v_gain,
            z_from_v=h,
            z_from_a=z_from_a,
            z_from_acceleration=z_gain + h * v_gain + h**2 * ((0.5 - beta) * a_gain + beta * a_from_acceleration),
            v_from_a=v_from_a,
            v_from_acceleration=v_gain + h * ((1.0 - gamma) * a_gain + gamma * a_from_acceleration),
            a_from_a=a_from_a,
            a_from_acceleration=a_from_acceleration,
        )

    def memory(self) -> Memory:
        """What a force leaves for the step after its own."""
        h, gamma, beta, a_m, a_f = self.step, self.gamma, self.beta, self.alpha_m, self.alpha_f
        a_from_force, a_from_share = a_f / (1.0 - a_m), -a_m / (1.0 - a_m)
        return Memory(
            gain=(1.0 - a_f) / (1.0 - a_m),
            a_from_force=a_from_force,
            a_from_share=a_from_share,
            v_from_force=h * gamma * a_from_force,
            v_from_share=h * (1.0 - gamma + gamma * a_from_share),
            z_from_force=h**2 * beta * a_from_force,
            z_from_share=h**2 * (0.5 - beta + beta * a_from_share),
        )

    def predict(self, z: Array, v: Array, acceleration: Array) -> tuple[Array, Array, Array]:
        """Prediction of z, v and a for the first step, where a equals the acceleration."""
        h, a = self.step, acceleration
        following = (self.alpha_f - self.alpha_m) / (1.0 - self.alpha_m) * a
        return (
            z + h * v + h**2 * ((0.5 - self.beta) * a + self.beta * following),
            v + h * ((1.0 - self.gamma) * a + self.gamma * following),
            following,
        )
