r"""A scene's body with its sliders held at one position, on nodes or on frames, as other programs read it.

`held_body` has coordinates of nodes with three displacements each.  `framed_body` has coordinates of frames, by Craig
and Bampton's reduction: all supports and pads that hold the body at s are attached to one frame, the ground.  With the
motion u_g of the ground, the motions u of the other frames, which the rows G measure on the body, the rigid motions R
of the body and R_f of the frames, and coordinates eta of modes Phi, the body moves by

.. math::
    q = R u_g + w, \qquad w = \Psi (u - R_f u_g) + \Phi \eta, \qquad
    \Psi = K^{-1} G^T (G K^{-1} G^T)^{-1}

Psi is the static response of the body on pads and supports to motions of the frames; Phi are the lowest modes with all
frames held.  Craig and Bampton: Coupling of substructures for dynamic analyses, AIAA Journal 6, 1968, pp. 1313-1319.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from pmr.errors import InputError
from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import free_objects, gather, sparse, times
from pmr.files.arrays import Array, Indices
from pmr.fullmodel.actions import Action
from pmr.fullmodel.build import AssembledBody, build
from pmr.fullmodel.eigensolvers import eigensolver
from pmr.fullmodel.model import FullModel, operators_of
from pmr.fullmodel.moving import SingularError, static_solver
from pmr.fullmodel.pads import restrain
from pmr.fullmodel.structure import Structure, couple
from pmr.models import DIRECTIONS, StructuralModel, is_assembled
from pmr.models.matrices import Matrices
from pmr.results.field_series import FramedBody, Frames, NodalBody, Places
from pmr.scene import Scene
from pmr.system.body_matrices import symmetric_part
from pmr.system.rows import Row, Rows, fixed_row


def held_body(scene: Scene, s: float, count: int) -> NodalBody:
    """Body of a scene in coordinates of nodes, for another program, with its `count` lowest modes.

    The sliders are held at the path coordinate s (m).  Only to be called in a run on a single MPI rank.

    Raises
    ------
    InputError
        If nodes have coordinates other than three displacements, if the scene has masses (the other program has to
        attach the masses), if a row only pushes, or if s is outside the path.
    ConvergenceError
        If the body has fewer than `count` modes, or these do not converge.
    """
    if scene.masses:
        allowed = "none is allowed: a flexible body is what they are attached to, in the program that reads it"
        raise InputError("scene", "masses", scene.masses[0].name, allowed)
    built = build_at(scene, s)
    structure, full = built.structure, built.model
    model, T = structure.model, couple(structure).T
    order = nodes_of(model).ravel()
    modes = eigensolver(full, scene.reduction.solver).lowest(s, count)
    modes.warn_if_cut(s)
    q = np.asarray(T @ modes.phi)
    operators = operators_of(model, MPI.COMM_SELF)
    M, K = gather(operators.M), gather(operators.K)
    assert M is not None and K is not None
    K = sp.csr_matrix(K + _springs(structure, s))
    R = model.rigid_motions()[order].reshape(-1, 3, 6)
    return NodalBody(
        s=s,
        points=np.stack([R[:, 1, 5], R[:, 2, 3], R[:, 0, 4]], axis=1),  # e_z x r, e_x x r, e_y x r contain x, y, z
        M=sp.csr_matrix(M[order][:, order]),
        K=sp.csr_matrix(K[order][:, order]),
        modes=q[order],
        omega=modes.omega,
        damping=symmetric_part(modes.phi.T @ times(full.D, modes.phi)),
        frames=_measured_places(structure, q),
    )


def build_at(scene: Scene, s: float) -> AssembledBody:
    """Full model of a scene on one rank, after a check that its sliders can be held at the path coordinate s (m).

    Raises
    ------
    InputError
        If s is outside the path, or a row only pushes.
    """
    built = build(scene, MPI.COMM_SELF)
    low, high = built.model.rows.domain
    if not low <= s <= high:
        raise InputError("command line", "--at", s, f"a place from {low:g} to {high:g} m is allowed")
    for row in built.model.rows.rows:
        if row.clearance is not None:
            allowed = f"rows that hold both ways are allowed in a flexible-body file; {row.name} only pushes"
            raise InputError("scene", "pads.unilateral", True, allowed)
    return built


def nodes_of(model: StructuralModel) -> Indices:
    """Numbers (N, 3) of the model's coordinates that are displacements along x, y and z of each of N nodes.

    Raises
    ------
    InputError
        If a node has other coordinates than these three, or lacks one.
    """
    if is_assembled(model):
        from pmr.models.solid import Solid  # imported here: its forms need FEniCSx, given matrices do not

        if isinstance(model, Solid):
            of_cells = model.element_coordinates(np.arange(len(model.mesh.cells)))
            return np.unique(np.column_stack([part.ravel() for part in of_cells]), axis=0)
    if isinstance(model, Matrices):
        matrices = model.body_matrices
        order = np.lexsort((matrices.direction, matrices.node))
        if np.array_equal(matrices.direction[order], np.tile(np.arange(3), len(matrices.points))):
            return np.asarray(order.reshape(-1, 3), dtype=np.int64)
    allowed = "a solid, or matrices with three displacements at each node, are allowed in a flexible-body file"
    raise InputError("scene", "body.model", None, allowed)


def _springs(structure: Structure, s: float) -> sp.csr_matrix:
    """Stiffness in N/m of the springs that hold a structure with its sliders at s (m): supports and pads that give way.

    The sparse matrix (n, n), on the coordinates of the structural model, is the sum of c^T c / compliance over their
    rows c.
    """
    size = structure.model.size
    restraints = restrain(structure.pads, structure.model, sp.eye(size, format="csr"))
    K = restraints.stiffness(size)
    for row in restraints.rows:
        if row.compliance > 0.0:
            c = row.at(s)
            K = K + c.T @ c / row.compliance
    return sp.csr_matrix(K)


def _measured_places(structure: Structure, q: Array) -> Places:
    """Points where loads act and outputs are measured, and the points' motions in the modes q (n, count).

    The loads' points come first; points that coincide are listed once.  Rotations are zero where the model has none.
    """
    model = structure.model
    actions = [action for action in (*structure.loads, *structure.outputs) if isinstance(action, Action)]
    places = list(dict.fromkeys(action.on for action in actions))
    displacements, rotations = [], []
    for place in places:
        displacements.append(np.asarray(model.displacement(place) @ q))
        try:
            rotations.append(np.asarray(model.motion(place)[3:] @ q))
        except InputError:  # points and lines of a solid have no rotation
            rotations.append(np.zeros((3, q.shape[1])))
    return Places(
        tuple(place if isinstance(place, str) else f"at {place:g} m" for place in places),
        np.array([model.centroid(place) for place in places]),
        np.array(displacements),
        np.array(rotations),
    )


#: Distance between two points, over their distance from the origin, up to which they belong to one frame.
APART = 1e-9
#: Lowest omega^2 over the square of the reference frequency, below which a body is not held.
FREE = 1e-8


@dataclass(frozen=True)
class _HeldModel:
    """Full model with sliders held at one place.

    K of the full model contains the stiffness of the springs that hold it; `rows` are the rigid rows at this place.
    """

    full: FullModel
    rows: tuple[Row, ...]


def framed_body(scene: Scene, s: float, count: int) -> FramedBody:
    """Body of a scene with its sliders held at s (m): its frames, and `count` elastic modes with all frames held.

    The first frame is on the ground; the others are at the points of loads and at the tip.  Only to be called in a
    run on a single MPI rank.

    Raises
    ------
    InputError
        If the body moves in a plane, nothing holds it, a row only pushes, s is outside the path, or a frame's point has
        no rotation or is held.
    ConvergenceError
        If the body has fewer than `count` modes, or these do not converge.
    """
    built, solver = build_at(scene, s), scene.reduction.solver
    model, coupling, held = built.structure.model, couple(built.structure), _hold_body(built, s)
    if model.directions != DIRECTIONS:
        raise InputError("scene", "body.model", scene.body.model, "a body in space is allowed where frames turn")
    places = _named_places(scene, model)
    measured = sp.vstack([model.motion(place) for place in places], format="csr")
    G, R = sp.csr_matrix(measured @ coupling.T), model.rigid_motions()
    Psi = _static_response(held, G, solver)
    frames = [fixed_row(f"frame {k // 6} {DIRECTIONS[k % 6]}", G[k], held.full.rows.domain) for k in range(G.shape[0])]
    still = replace(held.full, rows=Rows((*held.rows, *frames), held.full.size))
    modes = eigensolver(still, solver).lowest(s, count)
    modes.warn_if_cut(s)
    Phi = modes.phi
    w = np.hstack([-Psi @ (measured @ R), Psi, Phi])
    with_rigid, of_model = w.copy(), coupling.T @ w
    with_rigid[:, :6] += coupling.rigid
    of_model[:, :6] += R
    mass = gather(operators_of(model, MPI.COMM_SELF).M)
    assert mass is not None
    body = FramedBody(
        s=s,
        frames=Frames(
            ("ground", *(place if isinstance(place, str) else f"at {place:g} m" for place in places)),
            np.array([np.zeros(3), *(model.centroid(place) for place in places)]),
        ),
        M=symmetric_part(of_model.T @ (mass @ of_model) + with_rigid.T @ (coupling.attached_mass() @ with_rigid)),
        C=symmetric_part(w.T @ times(built.model.D, w)),
        K=symmetric_part(w.T @ times(held.full.K, w)),
    )
    lowest = scipy.linalg.eigh(body.K[6:, 6:], body.M[6:, 6:], eigvals_only=True, subset_by_index=[0, 0])[0]
    if lowest < FREE * held.full.reference_frequency**2:
        raise _not_held_error()
    return body


def _hold_body(built: AssembledBody, s: float) -> _HeldModel:
    """Full model of `built` with its sliders held at s (m); `built` is not changed.

    Rows that give way become springs in its stiffness; the others become its rows, which don't depend on s.
    """
    full, C = built.model, built.model.rows.at(s)
    soft = np.flatnonzero(full.row_compliance)
    springs = C[soft].T @ sp.diags(1.0 / full.row_compliance[soft]) @ C[soft]
    K, more = full.K.copy(), sparse(sp.csr_matrix(springs), full.K, columns=full.size)
    K.axpy(1.0, more, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    free_objects(more)
    rigid = np.flatnonzero(full.row_compliance == 0.0)
    rows = tuple(fixed_row(full.row_names[k], C[k], full.rows.domain) for k in rigid)
    return _HeldModel(replace(full, K=K), rows)


def _static_response(model: _HeldModel, G: sp.csr_matrix, solver: str) -> Array:
    r"""Static displacements Psi (n, 6 F) of a held body by unit motions of F frames, one at a time.

    The rows of G (6 F, n) are the motions of F frames in terms of the body's coordinates:

    .. math:: \Psi = K^{-1} G^T (G K^{-1} G^T)^{-1}

    K is factorised by the direct solver `solver`.  Raises InputError if the body is not held, or if a frame is at a
    clamped place.
    """
    try:
        static = static_solver(model.full, model.rows, solver)
    except SingularError:
        raise _not_held_error() from None
    X = static.solve(G.T.toarray(order="F"))
    static.destroy()
    scale = np.sqrt(np.maximum((G @ X).diagonal(), np.finfo(float).tiny))
    try:
        return np.asarray(scipy.linalg.solve((G @ X) / np.outer(scale, scale), (X / scale).T, assume_a="pos").T / scale)
    except np.linalg.LinAlgError:
        allowed = "places that move, each by itself, are allowed for frames: a clamped one does not"
        raise InputError("scene", "loads.on", None, allowed) from None


def _not_held_error() -> InputError:
    """InputError which says that supports and pads do not hold the body."""
    allowed = "pads and supports that hold the body at s in all directions are allowed: they join it to the first frame"
    return InputError("scene", "supports", None, allowed)


def _named_places(scene: Scene, model: StructuralModel) -> list[str | float]:
    """Places (names or distances in m) where loads act, and the tip; of places that coincide only the first."""
    points: dict[str | float, Array] = {}
    for place in (*(load.on for load in scene.loads), scene.observe.tip):
        point = model.centroid(place)
        if all(np.linalg.norm(point - other) > APART * np.linalg.norm(point) for other in points.values()):
            points[place] = point
    return list(points)
