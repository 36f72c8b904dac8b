"""Constraint rows at one slider position, eliminated: q = T z satisfies C q = 0 for every z."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.dolfinx_compat import PETSc

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class DependentRowsError(ValueError):
    """A constraint row follows from the others: a slider sits on a support, or on another slider."""


@dataclass(frozen=True)
class Elimination:
    """``q[pivots] = -factors @ q[others]``; all other coordinates are free."""

    size: int
    pivots: Indices
    others: Indices
    factors: Array

    @property
    def free(self) -> Indices:
        """Coordinates that stay, in order."""
        return np.setdiff1d(np.arange(self.size), self.pivots)

    def matrix(self) -> sp.csr_matrix:
        """T (n, n - c) as a SciPy matrix."""
        free = self.free
        column = np.full(self.size, -1)
        column[free] = np.arange(len(free))
        T = sp.csr_matrix((np.ones(len(free)), (free, column[free])), shape=(self.size, len(free))).tolil()
        for pivot, row in zip(self.pivots, self.factors, strict=True):
            used = row != 0.0
            T[pivot, column[self.others[used]]] = -row[used]
        return T.tocsr()

    def petsc(self, like: PETSc.Mat) -> PETSc.Mat:
        """T as a PETSc matrix; its rows are spread as those of `like`, its columns follow their rows."""
        first, last = like.getOwnershipRange()
        sorted_pivots = np.sort(self.pivots)

        def column(dof: Indices | int) -> NDArray[np.int64]:
            return np.asarray(dof - np.searchsorted(sorted_pivots, dof))

        mine = np.array([d for d in self.pivots if first <= d < last], np.int64)
        width = max(1, len(self.others))
        T = PETSc.Mat().createAIJ(
            ((last - first, self.size), (last - first - len(mine), self.size - len(self.pivots))),
            comm=like.comm,
            nnz=(width, width),
        )
        for dof in np.setdiff1d(np.arange(first, last), mine):
            T.setValue(dof, int(column(dof)), 1.0)
        for pivot, row in zip(self.pivots, self.factors, strict=True):
            if first <= pivot < last:
                for other, factor in zip(self.others, row, strict=True):
                    if factor != 0.0:
                        T.setValue(pivot, int(column(other)), -factor)
        T.assemble()
        return T


def eliminate(C: sp.csr_matrix, names: Sequence[str]) -> Elimination:
    """Solve C q = 0 for one coordinate a row, by Gauss-Jordan elimination with complete pivoting.

    Parameters
    ----------
    C : (m, n) sparse matrix
        A slider on a node is a unit row, whose elimination deletes that coordinate.
    names : sequence of str
        Of the rows, for the error.

    Raises
    ------
    DependentRowsError
        If a row depends on the others.
    """
    touched = np.unique(C.indices[C.data != 0.0])
    A = C[:, touched].toarray()
    scale = np.abs(A).max(axis=1)
    left, pivots = list(range(len(A))), {}
    while left:
        block = np.abs(A[left]) / scale[left, None]
        row, column = np.unravel_index(int(block.argmax()), block.shape)
        if block[row, column] < 1e-10:
            raise DependentRowsError(f"constraint rows depend on each other: {', '.join(names[i] for i in left)}")
        i = left.pop(int(row))
        A[i] /= A[i, column]
        for other in set(range(len(A))) - {i}:
            A[other] -= A[other, column] * A[i]
        pivots[i] = int(column)
    columns = [pivots[i] for i in range(len(A))]
    rest = np.setdiff1d(np.arange(len(touched)), columns)
    return Elimination(C.shape[1], touched[columns].astype(np.int64), touched[rest].astype(np.int64), A[:, rest])
