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

    Attributes
    ----------
    S : PETSc.Mat, dense (n, k)
        One column a snapshot; eigenmodes are mass-normalised, phi^T M phi = 1, and carry 1/sqrt(kg).
    omega : (k,) array, rad/s
    s : (k,) array, m
        Path coordinate at which each column was taken.
    residuals : (k,) array
        Normwise backward error ||K phi - omega^2 M phi|| / ((||K|| + omega^2 ||M||) ||phi||), infinity norms.
    source : str
        How the columns were made.
    """

    S: PETSc.Mat
    omega: Array
    s: Array
    residuals: Array
    source: str

    @classmethod
    def of(cls, local: Array, model: FullModel, omega: Array, s: Array, residuals: Array, source: str) -> Snapshots:
        """Of a model, from this rank's rows (n_local, k) of the columns; collective."""
        return cls(tall(local, model.M), omega, s, residuals, source)
