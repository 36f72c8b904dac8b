"""The full model of a structure: its matrices, rows, loads and outputs on the coordinates that it has."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.constraints.rows import Rows
from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import free_objects, sparse
from pmr.fem.matrices import columns
from pmr.fullmodel.assembly import Operators, operators_of, pad_pattern, project_matrix, rayleigh, share
from pmr.fullmodel.masses import masses_of
from pmr.fullmodel.model import FullModel, RigidMotions
from pmr.fullmodel.moving import Moving
from pmr.fullmodel.pads import Restraints, restrain
from pmr.fullmodel.probes import Gauge
from pmr.fullmodel.structure import Action, Coupling, PadForce, Structure, couple
from pmr.fullmodel.symmetry import mirror_images
from pmr.models import StructuralModel
from pmr.models.matrices import Matrices
from pmr.reduced.matrices import CARRIED, ROTATING

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def structural_model(structure: Structure, comm: MPI.Comm = MPI.COMM_WORLD) -> FullModel:
    """Assemble a structure on `comm`; its rows are the pads', for what is clamped is left out.

    Raises an `InputError` if a place does not exist, a rigid coupling meets a clamp or another one, or a pad leaves its
    face.
    """
    model = structure.model
    base = operators_of(model, comm)
    coupling = couple(structure)
    attached = coupling.attached_mass()
    size = coupling.T.shape[1]
    restraints = restrain(structure.pads, model, coupling.T)
    springs = restraints.stiffness(size) + structure.pads.walls.stiffness(size)
    moving, masses = Moving(model, structure.masses, comm), masses_of(model, structure.masses, base.M)
    loads = [sp.csr_matrix((0, size)), *(coupling.load(load, base.M, moving) for load in structure.loads)]
    operators = Operators(
        _constrain_matrix(base.M, coupling.T, attached),
        _constrain_matrix(base.K, coupling.T, pad_pattern(springs, attached)),
    )
    of_pads = [isinstance(output, PadForce) for output in structure.outputs]
    places = coupling.rows([output for output in structure.outputs if not isinstance(output, PadForce)])
    forces = [restraints.force(output.pad, size) for output in structure.outputs if isinstance(output, PadForce)]
    outputs = sp.vstack([places, *forces], format="csr")[np.argsort(np.argsort(of_pads, kind="stable"))]
    return FullModel(
        operators.M,
        rayleigh(structure.damping),
        operators.K,
        inputs=columns(operators.M, sp.vstack(loads, format="csr")),
        outputs=columns(operators.M, outputs),
        rows=Rows(restraints.rows, size),
        input_names=tuple(load.name for load in structure.loads),
        output_positions=np.array([_position(output, structure) for output in structure.outputs]),
        output_names=tuple(output.name for output in structure.outputs),
        output_units=tuple(output.unit for output in structure.outputs),
        output_kinds=tuple(output.kind for output in structure.outputs),
        reference_frequency=model.reference_frequency,
        rigid=_rigid_motions(coupling, restraints, operators.K, _held_by(model)),
        node_stations=model.node_stations,
        mirrors=mirror_images(model, coupling.T, operators.M, operators.K),
        ports={port.name: coupling.rows([port]) for port in structure.ports},
        matrices=_added_matrices(structure.matrices, coupling, moving),
        masses=masses,
    )


def _added_matrices(names: Sequence[str], coupling: Coupling, moving: Moving) -> dict[str, PETSc.Mat]:
    """Matrices of a moving frame and of axial forces, by name; those that vanish are left out.  Collective.

    Walls that give way under pads have no part in it: their dents are small, and so is what they weigh.
    """
    tensors, nothing = ROTATING | CARRIED, sp.csr_matrix((coupling.T.shape[1],) * 2)
    matrices = dict[str, PETSc.Mat]()
    for name in names:
        if name in tensors:
            of_model, attached = moving.inertia(tensors[name]), coupling.attached(tensors[name])
        else:
            of_model, attached = moving.geometric_stiffness(name), nothing
        matrix = _constrain_matrix(of_model, coupling.T, attached)
        if matrix.norm(PETSc.NormType.NORM_INFINITY) > 0.0:
            matrices[name] = matrix
        else:
            free_objects(matrix)
    moving.drop()
    return matrices


def _held_by(model: StructuralModel) -> Array:
    """Rows (h, k) of the model's rigid motions that its stiffness resists by itself: supports inside given matrices."""
    return model.given.held if isinstance(model, Matrices) else np.empty((0, len(model.directions)))


def _rigid_motions(coupling: Coupling, restraints: Restraints, K: PETSc.Mat, resisted: Array) -> RigidMotions:
    """This rank's rows of them, and what clamps and springs measure of each; a spring within K's round-off has none."""
    size = coupling.T.shape[1]
    lost = size * np.finfo(float).eps * np.concatenate(K.comm.tompi4py().allgather(K.getDiagonal().getArray()))
    springs = [
        np.asarray(c @ coupling.rigid)
        for c, spring in zip(restraints.vectors(size), restraints.springs, strict=True)
        if np.any(c.toarray()[0] ** 2 > spring.compliance * lost)
    ]
    of_rank = coupling.rigid[slice(*K.getOwnershipRange())].copy()
    held = np.vstack([coupling.clamped, resisted, *springs])
    return RigidMotions(of_rank, held, whole=not len(coupling.clamped) and not len(resisted))


def _constrain_matrix(A: PETSc.Mat, T: sp.csr_matrix, added: sp.csr_matrix) -> PETSc.Mat:
    """T^T A T + added, distributed in consecutive shares; entries of `added` have a place even if zero.

    A is freed.  Where nothing is coupled there is no product: T only leaves coordinates out, or none.
    """
    first, last = A.getOwnershipRange()
    low, high = share(T.shape[1], A.comm.tompi4py())
    if not _leaves_out(T):
        P = sparse(T[first:last], A, columns=int(high - low))
        result = project_matrix(A, P)
        free_objects(P)
    elif T.shape[0] > T.shape[1]:
        result = _without_rest(A, np.flatnonzero(np.diff(T.indptr))[low:high])
    else:
        result = A
    if added.nnz:
        more = sparse(added[low:high], result, columns=int(high - low))
        result.axpy(1.0, more, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        free_objects(more)
    return result


def _without_rest(A: PETSc.Mat, numbers: Indices) -> PETSc.Mat:
    """Rows and columns of A that any rank owns afterwards; A is freed."""
    chosen = PETSc.IS().createGeneral(numbers.astype(PETSc.IntType), comm=A.comm)
    result = A.createSubMatrix(chosen, chosen)
    free_objects(A, chosen)
    return result


def _leaves_out(T: sp.csr_matrix) -> bool:
    """Whether T z has the coordinates z in their order, and zeros between them.

    A mass on a single node has as many entries as coordinates, in another place and with other signs.
    """
    T = T.tocoo()
    order = np.argsort(T.row, kind="stable")
    return T.nnz == T.shape[1] and bool(np.all(T.data == 1.0) and np.all(T.col[order] == np.arange(T.nnz)))


def _position(output: Action | PadForce | Gauge, structure: Structure) -> float:
    """Place along the axis at which an output is measured, m."""
    if isinstance(output, Gauge):
        return float(output.at[0])
    if isinstance(output, Action):
        return float(structure.model.centroid(output.on)[0])
    places = {pad.name: pad.at for pad in structure.pads.fixed}
    places |= {support.name: float(structure.model.centroid(support.on)[0]) for support in structure.pads.supports}
    return places[output.pad]
