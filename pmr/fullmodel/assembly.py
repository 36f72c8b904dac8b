"""Assembly of a structural model's weak forms to distributed PETSc matrices, in the model's order of coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from pmr.fem.compat import MPI, PETSc, assemble, cell_dofs, comm_of, compiled_form, function, original_cells
from pmr.fem.distributed import free_dropped, free_objects, local_csr, sparse
from pmr.files.arrays import Array, Indices
from pmr.models import FiniteElementModel, StructuralModel, is_assembled
from pmr.models.matrices import Matrices
from pmr.models.mover import Mover
from pmr.scene import Damping
from pmr.system.body_matrices import Rayleigh

if TYPE_CHECKING:
    from pmr.fem.compat import Function, FunctionSpace


@dataclass(frozen=True)
class Operators:
    """Mass M, stiffness K and damping D (n, n) of a model with n coordinates; each rank owns consecutive rows of all.

    K has an entry wherever M or D has one.  M lacks some entries of K: in a shell five of six entries of K.
    """

    M: PETSc.Mat
    K: PETSc.Mat
    D: PETSc.Mat | None = None  # None: the model has no damping of its own


def rayleigh(damping: Damping) -> Rayleigh:
    """Rayleigh damping D = a M + b K with the factors of a scene's table: a in 1/s is `mass`, b in s is `stiffness`."""
    return Rayleigh(damping.mass, damping.stiffness)


def operators_of(model: StructuralModel, comm: MPI.Comm) -> Operators:
    """Mass, stiffness and damping of a model, assembled from its forms or given as matrices; collective."""
    if is_assembled(model):
        return assemble_model(model, model.domain(comm))
    assert isinstance(model, Matrices | Mover)
    body_matrices = model if isinstance(model, Mover) else model.body_matrices
    damping = [model.body_matrices.D] if isinstance(model, Matrices) and model.body_matrices.D is not None else []
    first, last = share(model.size, comm)
    sizes = (int(last - first), model.size)
    matrices = []
    for A in (body_matrices.M, reduce(pad_pattern, (body_matrices.M, *damping), body_matrices.K), *damping):
        share_of_rank = A[first:last].sorted_indices()
        parts = (
            share_of_rank.indptr.astype(PETSc.IntType),
            share_of_rank.indices.astype(PETSc.IntType),
            share_of_rank.data,
        )
        matrices.append(PETSc.Mat().createAIJ((sizes, sizes), csr=parts, comm=comm))
        matrices[-1].assemble()
    return Operators(*matrices)


def pad_pattern(A: sp.csr_matrix, other: sp.csr_matrix) -> sp.csr_matrix:
    """Copy of A with explicit zeros where only `other` has entries: its pattern contains both patterns."""
    A, other = A.tocoo(), other.tocoo()
    entries = np.concatenate([A.data, np.zeros(other.nnz)])
    places = np.concatenate([A.row, other.row]), np.concatenate([A.col, other.col])
    return sp.csr_matrix((entries, places), shape=A.shape)


def assemble_model(model: FiniteElementModel, domain: object) -> Operators:
    """Assemble mass and stiffness of a model on its distributed mesh `domain`, without boundary conditions; collective.

    The function also frees the PETSc objects of earlier models that Python has dropped, which PETSc keeps until it is
    asked to free them.
    """
    free_dropped(comm_of(domain), cycles=False)
    assembler = Assembler(model, domain)
    forms = model.forms(assembler.space)
    return Operators(assembler.matrix(forms.mass, zeros=False), assembler.matrix(forms.stiffness))


class Assembler:
    """Assembles weak forms on a model's function space to matrices in the model's order of coordinates."""

    def __init__(self, model: FiniteElementModel, domain: object) -> None:
        self.model, self.comm, self.space = model, comm_of(domain), model.space(domain)
        self._order = model_order(model, self.space)

    def matrix(self, form: object, zeros: bool = True) -> PETSc.Mat:
        """Assemble a UFL form to a matrix (n, n); if `zeros`, explicit zeros of its pattern are kept.  Collective."""
        return self.assemble_form(compiled_form(form), zeros)

    def assemble_form(self, form: object, zeros: bool = True) -> PETSc.Mat:
        """Assemble a compiled form to a matrix (n, n) in the model's order of coordinates.

        If the model has a `transformation` T, the matrix is projected, T^T A T, onto the model's coordinates.  If
        `zeros`, explicit zeros of the pattern are kept.  Collective.
        """
        rows = _local_rows(assemble(form))
        if not zeros:
            rows.matrix.eliminate_zeros()
        matrix, T = reorder_rows(rows, self._order, self.comm), self.model.transformation
        if T is None:
            return matrix
        (first, last), columns = matrix.getOwnershipRange(), share(T.shape[1], self.comm)
        P = sparse(T.tocsr()[first:last], matrix, columns=int(columns[1] - columns[0]))
        matrix = project_matrix(matrix, P)
        free_objects(P)
        return matrix

    def displacement_function(self, q: Array) -> Function:
        """Function on the function space with the model's coordinates q (n,), the same on every rank; collective.

        Not to be called for a model with a `transformation`, whose coordinates are not those of the function space.
        """
        values = np.empty(len(q))
        values[self._order] = q
        return function(self.space, values)


def model_order(model: FiniteElementModel, space: FunctionSpace) -> Indices:
    """For each coordinate of the model its PETSc index (n,) in the function space; collective, the same on every rank.

    Raises
    ------
    RuntimeError
        If the model's numbering does not cover the coordinates of the function space exactly once.
    """
    ours = model.element_coordinates(original_cells(space.mesh))
    theirs = cell_dofs(space)
    order = np.full(space.dofmap.index_map.size_global * space.dofmap.index_map_bs, -1, np.int64)
    for mine, its in zip(ours, theirs, strict=True):
        order[mine.ravel()] = its.ravel()
    numbered = np.flatnonzero(order >= 0)
    for numbers, places in space.mesh.comm.allgather((numbered, order[numbered])):
        order[numbers] = places
    if not np.array_equal(np.sort(order), np.arange(len(order))):
        raise RuntimeError("the coordinates of the model do not match those of the function space")
    return order


@dataclass(frozen=True)
class MatrixRows:
    """Some of the N rows of a matrix (N, N) that one rank holds: the numbers (n,) and the entries (n, N) of n rows."""

    numbers: Indices
    matrix: sp.csr_matrix

    def select(self, positions: Indices) -> MatrixRows:
        """The rows at the given `positions` (k,) among the n rows, in the order of `positions`."""
        return MatrixRows(self.numbers[positions], self.matrix[positions])


def _local_rows(A: PETSc.Mat) -> MatrixRows:
    """Rows of A that this rank owns; frees A."""
    rows = MatrixRows(np.arange(*A.getOwnershipRange()), local_csr(A))
    free_objects(A)
    return rows


def reorder_rows(rows: MatrixRows, order: Indices, comm: MPI.Comm) -> PETSc.Mat:
    """Matrix with rows and columns in the model's order, of which each rank owns about equally many rows; collective.

    `rows` are the rows that this rank owns in PETSc's order.  `order` (N,) is the PETSc index of each of the model's
    coordinates, from `model_order`.  PETSc's own method `createSubMatrix` takes three times as long on two ranks as on
    one.
    """
    number = np.empty(len(order), PETSc.IntType)
    number[order] = np.arange(len(order), dtype=number.dtype)
    share_of_rank = _exchange_rows(MatrixRows(number[rows.numbers], rows.matrix), comm).matrix
    share_of_rank.indices[:] = number[share_of_rank.indices]
    share_of_rank.has_sorted_indices = False
    share_of_rank.sort_indices()
    sizes = (share_of_rank.shape[0], len(order))
    result = PETSc.Mat().createAIJ(
        (sizes, sizes), csr=(share_of_rank.indptr, share_of_rank.indices, share_of_rank.data), comm=comm
    )
    result.assemble()
    return result


def _exchange_rows(rows: MatrixRows, comm: MPI.Comm) -> MatrixRows:
    """Send each of this rank's rows to the rank that will own it; returns the rows that this rank will own, ascending.

    Collective.
    """
    ends = np.arange(1, comm.size + 1) * rows.matrix.shape[1] // comm.size
    owner = np.searchsorted(ends, rows.numbers, side="right")
    sent = [rows.select(np.flatnonzero(owner == rank)) if rank != comm.rank else None for rank in range(comm.size)]
    received = [part for part in comm.alltoall(sent) if part is not None]
    if received:
        owner = np.concatenate([owner, *(np.full(len(part.numbers), comm.rank) for part in received)])
        numbers = np.concatenate([rows.numbers, *(part.numbers for part in received)])
        rows = MatrixRows(numbers, sp.vstack([rows.matrix, *(part.matrix for part in received)], "csr"))
    owned = np.flatnonzero(owner == comm.rank)
    return rows.select(owned[np.argsort(rows.numbers[owned])])


def project_matrix(A: PETSc.Mat, P: PETSc.Mat) -> PETSc.Mat:
    """Product P^T A P; frees A.  Collective."""
    product = A.PtAP(P)
    result = product.copy()  # a PETSc product keeps its factors in memory as long as it lives
    free_objects(product, A)
    return result


def share(size: int, comm: MPI.Comm) -> Indices:
    """Number of this rank's first coordinate among `size` coordinates, and the number after its last one."""
    return np.array([comm.rank, comm.rank + 1]) * size // comm.size
