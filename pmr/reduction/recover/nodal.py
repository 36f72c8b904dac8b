"""A scene's body held at a place of its sliders, on nodes with three displacements each."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.fem.compat import MPI
from pmr.fem.distributed import times
from pmr.fem.matrices import gather
from pmr.fields.held import NodalBody, Places
from pmr.fullmodel.assembly import operators_of
from pmr.fullmodel.build import Built, build
from pmr.fullmodel.eigensolvers import eigensolver
from pmr.fullmodel.pads import restrain
from pmr.fullmodel.structure import Action, Structure, couple
from pmr.models import StructuralModel, is_assembled
from pmr.models.matrices import Matrices
from pmr.scene import Scene
from pmr.system.body import symmetric

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def held_body(scene: Scene, s: float, count: int) -> NodalBody:
    """The body of a scene with its sliders at s (m), and its lowest modes there; on one rank.

    Raises
    ------
    InputError
        If nodes have other coordinates than three displacements, there are masses, which the other program attaches by
        itself, or rows that only push, or s lies off the path.
    """
    if scene.masses:
        allowed = "none is allowed: a flexible body is what they are attached to, in the program that reads it"
        raise InputError("scene", "masses", scene.masses[0].name, allowed)
    built = built_at(scene, s)
    structure, full = built.structure, built.model
    model, T = structure.model, couple(structure).T
    order = nodes_of(model).ravel()
    modes = eigensolver(full, scene.reduction.solver).lowest(s, count)
    q = np.asarray(T @ modes.phi)
    operators = operators_of(model, MPI.COMM_SELF)
    M, K = gather(operators.M), gather(operators.K)
    assert M is not None and K is not None
    K = sp.csr_matrix(K + _springs(structure, s))
    R = model.rigid_motions()[order].reshape(-1, 3, 6)
    assert full.rayleigh is not None
    projected = (modes.phi.T @ times(A, modes.phi) for A in (full.M, full.K))
    return NodalBody(
        s=s,
        points=np.stack([R[:, 1, 5], R[:, 2, 3], R[:, 0, 4]], axis=1),  # e_z x r, e_x x r and e_y x r have x, y and z
        M=sp.csr_matrix(M[order][:, order]),
        K=sp.csr_matrix(K[order][:, order]),
        modes=q[order],
        omega=modes.omega,
        damping=symmetric(full.rayleigh.of(*projected)),
        places=_places(structure, q),
    )


def built_at(scene: Scene, s: float) -> Built:
    """The full model of a scene on one rank, to be held with its sliders at s (m).

    Raises
    ------
    InputError
        If s lies off the path, or a row only pushes.
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
    """Numbers (N, 3) of the coordinates along x, y and z of each node.

    Raises
    ------
    InputError
        If a node has others.
    """
    if is_assembled(model):
        from pmr.models.solid import Solid  # its forms need FEniCSx, which given matrices do without

        if isinstance(model, Solid):
            of_cells = model.element_coordinates(np.arange(len(model.mesh.cells)))
            return np.unique(np.column_stack([part.ravel() for part in of_cells]), axis=0)
    if isinstance(model, Matrices):
        matrices = model.given
        order = np.lexsort((matrices.direction, matrices.node))
        if np.array_equal(matrices.direction[order], np.tile(np.arange(3), len(matrices.points))):
            return np.asarray(order.reshape(-1, 3), dtype=np.int64)
    allowed = "a solid, or matrices with three displacements at each node, are allowed in a flexible-body file"
    raise InputError("scene", "body.model", None, allowed)


def _springs(structure: Structure, s: float) -> sp.csr_matrix:
    """Sum of c^T c / compliance of all that gives way, on the model's coordinates."""
    size = structure.model.size
    restraints = restrain(structure.pads, structure.model, sp.eye(size, format="csr"))
    K = restraints.stiffness(size)
    for row in restraints.rows:
        if row.compliance > 0.0:
            c = row.at(s)
            K = K + c.T @ c / row.compliance
    return sp.csr_matrix(K)


def _places(structure: Structure, q: Array) -> Places:
    """Places where loads act and motions are observed."""
    model = structure.model
    actions = [action for action in (*structure.loads, *structure.outputs) if isinstance(action, Action)]
    places = list(dict.fromkeys(action.on for action in actions))
    displacements, rotations = [], []
    for place in places:
        displacements.append(np.asarray(model.displacement(place) @ q))
        try:
            rotations.append(np.asarray(model.motion(place)[3:] @ q))
        except InputError:  # a point or a line of a solid has no rotation
            rotations.append(np.zeros((3, q.shape[1])))
    return Places(
        tuple(place if isinstance(place, str) else f"at {place:g} m" for place in places),
        np.array([model.centroid(place) for place in places]),
        np.array(displacements),
        np.array(rotations),
    )
