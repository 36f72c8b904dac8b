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
    """Mass, stiffness and damping of a model, assembled from its weak forms or as given by matrices; collective."""
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
    """Copy of A with stored zeros where only `other` has entries, so that its pattern contains both patterns."""
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
        """Make the function space of `model` on its mesh `domain`, a dolfinx mesh, and the order of its coordinates."""
        self.model, self.comm, self.space = model, comm_of(domain), model.space(domain)
        self._order = model_order(model, self.space)
        self._projection: sp.csr_matrix | None = None  # None: the model's coordinates are those of the space, reordered
        if model.transformation is not None:
            numbers = np.arange(len(self._order))
            ordered = sp.csr_matrix((np.ones(len(numbers)), (self._order, numbers)))
            self._projection = sp.csr_matrix(ordered @ model.transformation)

    def matrix(self, form: object, zeros: bool = True) -> PETSc.Mat:
        """Assemble a UFL form to a matrix (n, n), whose pattern has stored zeros only if `zeros`; collective."""
        return self.assemble_form(compiled_form(form), zeros)

    def assemble_form(self, form: object, zeros: bool = True) -> PETSc.Mat:
        """Assemble a compiled form to a matrix (n, n) on the model's coordinates, of which ranks own equal shares.

        The pattern of the matrix has stored zeros only if `zeros`.  Collective.
        """
        A, size = assemble(form), len(self._order) if self._projection is None else self._projection.shape[1]
        low, high = (int(number) for number in share(size, self.comm))
        if self._projection is None:
            change = PETSc.IS().createGeneral(self._order[low:high].astype(PETSc.IntType), comm=A.comm)
            reordered = A.createSubMatrix(change, change)  # a tenth of the time of a product with a permutation
        else:
            change = sparse(self._projection[slice(*A.getOwnershipRange())], A, columns=high - low)
            reordered = A.PtAP(change)
        rows = local_csr(reordered)
        free_objects(change, reordered, A)
        if not zeros:
            rows.eliminate_zeros()
        sizes, csr = (high - low, size), (rows.indptr, rows.indices, rows.data)
        matrix = PETSc.Mat().createAIJ((sizes, sizes), csr=csr, comm=self.comm)  # `reordered` is on dolfinx' copy of it
        matrix.assemble()
        return matrix

    def displacement_function(self, q: Array) -> Function:
        """Function on the function space with the model's coordinates q (n,), the same on every rank; collective.

        Not to be called for a model with a `transformation`, whose coordinates are not those of the function space.
        """
        values = np.empty(len(q))
        values[self._order] = q
        return function(self.space, values)


def model_order(model: FiniteElementModel, space: FunctionSpace) -> Indices:
    """PETSc indices (n,) in the function space of the model's n coordinates; collective, the same on every rank.

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


def project_matrix(A: PETSc.Mat, P: PETSc.Mat) -> PETSc.Mat:
    """Product P^T A P, whose rows are distributed as the columns of P; A is freed.  Collective."""
    product = A.PtAP(P)
    result = product.copy()  # a PETSc product keeps its factors in memory as long as it lives
    free_objects(product, A)
    return result


def share(size: int, comm: MPI.Comm) -> Indices:
    """Range (2,) of this rank's coordinates among `size`: number of the first one, and number after the last one."""
    return np.array([comm.rank, comm.rank + 1]) * size // comm.size
