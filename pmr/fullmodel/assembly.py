"""From a structural model's forms to matrices in its own order of coordinates."""

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
from pmr.reduced.matrices import Rayleigh
from pmr.scene import Damping

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Operators:
    """Mass and stiffness (n, n), distributed in consecutive shares of the model's coordinates.

    Each entry of M has its place in K, many a one of K (of a shell five of six) none in M.
    """

    M: PETSc.Mat
    K: PETSc.Mat


def rayleigh(damping: Damping) -> Rayleigh:
    """Factors of mass and stiffness in D = a M + b K."""
    return Rayleigh(damping.mass, damping.stiffness)


def operators_of(model: StructuralModel, comm: MPI.Comm) -> Operators:
    """Mass and stiffness of a model: assembled, or as they were given; collective."""
    if is_assembled(model):
        return assemble_model(model, model.domain(comm))
    assert isinstance(model, Matrices)
    first, last = share(model.size, comm)
    sizes = (int(last - first), model.size)
    matrices = []
    for A in (model.given.M, pad_pattern(model.given.K, model.given.M)):
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
    """A with zeros wherever the other one has entries: damping and shifts add M and K, which takes one pattern."""
    A, other = A.tocoo(), other.tocoo()
    entries = np.concatenate([A.data, np.zeros(other.nnz)])
    places = np.concatenate([A.row, other.row]), np.concatenate([A.col, other.col])
    return sp.csr_matrix((entries, places), shape=A.shape)


def assemble_model(model: FiniteElementModel, domain: Any) -> Operators:
    """Mass and stiffness of a model on its distributed mesh, free of boundary conditions; collective.

    Models before it that were dropped are freed here: nobody is asked to do so when a run ends.
    """
    free_dropped(comm_of(domain), cycles=False)
    assembler = Assembler(model, domain)
    forms = model.forms(assembler.space)
    return Operators(assembler.matrix(forms.mass, zeros=False), assembler.matrix(forms.stiffness))


class Assembler:
    """A model's function space on its distributed mesh, and matrices of forms there in the model's order."""

    def __init__(self, model: FiniteElementModel, domain: Any) -> None:
        self.model, self.comm, self.space = model, comm_of(domain), model.space(domain)
        self._order = model_order(model, self.space)

    def matrix(self, form: Any, zeros: bool = True) -> PETSc.Mat:
        """Assemble a form in UFL on the model's coordinates, with or without the zeros of its pattern; collective."""
        return self.assemble_form(compiled_form(form), zeros)

    def assemble_form(self, form: Any, zeros: bool = True) -> PETSc.Mat:
        """Assemble a form that is compiled, as `matrix` does."""
        rows = _rows(assemble(form))
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

    def function(self, q: Array) -> Any:
        """The model's coordinates q (n,), the same on every rank, as a function on the space; collective."""
        values = np.empty(len(q))
        values[self._order] = q
        return function(self.space, values)


def model_order(model: FiniteElementModel, space: Any) -> Indices:
    """PETSc's global index of each of the space's coordinates in the model's order, the same on every rank.

    Raises
    ------
    RuntimeError
        If the model's numbers do not fit the space.
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
class Rows:
    """Rows of a matrix (N, N) that one rank knows: their numbers (n,) and entries (n, N)."""

    numbers: Indices
    matrix: sp.csr_matrix

    def taken(self, which: Indices) -> Rows:
        """Some of them, in the order given."""
        return Rows(self.numbers[which], self.matrix[which])


def _rows(A: PETSc.Mat) -> Rows:
    """This rank's; A is freed."""
    rows = Rows(np.arange(*A.getOwnershipRange()), local_csr(A))
    free_objects(A)
    return rows


def reorder_rows(rows: Rows, order: Indices, comm: MPI.Comm) -> PETSc.Mat:
    """A matrix with rows and columns in the model's order, in consecutive shares of about equal size; collective.

    `createSubMatrix` takes three times as long on two ranks as on one.
    """
    number = np.empty(len(order), PETSc.IntType)
    number[order] = np.arange(len(order), dtype=number.dtype)
    share_of_rank = _exchange_rows(Rows(number[rows.numbers], rows.matrix), comm).matrix
    share_of_rank.indices[:] = number[share_of_rank.indices]
    share_of_rank.has_sorted_indices = False
    share_of_rank.sort_indices()
    sizes = (share_of_rank.shape[0], len(order))
    result = PETSc.Mat().createAIJ(
        (sizes, sizes), csr=(share_of_rank.indptr, share_of_rank.indices, share_of_rank.data), comm=comm
    )
    result.assemble()
    return result


def _exchange_rows(rows: Rows, comm: MPI.Comm) -> Rows:
    """The rows of this rank's share, of those that all ranks know, ascending; collective."""
    ends = np.arange(1, comm.size + 1) * rows.matrix.shape[1] // comm.size
    owner = np.searchsorted(ends, rows.numbers, side="right")
    sent = [rows.taken(np.flatnonzero(owner == rank)) if rank != comm.rank else None for rank in range(comm.size)]
    received = [part for part in comm.alltoall(sent) if part is not None]
    if received:
        owner = np.concatenate([owner, *(np.full(len(part.numbers), comm.rank) for part in received)])
        numbers = np.concatenate([rows.numbers, *(part.numbers for part in received)])
        rows = Rows(numbers, sp.vstack([rows.matrix, *(part.matrix for part in received)], "csr"))
    owned = np.flatnonzero(owner == comm.rank)
    return rows.taken(owned[np.argsort(rows.numbers[owned])])


def project_matrix(A: PETSc.Mat, P: PETSc.Mat) -> PETSc.Mat:
    """P^T A P; A is freed."""
    product = A.PtAP(P)
    result = product.copy()  # a product keeps its factors for ever
    free_objects(product, A)
    return result


def share(size: int, comm: Any) -> Indices:
    """First and last coordinate (excluded) of this rank's share."""
    return np.array([comm.rank, comm.rank + 1]) * size // comm.size
