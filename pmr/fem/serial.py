"""Replacement of PETSc and MPI on one rank by SciPy: for given matrices if petsc4py is not installed.

Names and meanings are PETSc's, so that no other module needs to know which of the two it uses; `pmr.fem.compat`
decides.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import TypeAlias, TypeVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.files.arrays import Array, Indices

Value = TypeVar("Value")
#: Local and global number of rows, or of columns.
Size: TypeAlias = tuple[int, int]
#: Sizes of rows and of columns, which are the same here.
Sizes: TypeAlias = tuple[Size, Size]


class Comm:
    """A communicator of one rank, with those methods of mpi4py that pmr calls; a reduction returns its argument."""

    rank, size = 0, 1

    def tompi4py(self) -> Comm:
        return self

    def bcast(self, value: Value, root: int = 0) -> Value:
        return value

    def allreduce(self, value: Value, op: int | None = None) -> Value:
        return value

    reduce = allreduce

    def allgather(self, value: Value) -> list[Value]:
        return [value]

    def gather(self, value: Value, root: int = 0) -> list[Value]:
        return [value]

    def barrier(self) -> None:
        """Do nothing, as there is no other rank to wait for."""

    def Allreduce(self, *arrays: Array | int | None) -> None:
        """Do nothing: a reduction in place (``IN_PLACE``) on one rank leaves the array as it is."""


WORLD = Comm()


class Vec:
    """A vector (n,), with those methods of PETSc vectors that pmr calls."""

    comm = WORLD

    def __init__(self, values: Array) -> None:
        self._values = values

    def getArray(self) -> Array:
        return self._values

    def duplicate(self) -> Vec:
        """Return a vector of zeros with the same length."""
        return Vec(np.zeros_like(self._values))

    def destroy(self) -> None:
        """Do nothing: Python frees the memory."""


class IS:
    """Numbers of rows or columns, with those methods of PETSc index sets that pmr calls."""

    def createGeneral(self, numbers: Indices, comm: Comm = WORLD) -> IS:
        self.numbers = numbers
        return self

    def destroy(self) -> None:
        """Do nothing: Python frees the memory."""


class Mat:
    """A sparse matrix, or a dense one in Fortran's order, with those methods of PETSc matrices that pmr calls."""

    comm = WORLD
    Structure = SimpleNamespace(SUBSET_NONZERO_PATTERN=0, DIFFERENT_NONZERO_PATTERN=1)

    def __init__(self, values: sp.csr_matrix = None) -> None:
        self.values = values

    def createAIJ(self, sizes: Sizes, csr: tuple[NDArray[np.generic], ...], comm: Comm = WORLD) -> Mat:
        indptr, indices, entries = csr
        self.values = sp.csr_matrix((entries, indices, indptr), shape=tuple(size[1] for size in sizes))
        return self

    def createDense(self, sizes: Sizes, array: Array | None = None, comm: Comm = WORLD) -> Mat:
        self.values = np.zeros(tuple(size[1] for size in sizes), order="F") if array is None else array
        return self

    def setUp(self) -> None:
        """Do nothing; also used as `assemble` and `destroy`."""

    assemble = destroy = setUp

    def copy(self) -> Mat:
        return Mat(self.values.copy())

    def duplicate(self, copy: bool = False) -> Mat:
        """Return a copy of this matrix with its entries; PETSc copies them only if `copy`."""
        return self.copy()

    def getSize(self) -> Size:
        rows, columns = self.values.shape
        return int(rows), int(columns)

    def getLocalSize(self) -> Size:
        return self.getSize()

    def getSizes(self) -> Sizes:
        rows, columns = self.getSize()
        return (rows, rows), (columns, columns)

    def getOwnershipRange(self) -> Size:
        return 0, self.getSize()[0]

    def getDenseArray(self) -> Array:
        return np.asarray(self.values)

    def getValuesCSR(self) -> tuple[NDArray[np.generic], ...]:
        return self.values.indptr.copy(), self.values.indices.copy(), self.values.data.copy()

    def getDiagonal(self) -> Vec:
        return Vec(self.values.diagonal())

    def createVecs(self) -> tuple[Vec, Vec]:
        return self.createVecRight(), self.createVecLeft()

    def createVecRight(self) -> Vec:
        return Vec(np.zeros(self.getSize()[1]))

    def createVecLeft(self) -> Vec:
        return Vec(np.zeros(self.getSize()[0]))

    def mult(self, x: Vec, y: Vec) -> None:
        """Write A x to y, where A is this matrix."""
        y.getArray()[:] = self.values @ x.getArray()

    def multAdd(self, x: Vec, y: Vec, z: Vec) -> None:
        """Write y + A x to z, where A is this matrix."""
        z.getArray()[:] = y.getArray() + self.values @ x.getArray()

    def matMult(self, X: Mat, Y: Mat) -> None:
        """Write A X to Y, where A is this matrix."""
        Y.values[:] = self.values @ X.values

    def PtAP(self, P: Mat) -> Mat:
        """Product P^T A P as a new matrix, where A is this matrix."""
        return Mat(sp.csr_matrix(P.values.T @ self.values @ P.values))

    def createSubMatrix(self, rows: IS, columns: IS) -> Mat:
        """Submatrix of the given `rows` and `columns` of this matrix, as a new matrix."""
        return Mat(self.values[rows.numbers][:, columns.numbers])

    def scale(self, factor: float) -> None:
        """Multiply this matrix by `factor`, in place."""
        self.values *= factor

    def axpy(self, factor: float, X: Mat, structure: int | None = None) -> None:
        """Add `factor` times X to this matrix; `structure` is not used."""
        self.values = sp.csr_matrix(self.values + factor * X.values)

    def norm(self, kind: int) -> float:
        """Largest sum of the absolute values in a row, which is PETSc's infinity norm; `kind` is not used."""
        return float(np.abs(self.values).sum(axis=1).max())


MPI = SimpleNamespace(Comm=Comm, COMM_WORLD=WORLD, COMM_SELF=WORLD, IN_PLACE=None, MIN=0, MAX=1)
PETSc = SimpleNamespace(
    Mat=Mat,
    Vec=Vec,
    IS=IS,
    COMM_SELF=WORLD,
    DECIDE=-1,
    IntType=np.int32,
    ScalarType=np.float64,
    NormType=SimpleNamespace(NORM_INFINITY=3),
    garbage_cleanup=lambda comm: None,
)
