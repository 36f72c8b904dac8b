"""Assembly of a structural model's forms to distributed PETSc matrices in the model's own order of coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.fem.compat import MPI, PETSc, assemble, cell_dofs, comm_of, compiled_form, function, original_cells
from pmr.fem.distributed import free_dropped, free_objects, local_csr, sparse
from pmr.models import FiniteElementModel, StructuralModel, is_assembled
from pmr.models.matrices import Matrices
from pmr.scene import Damping
from pmr.system.body_matrices import Rayleigh

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Operators:
    """Mass M and stiffness K (n, n), distributed in consecutive shares of the model's coordinates.

    Wherever M has an entry, K has one too; the reverse does not hold (of a shell's K, five of six entries are not in
    M).
    """

    M: PETSc.Mat
    K: PETSc.Mat


def rayleigh(damping: Damping) -> Rayleigh:
    """Rayleigh damping D = a M + b K with a scene's factors: a in 1/s is `mass`, b in s is `stiffness`."""
    return Rayleigh(damping.mass, damping.stiffness)


def operators_of(model: StructuralModel, comm: MPI.Comm) -> Operators:
    """Mass and stiffness of a model, assembled from its forms or read from given matrices; collective."""
    if is_assembled(model):
        return assemble_model(model, model.domain(comm))
    assert isinstance(model, Matrices)
    first, last = share(model.size, comm)
    sizes = (int(last - first), model.size)
    matrices = []
    for A in (model.body_matrices.M, pad_pattern(model.body_matrices.K, model.body_matrices.M)):
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
    """A with explicit zeros added where `other` has entries, so that the pattern of A contains that of `other`."""
    A, other = A.tocoo(), other.tocoo()
    entries = np.concatenate([A.data, np.zeros(other.nnz)])
    places = np.concatenate([A.row, other.row]), np.concatenate([A.col, other.col])
    return sp.csr_matrix((entries, places), shape=A.shape)


def assemble_model(model: FiniteElementModel, domain: object) -> Operators:
    """Assemble mass and stiffness of a model on its distributed mesh, without boundary conditions; collective.

    It also frees PETSc objects of earlier models that Python has dropped, as PETSc does so only on request.
    """
    free_dropped(comm_of(domain), cycles=False)
    assembler = Assembler(model, domain)
    forms = model.forms(assembler.space)
    return Operators(assembler.matrix(forms.mass, zeros=False), assembler.matrix(forms.stiffness))


class Assembler:
    """Assembles forms on a model's function space to matrices in the model's order of coordinates."""

    def __init__(self, model: FiniteElementModel, domain: object) -> None:
        self.model, self.comm, self.space = model, comm_of(domain), model.space(domain)
        self._order = model_order(model, self.space)

    def matrix(self, form: object, zeros: bool = True) -> PETSc.Mat:
        """Assemble a UFL form to a matrix (n, n); explicit zeros of its pattern are kept if `zeros`.  Collective."""
        return self.assemble_form(compiled_form(form), zeros)

    def assemble_form(self, form: object, zeros: bool = True) -> PETSc.Mat:
        """Assemble a compiled form to a matrix (n, n); explicit zeros of its pattern are kept if `zeros`.

        Collective.
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

    def displacement_function(self, q: Array) -> Any:
        """Function on the space with the model's coordinates q (n,), the same on every rank; collective.

        The model must have no `transformation`.
        """
        values = np.empty(len(q))
        values[self._order] = q
        return function(self.space, values)


def model_order(model: FiniteElementModel, space: Any) -> Indices:
    """PETSc's global index (n,) in the space of each of the model's coordinates; collective, the same on every rank.

    Raises
    ------
    RuntimeError
        If the model's numbering does not cover the space's coordinates exactly once.
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
        raise RuntimeError("the model's coordinates and the space's do not match")
    return order


@dataclass(frozen=True)
class MatrixRows:
    """Some rows of a matrix (N, N) on one rank: their numbers (n,) and entries (n, N)."""

    numbers: Indices
    matrix: sp.csr_matrix

    def select(self, positions: Indices) -> MatrixRows:
        """The rows at these positions, in their order."""
        return MatrixRows(self.numbers[positions], self.matrix[positions])


def _local_rows(A: PETSc.Mat) -> MatrixRows:
    """Rows of A that this rank owns; frees A."""
    rows = MatrixRows(np.arange(*A.getOwnershipRange()), local_csr(A))
    free_objects(A)
    return rows


def reorder_rows(rows: MatrixRows, order: Indices, comm: MPI.Comm) -> PETSc.Mat:
    """Matrix with rows and columns in the model's order, in consecutive shares of about equal size; collective.

    `rows` are this rank's in PETSc's order; `order` (N,) is PETSc's index of each of the model's coordinates, from
    `model_order`.  PETSc's own `createSubMatrix` takes three times as long on two ranks as on one.
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
    """Send rows to the ranks whose shares they are in; returns the rows of this rank's share, ascending.

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
    """P^T A P; frees A.  Collective."""
    product = A.PtAP(P)
    result = product.copy()  # a product keeps its factors for ever
    free_objects(product, A)
    return result


def share(size: int, comm: MPI.Comm) -> Indices:
    """First coordinate of this rank's share of `size`, and the one after its last."""
    return np.array([comm.rank, comm.rank + 1]) * size // comm.size
