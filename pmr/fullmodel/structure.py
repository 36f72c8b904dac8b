r"""A structure: a model with clamps, pads, loads, gravity, masses and outputs, and the coordinates that remain of it.

Clamps and rigid couplings are eliminated from the coordinates q of a structural model.  The coordinates z of the
structure remain: q = T z.  :math:`M_q` and :math:`K_q` are mass and stiffness of the model, :math:`B_q` are its inputs,
and an attached body of mass m and inertia J moves by g = G q.  Mass, stiffness and inputs of the structure are

.. math::
    M = T^T \bigl(M_q + G^T \operatorname{diag}(m, J)\, G\bigr) T, \qquad K = T^T K_q T, \qquad B = T^T B_q

`structural_model` assembles the full model of a structure: its matrices, rows, loads and outputs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
import scipy.sparse as sp

from pmr.errors import InputError
from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import free_objects, from_transpose, project_matrix, share, sparse
from pmr.files.arrays import Array
from pmr.fullmodel.actions import ALONG, Action, Gauge, Inertia, LineLoad, PadForce, Warmth, Weight
from pmr.fullmodel.model import FullModel, Operators, RigidMotions, masses_of, operators_of, pad_pattern, rayleigh
from pmr.fullmodel.moving import FrameAssembler, acceleration_field
from pmr.fullmodel.pads import Pads, Restraints, restrain
from pmr.fullmodel.walls import Walls
from pmr.models import DIRECTIONS, StructuralModel, is_assembled, is_beam
from pmr.models.matrices import Matrices
from pmr.scene import Damping
from pmr.scene.structures import PointMass, unit_vector
from pmr.system.body_matrices import CARRIED, DAMPING, ROTATING, Rayleigh
from pmr.system.rows import Rows


@dataclass(frozen=True)
class Clamp:
    """Coordinates on a named group that are held at zero; by default displacements and rotations of all axes."""

    on: str
    directions: tuple[str, ...] = ("x", "y", "z", "rx", "ry", "rz")


#: Number of cross-sections at which a force per length acts on a body that is no beam.
SECTIONS = 24


@dataclass(frozen=True)
class Structure:
    """A structural model with its clamps, pads, masses, loads, outputs and ports."""

    model: StructuralModel
    clamps: tuple[Clamp, ...] = ()
    masses: tuple[PointMass, ...] = ()
    loads: tuple[Action | Weight | Inertia | Warmth | LineLoad, ...] = ()
    outputs: tuple[Action | PadForce | Gauge, ...] = ()
    damping: Damping = Damping()
    pads: Pads = Pads()
    ports: tuple[Action, ...] = ()  # motions of places to which something may be attached
    # names of matrices of a moving frame and of second order (`pmr.system.body_matrices`)
    matrices: tuple[str, ...] = ()


@dataclass(frozen=True)
class Coupling:
    """Coordinates z (n',) that remain once a structure's clamps and rigid couplings are eliminated.

    The n coordinates of its model are q = T z.
    """

    model: StructuralModel
    # (n, n'): the model's free coordinates in their order, then the motions of rigidly coupled masses, dents of walls
    T: sp.csr_matrix
    masses: tuple[PointMass, ...]
    motions: tuple[sp.csr_matrix, ...]  # (k, n') each: G of each mass, along the k directions of the model
    rigid: Array  # (n', k): z under each of the model's k rigid motions
    clamped: Array  # (c, k): coordinates of q that are clamped, under the same rigid motions without the clamps
    walls: Walls

    def attached_mass(self) -> sp.csr_matrix:
        """Mass (n', n') of attached masses and of flexible walls.

        An attached mass m with inertia J moves by G z and contributes G^T diag(m, J) G.
        """
        return sp.csr_matrix(self.walls.mass(self.T.shape[1]) + self.attached_inertia(np.eye(3)))

    def attached_inertia(self, S: Array) -> sp.csr_matrix:
        """Integral (n', n') of rho v . S u over the attached masses, for displacements u (trial) and v (test) on z.

        If S (3, 3) is the identity, this is the mass matrix of the attached masses.
        """
        total = sp.csr_matrix((self.T.shape[1],) * 2)
        for mass, G in zip(self.masses, self.motions, strict=True):
            total += G.T @ sp.csr_matrix(_inertia(mass, self.model.directions, S)) @ G
        return total

    def rows(self, actions: Sequence[Action | Gauge]) -> sp.csr_matrix:
        """Rows (k, n') of k actions and gauges on the n' coordinates z of the structure, in the order of `actions`.

        A row of an action measures the displacement or rotation along its direction; transposed, it applies a force or
        moment there.  A row of a gauge only measures.  Where walls are flexible, rows of actions include their dents.

        Raises an `InputError` if the model cannot move along an action's direction.
        """
        directions, motion = self.model.directions, cache(self.model.motion)
        for action in actions:
            if isinstance(action, Action) and action.direction not in directions:
                allowed = f"{', '.join(directions)} are allowed"
                raise InputError("scene", f"{action.name}.direction", action.direction, allowed)
        rows = [sp.csr_matrix((0, self.model.size))]
        # displacements of all places share one matrix
        along = {k: of for k, of in enumerate(actions) if isinstance(of, Action) and of.is_displacement}
        first = {on: k for k, on in enumerate(dict.fromkeys(action.on for action in along.values()))}
        if along:
            count = sum(direction in ALONG for direction in directions)
            numbers = [count * first[action.on] + directions.index(action.direction) for action in along.values()]
            rows.append(self.model.displacement(*first)[numbers])
        further = [k for k in range(len(actions)) if k not in along]
        for action in (actions[k] for k in further):
            if isinstance(action, Gauge):
                rows.append(sp.csr_matrix(action.row))
                continue
            at = None if action.point is None else np.array(action.point)
            of_place = motion(action.on) if at is None else self.model.motion(action.on, at)
            rows.append(of_place[directions.index(action.direction)])
        result = sp.csr_matrix(sp.vstack(rows, "csr")[np.argsort([*along, *further])] @ self.T)
        if self.walls.count and actions:
            result = sp.csr_matrix(result + sp.vstack([self._dents(action) for action in actions]))
        return result

    def _dents(self, action: Action | Gauge) -> sp.csr_matrix:
        """Row (1, n') that is to be added to the row of an action for the dents of walls; zero for a gauge."""
        nothing = sp.csr_matrix((1, self.T.shape[1]))
        if isinstance(action, Gauge):
            return nothing
        return self.walls.add_end_motion(nothing, action.on, (action.direction,))

    def load(
        self, load: Action | Weight | Inertia | Warmth | LineLoad, M: PETSc.Mat, moving: FrameAssembler
    ) -> sp.csr_matrix:
        """Forces on the n' coordinates z by one unit of the input of `load`, as a row (1, n'); collective.

        M is the model's mass matrix.  `moving` assembles the loads of acceleration fields.  Raises InputError for
        temperatures on a body that is no beam.
        """
        if isinstance(load, Action):
            return self.rows([load])
        if isinstance(load, LineLoad):
            return sp.csr_matrix(_line_load_row(self.model, load) @ self.T)
        if isinstance(load, Warmth):
            if not is_beam(self.model):
                allowed = "a force or wind is allowed on a body that is no beam: temperatures act on beams only"
                raise InputError("scene", "loads.acts", load.name, allowed)
            return sp.csr_matrix(self.model.bending_load(load.direction, load.gradient) @ self.T)
        if isinstance(load, Inertia):
            return self._acceleration_row(load.name, moving.acceleration_load(load.name))
        along = dict(zip("xyz", unit_vector(load.direction), strict=True))
        acceleration = np.array([along.get(direction, 0.0) for direction in self.model.directions])
        x, f = M.createVecRight(), M.createVecLeft()
        first, last = M.getOwnershipRange()
        x.getArray()[:] = (self.model.rigid_motions() @ acceleration)[first:last]
        M.mult(x, f)
        free_objects(x)
        column = self.T.T @ np.concatenate(M.comm.tompi4py().allgather(f.getArray()))
        for mass, G in zip(self.masses, self.motions, strict=True):
            column += G.T @ (_inertia(mass, self.model.directions, np.eye(3)) @ acceleration)
        return sp.csr_matrix(column)

    def _acceleration_row(self, name: str, model_load: Array) -> sp.csr_matrix:
        """Load vector (1, n') of the inertia input `name`, with attached masses.

        The name is a key of CONSTANT or LINEAR in `pmr.system.body_matrices`, such as ``inertia x`` or ``inertia xz``.
        `model_load` (n,) is the load on the model alone.
        """
        row, (S, rigid) = self.T.T @ model_load, acceleration_field(name, self.model)
        motion = self.model.rigid_motions() @ rigid
        for mass, G in zip(self.masses, self.motions, strict=True):
            row += G.T @ (
                _inertia(mass, self.model.directions, S) @ (self.model.motion(mass.on, _centre(mass)) @ motion)
            )
        return sp.csr_matrix(row)


def _line_load_row(model: StructuralModel, load: LineLoad) -> sp.csr_matrix:
    """Row (1, n) of the forces on a model by a unit of `load`, which is spread over each cross-section.

    The row of a beam is exact, because the displacements in an element are cubic.  On other models forces act at
    `SECTIONS` cross-sections, the points of Gauss' rule along the whole body; their sum and their moments are exact.
    """
    assert is_assembled(model)  # the scene's check refuses wind on given matrices
    x, degree = model.grid.points[:, 0], load.degree
    nodes = model.node_stations
    ends = np.array([[x.min(), x.max()]]) if nodes is None else nodes[model.grid.cells]
    points, weights = np.polynomial.legendre.leggauss(SECTIONS if nodes is None else 3 + degree // 2)
    half = np.diff(ends, axis=1) / 2.0
    places = (ends.mean(axis=1)[:, None] + half * points).ravel()
    amounts = np.polynomial.legendre.legval(2.0 * places / x.max() - 1.0, np.eye(degree + 1)[degree])
    along = [d for d in model.directions if d in "xyz"]
    rows = model.displacement(*places.tolist())[along.index(load.direction) :: len(along)]
    return sp.csr_matrix((amounts * (half * weights).ravel()) @ rows)


def couple(structure: Structure) -> Coupling:
    """Eliminate the clamps and rigid couplings of a structure, and return the coordinates that remain.

    Raises an `InputError` if a rigid mass shares coordinates with a clamp or another rigid mass.
    """
    model = structure.model
    owner = np.full(model.size, "", dtype=object)
    for clamp in structure.clamps:
        owner[model.coordinates_on(clamp.on, clamp.directions)] = f"the clamp at {clamp.on}"
    rigid = [mass for mass in structure.masses if mass.coupling == "rigid"]
    R, clamped = model.rigid_motions(), owner != ""
    blocks, carried = [], []
    for mass in rigid:
        on = model.coordinates_on(str(mass.on), model.directions)
        taken = next((name for name in owner[on] if name), "")
        if taken:
            raise InputError("scene", f"masses.{mass.name}.on", mass.on, f"shares coordinates with {taken}")
        owner[on] = mass.name
        of_centre = model.motion(mass.on, _centre(mass)) @ R
        follows = R @ np.linalg.inv(of_centre)
        carried.append(of_centre)
        block = sp.lil_matrix((model.size, R.shape[1]))
        block[on] = follows[on]
        blocks.append(block)
    free = np.flatnonzero(owner == "")
    selection = sp.csr_matrix((np.ones(len(free)), (free, np.arange(len(free)))), shape=(model.size, len(free)))
    walls = structure.pads.walls
    T = sp.hstack([selection, *blocks, sp.csr_matrix((model.size, walls.count))], format="csr")
    motions = []
    for mass in structure.masses:
        if mass.coupling == "rigid":
            k = len(model.directions)
            motions.append(sp.eye(k, T.shape[1], k=len(free) + k * rigid.index(mass), format="csr"))
        else:
            motion = (model.motion(mass.on, _centre(mass)) @ T).tocsr()
            motions.append(walls.add_end_motion(motion, mass.on, model.directions))
    rigid_motions = np.vstack([R[free], *carried, np.zeros((walls.count, R.shape[1]))])
    return Coupling(model, T, structure.masses, tuple(motions), rigid_motions, R[clamped], walls)


def _centre(mass: PointMass) -> Array | None:
    """Centre of gravity (3,) in m that the scene gives for a point mass.

    The result is None if the scene gives none; the mass is then at the centroid of its place.
    """
    return None if mass.at is None else np.array(mass.at)


def _inertia(mass: PointMass, directions: Sequence[str], S: Array) -> Array:
    r"""Integral (k, k) of rho v . S u over a mass, for its motions along and about the k `directions` at its centre.

    u and v are the displacements of two such motions.  For displacements of the centre the integral is the mass times
    S.  For rotations by :math:`\theta` with the mass's inertia J it is

    .. math:: v \cdot S u = \sum S_{jk} \varepsilon_{jab} \varepsilon_{kcb}\, \theta_a \theta_c\, r_b^2, \qquad
        \int \rho\, r_b^2 = \tfrac12 \operatorname{tr} J - J_b

    with the vector r from the centre to a point of the mass.  If S (3, 3) is the identity, the result is diag(m, J).
    """
    J = np.array(mass.inertia)
    turned = np.stack([np.cross(axis, np.eye(3)).T for axis in np.eye(3)])  # of r by a unit angle about an axis
    inertia = np.zeros((6, 6))
    inertia[:3, :3] = mass.mass * S
    inertia[3:, 3:] = np.einsum("ajb,jk,ckb,b->ac", turned, S, turned, J.sum() / 2.0 - J)
    numbers = [DIRECTIONS.index(direction) for direction in directions]
    return inertia[np.ix_(numbers, numbers)]


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
        B=from_transpose(operators.M, sp.vstack(loads, format="csr")),
        outputs=from_transpose(operators.M, outputs),
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
    """Matrices of a moving frame and of axial forces, by their `names`; those that are zero are left out.  Collective.

    `moving` assembles them for the model; `coupling` takes them to the coordinates that clamps leave, and adds the
    masses that are attached to the model.  Walls that give way under pads add nothing to the matrices: their dents are
    small, and so is their mass.
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
    """Rigid motions of a structure, and what clamps, springs and supports inside its matrices measure of them.

    The springs are those of `restraints`.  A spring weaker than the round-off in the stiffness K is left out.
    Collective: every rank has its part of the motions.
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
    """Sum of T^T A T and `addition`, with consecutive rows on each rank; collective.

    A must not be used afterwards: it is freed or, if T is the identity, changed in place and returned.
    """
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
    """Coordinate along x in m at which an output of the structure is measured; for a place, its centroid's."""
    if isinstance(output, Gauge):
        return float(output.at[0])
    if isinstance(output, Action):
        return float(structure.model.centroid(output.on)[0])
    places = {pad.name: pad.at for pad in structure.pads.fixed}
    places |= {support.name: float(structure.model.centroid(support.on)[0]) for support in structure.pads.supports}
    return places[output.pad]
