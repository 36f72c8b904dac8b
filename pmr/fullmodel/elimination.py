"""Constraint rows at one slider position, eliminated: q = T z satisfies C q = 0 for every z."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.fem.compat import PETSc
from pmr.fem.distributed import free_objects, sparse

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class DependentRowsError(InputError):
    """A rigid row follows from the others: a slider sits on a support, a pad on a beam opposite another one."""

    def __init__(self, names: Sequence[str]) -> None:
        allowed = (
            f"the rigid rows {', '.join(names)} hold what others hold already: their forces are not determined; "
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

    def project_dense(self, A: Array) -> Array:
        """T^T A T of a dense matrix (n, n)."""
        free, F, p = self.free, self.factors, self.pivots
        at = np.searchsorted(free, self.others)
        AT = A[:, free]
        AT[:, at] -= A[:, p] @ F
        result = AT[free]
        result[at] -= F.T @ AT[p]
        return result

    def condensed(self, K: PETSc.Mat) -> PETSc.Mat:
        """T^T K T (n, n) with the pivots left in as coordinates of their own, as stiff as the stiffest one; collective.

        So vectors keep their size: `restrict` and `extended` apply T^T and T in place.
        """
        first, last = K.getOwnershipRange()
        result = K.copy()
        if np.any(self.factors):
            change = sparse(self._change(K)[first:last], K, columns=last - first)
            result.axpy(1.0, change, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
            free_objects(change)
        mine = self.pivots[(self.pivots >= first) & (self.pivots < last)]
        result.zeroRowsColumns(mine.astype(PETSc.IntType), diag=float(K.getDiagonal().max()[1]))
        return result

    def _change(self, K: PETSc.Mat) -> sp.csr_matrix:
        """T^T K T - K away from the pivots: a few rows and columns, which would not be worth a product with all of K.

        With factors F and the pivots' rows R of K, of which the pivots' own columns are P,
        F^T P F - F^T R - R^T F; collective.
        """
        first, last = K.getOwnershipRange()
        coupled = np.flatnonzero(np.any(self.factors, axis=1))
        pivots = self.pivots[coupled]
        rows_of_rank = {int(p): K.getRow(int(p)) for p in pivots if first <= p < last}
        rows_of_pivots = {p: row for rows in K.comm.tompi4py().allgather(rows_of_rank) for p, row in rows.items()}
        rows = [rows_of_pivots[int(p)] for p in pivots]
        R = sp.vstack([sp.csr_matrix((values, i, [0, len(i)]), (1, self.size)) for i, values in rows], format="csr")
        at, other = np.nonzero(self.factors[coupled])
        F = sp.csr_matrix((self.factors[coupled][at, other], (at, self.others[other])), (len(coupled), self.size))
        RF = R.T @ F
        return sp.csr_matrix(F.T @ R[:, pivots] @ F - RF - RF.T)

    def petsc(self, like: PETSc.Mat) -> PETSc.Mat:
        """T as a PETSc matrix; its rows are spread as those of `like`, its columns follow their rows."""
        first, last = like.getOwnershipRange()
        pivots = np.count_nonzero((self.pivots >= first) & (self.pivots < last))
        return sparse(self.matrix()[first:last], like, columns=last - first - pivots)


class Condensed:
    """T and T^T on columns given by one rank's rows, in place; collective."""

    def __init__(self, elimination: Elimination, like: PETSc.Mat) -> None:
        first, last = like.getOwnershipRange()
        self._comm, self._count = like.comm.tompi4py(), len(elimination.pivots)
        self._own = np.flatnonzero((elimination.pivots >= first) & (elimination.pivots < last))
        near = (elimination.others >= first) & (elimination.others < last)
        self._pivots, self._others = elimination.pivots[self._own] - first, elimination.others[near] - first
        self._factors, self._coupled = elimination.factors[:, near], bool(np.any(elimination.factors))

    def restrict(self, g: Array) -> None:
        """G (n_local, k) becomes T^T g, nothing at the pivots."""
        if self._coupled:
            at_pivots = np.zeros((self._count, g.shape[1]))
            at_pivots[self._own] = g[self._pivots]
            g[self._others] -= self._factors.T @ np.asarray(self._comm.allreduce(at_pivots))
        g[self._pivots] = 0.0

    def extended(self, x: Array) -> None:
        """X (n_local, k) at all but the pivots becomes T x."""
        x[self._pivots] = 0.0
        if self._coupled:
            x[self._pivots] = -np.asarray(self._comm.allreduce(self._factors @ x[self._others]))[self._own]


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
    open_rows, pivots = list(range(len(A))), {}
    while open_rows:
        block = np.abs(A[open_rows]) / scale[open_rows, None]
        row, column = np.unravel_index(int(block.argmax()), block.shape)
        if block[row, column] < 1e-10:
            raise DependentRowsError([names[i] for i in open_rows])
        i = open_rows.pop(int(row))
        A[i] /= A[i, column]
        for other in set(range(len(A))) - {i}:
            A[other] -= A[other, column] * A[i]
        pivots[i] = int(column)
    columns = np.array([pivots[i] for i in range(len(A))], np.int64)
    remaining = np.setdiff1d(np.arange(len(touched)), columns)
    return Elimination(
        C.shape[1], touched[columns].astype(np.int64), touched[remaining].astype(np.int64), A[:, remaining]
    )
