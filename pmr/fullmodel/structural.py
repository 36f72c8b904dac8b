"""The full model of a structure: its matrices, rows, loads and outputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import columns, free_objects, sparse
from pmr.fullmodel.assembly import Operators, operators_of, pad_pattern, project_matrix, rayleigh, share
from pmr.fullmodel.model import FullModel, RigidMotions, masses_of
from pmr.fullmodel.moving import FrameAssembler
from pmr.fullmodel.pads import Restraints, restrain
from pmr.fullmodel.probes import Gauge
from pmr.fullmodel.structure import Action, Coupling, PadForce, Structure, couple
from pmr.models.matrices import Matrices
from pmr.system.body_matrices import CARRIED, DAMPING, ROTATING, Rayleigh
from pmr.system.rows import Rows


def structural_model(structure: Structure, comm: MPI.Comm = MPI.COMM_WORLD) -> FullModel:
    """Assemble the full model of a structure on `comm`; collective.

    Clamped coordinates are left out.  The constraint rows are those of the structure's pads.  Raises an `InputError` if
    a place does not exist, a rigid coupling shares coordinates with a clamp or another coupling, or a pad leaves its
    face.
    """
    model = structure.model
    base = operators_of(model, comm)
    coupling = couple(structure)
    attached = coupling.attached_mass()
    size = coupling.T.shape[1]
    restraints = restrain(structure.pads, model, coupling.T)
    springs = restraints.stiffness(size) + structure.pads.walls.stiffness(size)
    moving, masses = FrameAssembler(model, structure.masses, comm), masses_of(model, structure.masses, base.M)
    loads = [sp.csr_matrix((0, size)), *(coupling.load(load, base.M, moving) for load in structure.loads)]
    operators = Operators(
        _constrain_matrix(base.M, coupling.T, attached),
        _constrain_matrix(base.K, coupling.T, pad_pattern(springs, attached)),
        None if base.D is None else _constrain_matrix(base.D, coupling.T, sp.csr_matrix((size, size))),
    )
    damping, matrices = rayleigh(structure.damping), _frame_matrices(structure.matrices, coupling, moving)
    if operators.D is not None:
        damping = matrices[DAMPING] = _add_rayleigh(operators, damping)
    of_pads = [isinstance(output, PadForce) for output in structure.outputs]
    places = coupling.rows([output for output in structure.outputs if not isinstance(output, PadForce)])
    forces = [restraints.force(output.pad, size) for output in structure.outputs if isinstance(output, PadForce)]
    outputs = sp.vstack([places, *forces], format="csr")[np.argsort(np.argsort(of_pads, kind="stable"))]
    return FullModel(
        operators.M,
        damping,
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
        rigid=_rigid_motions(coupling, restraints, operators.K),
        node_stations=model.node_stations,
        ports={port.name: coupling.rows([port]) for port in structure.ports},
        matrices=matrices,
        masses=masses,
    )


def _add_rayleigh(operators: Operators, law: Rayleigh) -> PETSc.Mat:
    """Damping D + alpha M + beta K, from the mass, damping and stiffness in `operators`; collective.

    `law` has the factors alpha and beta.  The matrix D of `operators` itself is changed.
    """
    assert operators.D is not None
    for factor, A in ((law.alpha, operators.M), (law.beta, operators.K)):
        if factor:
            operators.D.axpy(factor, A, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    return operators.D


def _frame_matrices(names: Sequence[str], coupling: Coupling, moving: FrameAssembler) -> dict[str, PETSc.Mat]:
    """Matrices of a moving frame and of axial forces, by name; matrices that are zero are left out.  Collective.

    Walls that give way under pads add nothing to the matrices: their dents are small, and so is their mass.
    """
    tensors, nothing = ROTATING | CARRIED, sp.csr_matrix((coupling.T.shape[1],) * 2)
    matrices = dict[str, PETSc.Mat]()
    for name in names:
        if name in tensors:
            of_model, attached = moving.inertia(tensors[name]), coupling.attached_inertia(tensors[name])
        else:
            of_model, attached = moving.geometric_stiffness(name), nothing
        matrix = _constrain_matrix(of_model, coupling.T, attached)
        if matrix.norm(PETSc.NormType.NORM_INFINITY) > 0.0:
            matrices[name] = matrix
        else:
            free_objects(matrix)
    moving.free_memory()
    return matrices


def _rigid_motions(coupling: Coupling, restraints: Restraints, K: PETSc.Mat) -> RigidMotions:
    """Rigid motions of a structure, and the values that clamps, springs and supports inside its matrices take.

    A spring weaker than the round-off in the stiffness K is left out.  Collective: every rank has its part of the
    motions.
    """
    model, size = coupling.model, coupling.T.shape[1]
    inner_supports = model.body_matrices.held if isinstance(model, Matrices) else np.empty((0, len(model.directions)))
    lost = size * np.finfo(float).eps * np.concatenate(K.comm.tompi4py().allgather(K.getDiagonal().getArray()))
    springs = [
        np.asarray(c @ coupling.rigid)
        for c, spring in zip(restraints.spring_rows(size), restraints.springs, strict=True)
        if np.any(c.toarray()[0] ** 2 > spring.compliance * lost)
    ]
    of_rank = coupling.rigid[slice(*K.getOwnershipRange())].copy()
    held = np.vstack([coupling.clamped, inner_supports, *springs])
    return RigidMotions(of_rank, held, complete=not len(coupling.clamped) and not len(inner_supports))


def _constrain_matrix(A: PETSc.Mat, T: sp.csr_matrix, addition: sp.csr_matrix) -> PETSc.Mat:
    """Sum of T^T A T and `addition`, with consecutive rows on each rank; A is freed.  Collective."""
    low, high = share(T.shape[1], A.comm.tompi4py())
    is_identity = T.shape[0] == T.shape[1] and (T != sp.eye(T.shape[0], format="csr")).nnz == 0
    P = None if is_identity else sparse(T[slice(*A.getOwnershipRange())], A, columns=int(high - low))
    result = A if P is None else project_matrix(A, P)
    if P is not None:
        free_objects(P)
    if addition.nnz:
        more = sparse(addition[low:high], result, columns=int(high - low))
        result.axpy(1.0, more, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
        free_objects(more)
    return result


def _position(output: Action | PadForce | Gauge, structure: Structure) -> float:
    """Coordinate along the axis in m at which an output of the structure is measured."""
    if isinstance(output, Gauge):
        return float(output.at[0])
    if isinstance(output, Action):
        return float(structure.model.centroid(output.on)[0])
    places = {pad.name: pad.at for pad in structure.pads.fixed}
    places |= {support.name: float(structure.model.centroid(support.on)[0]) for support in structure.pads.supports}
    return places[output.pad]
