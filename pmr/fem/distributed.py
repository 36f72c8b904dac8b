"""Matrices distributed over ranks: dense ones of few columns by their rows, and sparse ones to and from PETSc.

The rows of dense matrices are spread over ranks as the rows of the full model's operators.  Each rank keeps its own
rows in a NumPy array.
"""

from __future__ import annotations

import gc

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from pmr.fem.compat import MPI, PETSc
from pmr.files.arrays import Array, Indices

#: Entries within this share of the largest one count as equally large when a sign is fixed.
SIGN_TOLERANCE = 1e-6


def tall(local: Array, like: PETSc.Mat) -> PETSc.Mat:
    """Dense PETSc matrix (n, k) with a copy of `local` (n_local, k), this rank's rows; collective.

    The rows are distributed as those of `like`.
    """
    sizes = like.getSizes()[0]
    assert len(local) == sizes[0]
    matrix = PETSc.Mat().createDense((sizes, (PETSc.DECIDE, local.shape[1])), comm=like.comm)
    matrix.setUp()
    matrix.getDenseArray()[:] = local
    matrix.assemble()
    return matrix


def view(local: Array, like: PETSc.Mat) -> PETSc.Mat:
    """Dense PETSc matrix that shares its memory with `local` (n_local, k), this rank's rows in Fortran's order.

    The rows are distributed as the rows of `like`; collective.
    """
    return _view(local, like.getSizes()[0], like.comm)


def _view(local: Array, sizes: tuple[int, int], comm: MPI.Comm) -> PETSc.Mat:
    """Dense PETSc matrix that shares its memory with `local` (n_local, k), the rows of this rank; collective.

    `local` has to be stored by columns (Fortran's order).  `sizes` are the numbers n_local of rows on this rank and n
    of all rows.
    """
    assert len(local) == sizes[0] and local.flags.f_contiguous
    matrix = PETSc.Mat().createDense((sizes, (PETSc.DECIDE, local.shape[1])), array=local, comm=comm)
    matrix.assemble()
    return matrix


def sparse(rows: sp.csr_matrix, like: PETSc.Mat, columns: int | None = None) -> PETSc.Mat:
    """Sparse PETSc matrix (n, m) from `rows` (n_local, m), this rank's rows with global column numbers; collective.

    The rows are distributed as those of `like`.  `columns` is the number of columns that this rank owns; if it is None,
    PETSc decides.
    """
    owned = PETSc.DECIDE if columns is None else columns
    csr = (rows.indptr.astype(PETSc.IntType, copy=False), rows.indices.astype(PETSc.IntType, copy=False), rows.data)
    matrix = PETSc.Mat().createAIJ((like.getSizes()[0], (owned, rows.shape[1])), csr=csr, comm=like.comm)
    matrix.assemble()
    return matrix


def times(A: PETSc.Mat, local: Array) -> Array:
    """Rows (n_local, k) on this rank of the product A X, from `local` (rows, k), this rank's rows of X; collective.

    The rows of X are distributed as the columns of A. If `local` is in Fortran's order it is not copied; the result is
    in Fortran's order.
    """
    (rows, columns), result = A.getSizes(), np.empty((A.getLocalSize()[0], local.shape[1]), order="F")
    right, product = _view(np.asfortranarray(local), columns, A.comm), _view(result, rows, A.comm)
    A.matMult(right, product)
    free_objects(right, product)
    return result


def free_objects(*objects: PETSc.Object) -> None:
    """Free the memory of PETSc objects at once; collective.

    The objects can't be used afterwards.  The memory of objects that Python merely drops is kept until `free_dropped`.
    """
    for item in objects:
        item.destroy()


def inner(X: Array, Y: Array, comm: MPI.Comm) -> Array:
    """Product X^T Y (k, l) of two matrices from this rank's rows X (n_local, k) and Y (n_local, l); collective.

    All ranks get the same product.
    """
    return np.asarray(comm.allreduce(X.T @ Y))


def subtract(X: Array, A: Array, B: Array) -> None:
    """Subtract the product A B of A (n, m) and B (m, k) from X (n, k), in place.

    X and A have to be stored by columns (Fortran's order).  No temporary array of the size of X is made.
    """
    if A.size and B.size:
        assert X.flags.f_contiguous and A.flags.f_contiguous
        scipy.linalg.blas.dgemm(-1.0, A, B, 1.0, X, overwrite_c=True)


def fix_signs(local: Array, comm: MPI.Comm) -> Array:
    """This rank's rows (n_local, k) of a matrix, with each column times 1 or -1, from its rows `local`; collective.

    The entry of largest magnitude of each column becomes positive.  If several entries are within `SIGN_TOLERANCE` of
    the largest one, the first of them in the model's order decides.  So round-off can't choose between the two ends of
    a symmetric mode.
    """
    size = np.abs(local)
    largest = np.max(comm.allgather(size.max(axis=0, initial=0.0)), axis=0)
    candidates = size >= (1.0 - SIGN_TOLERANCE) * largest
    columns = np.arange(local.shape[1])
    deciding = np.zeros(local.shape[1])
    if len(local):
        deciding = np.where(candidates.any(axis=0), local[candidates.argmax(axis=0), columns], 0.0)
    by_rank = np.array(comm.allgather(deciding))  # ranks own consecutive rows: the first with such an entry decides
    first = by_rank[(by_rank != 0.0).argmax(axis=0), columns]
    return local * np.where(first < 0.0, -1.0, 1.0)


def free_dropped(comm: MPI.Comm, cycles: bool = True) -> None:
    """Free the PETSc objects on a communicator that Python has dropped; collective.

    Python's ranks drop objects at different times, so PETSc (3.18 and newer) keeps the objects until all ranks agree
    here.  If `cycles`, objects that refer to each other are looked for too, which takes some tenths of a second.
    """
    if cycles:
        gc.collect()
    PETSc.garbage_cleanup(comm)


def from_transpose(like: PETSc.Mat, transposed: sp.csr_matrix) -> PETSc.Mat:
    """Sparse PETSc matrix (n, k) without explicit zeros, from its transpose (k, n), which all ranks pass; collective.

    The rows of the matrix are distributed as those of `like`.
    """
    rows = transposed.T.tocsr()[slice(*like.getOwnershipRange())]
    rows.eliminate_zeros()
    return sparse(rows, like)


def local_csr(A: PETSc.Mat) -> sp.csr_matrix:
    """Rows (n_local, n) of a sparse matrix A that this rank owns, with global column numbers."""
    indptr, columns, values = A.getValuesCSR()
    return sp.csr_matrix((values, columns, indptr), shape=(len(indptr) - 1, A.getSize()[1]))


def without_zeros(A: PETSc.Mat) -> PETSc.Mat:
    """Copy of the sparse matrix A without the zeros that it stores; A is freed.  Collective."""
    rows: sp.csr_matrix = local_csr(A)
    rows.eliminate_zeros()
    result = sparse(rows, A, columns=A.getLocalSize()[1])
    free_objects(A)
    return result


def gather(A: PETSc.Mat) -> sp.csr_matrix | None:
    """Return all rows of the sparse matrix A (n, m) on rank 0, and None on other ranks; collective."""
    comm = A.comm.tompi4py()
    shares = comm.gather(local_csr(A), root=0)
    return None if shares is None else sp.vstack(shares, format="csr")


def project_matrix(A: PETSc.Mat, P: PETSc.Mat) -> PETSc.Mat:
    """Product P^T A P, whose rows are distributed as the columns of P; A is freed.  Collective."""
    product = A.PtAP(P)
    result = product.copy()  # a PETSc product keeps its factors in memory as long as it lives
    free_objects(product, A)
    return result


def share(size: int, comm: MPI.Comm) -> Indices:
    """Range (2,) of this rank's coordinates among `size`: number of the first one, and number after the last one."""
    return np.array([comm.rank, comm.rank + 1]) * size // comm.size


class SparseProduct:
    """Sparse rows (m, n_local) on this rank's coordinates, prepared for fast products.

    Products are fast if the rows have entries in few columns: only these columns are stored.
    """

    def __init__(self, rows: sp.spmatrix) -> None:
        rows = sp.csr_matrix(rows)
        self._touched = np.unique(rows.indices)
        self._rows = rows[:, self._touched]

    def multiply(self, x: Array) -> Array:
        """Product (m, k) of the rows with x (n_local, k); this rank's contribution to the sum over ranks."""
        return np.asarray(self._rows @ x[self._touched])
