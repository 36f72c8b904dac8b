"""Snapshots of what a sliding body can do, one file a source."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.fem.compat import PETSc
from pmr.fem.distributed import tall
from pmr.fullmodel.model import FullModel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Snapshots:
    """The pool that a basis is made from.

    `residuals` are normwise backward errors ||K phi - omega^2 M phi|| / ((||K|| + omega^2 ||M||) ||phi||) in infinity
    norms.
    """

    S: PETSc.Mat  # dense (n, k), a column each; eigenmodes are mass-normalised, phi^T M phi = 1, and carry 1/sqrt(kg)
    omega: Array  # (k,) rad/s
    s: Array  # (k,) m: path coordinate at which each column was taken
    residuals: Array  # (k,)
    source: str  # how the columns were made

    @classmethod
    def of(cls, local: Array, model: FullModel, omega: Array, s: Array, residuals: Array, source: str) -> Snapshots:
        """Snapshots of a model, from this rank's rows (n_local, k) of the columns; collective."""
        return cls(tall(local, model.M), omega, s, residuals, source)
