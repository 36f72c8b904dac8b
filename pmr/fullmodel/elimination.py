"""Constraint rows at one slider position, eliminated: q = T z satisfies C q = 0 for every z."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.fem.compat import PETSc
from pmr.fem.distributed import sparse

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class DependentRowsError(InputError):
    """A rigid row follows from the others: a slider sits on a support, a pad on a beam opposite another one."""

    def __init__(self, names: Sequence[str]) -> None:
        allowed = (
            f"the rigid rows {', '.join(names)} hold what others hold already: their forces can't be told apart; "
            "fewer rigid supports, sliders and pads, or pads with a stiffness, are allowed"
        )
        super().__init__("scene", "", None, allowed)


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
        at, other = np.nonzero(self.factors)
        rows = np.concatenate([free, self.pivots[at]])
        columns = np.concatenate([column[free], column[self.others[other]]])
        entries = np.concatenate([np.ones(len(free)), -self.factors[at, other]])
        return sp.csr_matrix((entries, (rows, columns)), shape=(self.size, len(free)))

    def petsc(self, like: PETSc.Mat) -> PETSc.Mat:
        """T as a PETSc matrix; its rows are spread as those of `like`, its columns follow their rows."""
        first, last = like.getOwnershipRange()
        pivots = np.count_nonzero((self.pivots >= first) & (self.pivots < last))
        return sparse(self.matrix()[first:last], like, columns=last - first - pivots)


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
    scale = np.abs(A).max(axis=1, initial=0.0)
    if not scale.all():
        raise DependentRowsError([names[i] for i in np.flatnonzero(scale == 0.0)])
    left, pivots = list(range(len(A))), {}
    while left:
        block = np.abs(A[left]) / scale[left, None]
        row, column = np.unravel_index(int(block.argmax()), block.shape)
        if block[row, column] < 1e-10:
            raise DependentRowsError([names[i] for i in left])
        i = left.pop(int(row))
        A[i] /= A[i, column]
        for other in set(range(len(A))) - {i}:
            A[other] -= A[other, column] * A[i]
        pivots[i] = int(column)
    columns = np.array([pivots[i] for i in range(len(A))], np.int64)
    rest = np.setdiff1d(np.arange(len(touched)), columns)
    return Elimination(C.shape[1], touched[columns].astype(np.int64), touched[rest].astype(np.int64), A[:, rest])
