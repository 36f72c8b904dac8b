"""Sparse matrices to and from PETSc."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.fem.compat import PETSc
from pmr.fem.distributed import freed, sparse

Array = NDArray[np.float64]


def columns(like: PETSc.Mat, columns: list[tuple[NDArray[np.int64], Array]]) -> PETSc.Mat:
    """Sparse matrix (n, len(columns)) with rows distributed as those of `like`."""
    number = np.repeat(np.arange(len(columns)), np.array([len(dofs) for dofs, _ in columns], int))
    dofs, entries = (np.concatenate([np.empty(0, int), *(column[i] for column in columns)]) for i in (0, 1))
    first, last = like.getOwnershipRange()
    whole = sp.csr_matrix((entries, (dofs, number)), shape=(like.getSize()[0], len(columns)))
    return sparse(whole[first:last], like)


def local_csr(A: PETSc.Mat) -> sp.csr_matrix:
    """This rank's rows of a sparse matrix."""
    indptr, columns, values = A.getValuesCSR()
    return sp.csr_matrix((values, columns, indptr), shape=(len(indptr) - 1, A.getSize()[1]))


def without_zeros(A: PETSc.Mat) -> PETSc.Mat:
    """A without the zeros that have a place in its pattern; A is freed."""
    rows: sp.csr_matrix = local_csr(A)
    rows.eliminate_zeros()
    result = sparse(rows, A, columns=A.getLocalSize()[1])
    freed(A)
    return result


def gather(A: PETSc.Mat) -> sp.csr_matrix | None:
    """A sparse matrix on rank 0; None elsewhere."""
    comm = A.comm.tompi4py()
    shares = comm.gather(local_csr(A), root=0)
    return None if shares is None else sp.vstack(shares, format="csr")
