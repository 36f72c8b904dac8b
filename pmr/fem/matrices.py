"""Sparse matrices to and from PETSc."""

from __future__ import annotations

import scipy.sparse as sp

from pmr.fem.compat import PETSc
from pmr.fem.distributed import free_objects, sparse


def columns(like: PETSc.Mat, transposed: sp.csr_matrix) -> PETSc.Mat:
    """Sparse matrix (n, k) from its transpose (k, n) without zeros, its rows distributed as those of `like`."""
    rows = transposed.T.tocsr()[slice(*like.getOwnershipRange())]
    rows.eliminate_zeros()
    return sparse(rows, like)


def local_csr(A: PETSc.Mat) -> sp.csr_matrix:
    """This rank's rows of a sparse matrix."""
    indptr, columns, values = A.getValuesCSR()
    return sp.csr_matrix((values, columns, indptr), shape=(len(indptr) - 1, A.getSize()[1]))


def without_zeros(A: PETSc.Mat) -> PETSc.Mat:
    """A without the zeros that have a place in its pattern; A is freed."""
    rows: sp.csr_matrix = local_csr(A)
    rows.eliminate_zeros()
    result = sparse(rows, A, columns=A.getLocalSize()[1])
    free_objects(A)
    return result


def gather(A: PETSc.Mat) -> sp.csr_matrix | None:
    """A sparse matrix on rank 0; None elsewhere."""
    comm = A.comm.tompi4py()
    shares = comm.gather(local_csr(A), root=0)
    return None if shares is None else sp.vstack(shares, format="csr")
