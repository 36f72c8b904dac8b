"""Rayleigh damping, as the matrices that are made of it remember it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rayleigh:
    """D = alpha M + beta K, alpha in 1/s, beta in s; zeta = (alpha / omega + beta omega) / 2 in each mode.

    Bathe: Finite Element Procedures, 1996, section 9.3.3.
    """

    alpha: float
    beta: float

    def of(self, M: Array, K: Array) -> Array:
        """Alpha M + beta K of any matrices of one shape, with the units of damping."""
        return self.alpha * M + self.beta * K

    def modal(self, omega2: Array) -> Array:
        """phi^T D phi = 2 zeta omega (k,) in 1/s of M-orthonormal modes with omega^2 (k,)."""
        return self.alpha + self.beta * omega2
