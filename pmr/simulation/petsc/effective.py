"""Factors of the bodies' matrices, one for each that differs, and the matrix that a step solves with."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pmr.fem.compat import PETSc
from pmr.fem.factor import AnyFactor
from pmr.fem.matrices import without_zeros
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.system import FullSystem

Array = NDArray[np.float64]


class BlockFactor:
    """Factors of a matrix of each body; bodies that are the same model share theirs.  Collective."""

    def __init__(self, system: FullSystem, factorised: Callable[[FullModel], AnyFactor]) -> None:
        self._local, self._found = system.local, dict[int, AnyFactor]()
        for model in system.models:
            if id(model) not in self._found:
                self._found[id(model)] = factorised(model)
        self.of_bodies = [self._found[id(model)] for model in system.models]
        self._vectors = [model.M.createVecs() for model in system.models]

    def solve(self, right: Array) -> Array:
        """Answer, this rank's rows (n_local,), to one right-hand side given likewise."""
        solution = np.empty_like(right)
        for factor, at, (load, answer) in zip(self.of_bodies, self._local, self._vectors, strict=True):
            load.getArray()[:] = right[at]
            factor.solve(load, answer)
            solution[at] = answer.getArray()
        return solution

    def solve_columns(self, columns: Array) -> Array:
        """Answers, this rank's rows (n_local, k), to a few right-hand sides given likewise."""
        parts = zip(self.of_bodies, self._local, strict=True)
        return np.concatenate([factor.solve_columns(np.asfortranarray(columns[at])) for factor, at in parts])

    def destroy(self) -> None:
        """Give the factors' memory back."""
        for factor in self._found.values():
            factor.destroy()


def effective_matrix(model: FullModel, v_gain: float, q_gain: float) -> PETSc.Mat:
    """S = M + dv D + dq K: what an acceleration of the step's end costs in force."""
    S = model.K.copy()
    S.scale(q_gain)
    for factor, A in ((v_gain, model.D), (1.0, model.M)):
        S.axpy(factor, A, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    return without_zeros(S)
