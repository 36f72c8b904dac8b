r"""A scene's body held at a place of its sliders, in coordinates of frames: Craig and Bampton's reduction.

Everything that holds the body at s is attached to a frame of its own, the ground.  With its motion u_g, the motions u
of the other frames, which G measures on the body, rigid motions R and those of the frames R_f, the body moves by

.. math::
    q = R u_g + w, \qquad w = \Psi (u - R_f u_g) + \Phi \eta, \qquad
    \Psi = K^{-1} G^T (G K^{-1} G^T)^{-1}

Psi is what w, on its pads and supports, does statically under forces on the frames; Phi are the lowest modes with all
frames held.  Craig and Bampton: Coupling of substructures for dynamic analyses, AIAA Journal 6, 1968, pp. 1313-1319.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.constraints.rows import Row, Rows, fixed_row
from pmr.errors import InputError
from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import free_objects, sparse, times
from pmr.fem.matrices import gather
from pmr.fields.held import FramedBody, Frames
from pmr.fullmodel.assembly import operators_of
from pmr.fullmodel.build import Built
from pmr.fullmodel.eigensolvers import eigensolver
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.statics import SingularError, static_solver
from pmr.fullmodel.structure import couple
from pmr.models import DIRECTIONS, StructuralModel
from pmr.reduction.recover.nodal import built_at
from pmr.scene import Scene
from pmr.system.body import symmetric

Array = NDArray[np.float64]

#: Places that are nearer to each other than this share of their distance from the origin are one frame.
APART = 1e-9
#: A body whose lowest omega^2 is less than this share of what is expected of it is not held.
FREE = 1e-8


@dataclass(frozen=True)
class _Held:
    """A model with its sliders at s: its springs are in K, its rigid rows no longer move."""

    full: FullModel
    rows: tuple[Row, ...]


def framed_body(scene: Scene, s: float, count: int) -> FramedBody:
    """The body with its sliders at s (m): frames where loads act and at the tip, `count` modes; on one rank.

    Raises
    ------
    InputError
        If the body moves in a plane, nothing holds it, a row only pushes, s lies off the path, or a place has no
        rotation or moves with what is held.
    ConvergenceError
        If the modes do not converge.
    """
    built, solver = built_at(scene, s), scene.reduction.solver
    model, coupling, held = built.structure.model, couple(built.structure), _hold_body(built, s)
    if model.directions != DIRECTIONS:
        raise InputError("scene", "body.model", scene.body.model, "a body in space is allowed where frames turn")
    places = _places(scene, model)
    measured = sp.vstack([model.motion(place) for place in places], format="csr")
    G, R = sp.csr_matrix(measured @ coupling.T), model.rigid_motions()
    Psi = _static(held, G, solver)
    frames = [fixed_row(f"frame {k // 6} {DIRECTIONS[k % 6]}", G[k], held.full.rows.domain) for k in range(G.shape[0])]
    still = replace(held.full, rows=Rows((*held.rows, *frames), held.full.size))
    Phi = eigensolver(still, solver).lowest(s, count).phi
    w = np.hstack([-Psi @ (measured @ R), Psi, Phi])
    with_rigid, of_model = w.copy(), coupling.T @ w
    with_rigid[:, :6] += coupling.rigid
    of_model[:, :6] += R
    mass = gather(operators_of(model, MPI.COMM_SELF).M)
    assert mass is not None and built.model.rayleigh is not None
    damped = (w.T @ times(A, w) for A in (built.model.M, built.model.K))
    body = FramedBody(
        s=s,
        places=Frames(
            ("ground", *(place if isinstance(place, str) else f"at {place:g} m" for place in places)),
            np.array([np.zeros(3), *(model.centroid(place) for place in places)]),
        ),
        M=symmetric(of_model.T @ (mass @ of_model) + with_rigid.T @ (coupling.attached_mass() @ with_rigid)),
        C=symmetric(built.model.rayleigh.of(*damped)),
        K=symmetric(w.T @ times(held.full.K, w)),
    )
    lowest = scipy.linalg.eigh(body.K[6:, 6:], body.M[6:, 6:], eigvals_only=True, subset_by_index=[0, 0])[0]
    if lowest < FREE * held.full.reference_frequency**2:
        raise _not_held()
    return body


def _hold_body(built: Built, s: float) -> _Held:
    full, C = built.model, built.model.rows.at(s)
    soft = np.flatnonzero(full.row_compliance)
    springs = C[soft].T @ sp.diags(1.0 / full.row_compliance[soft]) @ C[soft]
    K, more = full.K.copy(), sparse(sp.csr_matrix(springs), full.K, columns=full.size)
    K.axpy(1.0, more, structure=PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    free_objects(more)
    rigid = np.flatnonzero(full.row_compliance == 0.0)
    rows = tuple(fixed_row(full.row_names[k], C[k], full.rows.domain) for k in rigid)
    return _Held(replace(full, K=K), rows)


def _static(held: _Held, G: sp.csr_matrix, solver: str) -> Array:
    """Psi (n, 6 F)."""
    try:
        static = static_solver(held.full, held.rows, solver)
    except SingularError:
        raise _not_held() from None
    X = static.solve(G.T.toarray(order="F"))
    static.destroy()
    scale = np.sqrt(np.maximum((G @ X).diagonal(), np.finfo(float).tiny))
    try:
        return np.asarray(scipy.linalg.solve((G @ X) / np.outer(scale, scale), (X / scale).T, assume_a="pos").T / scale)
    except np.linalg.LinAlgError:
        allowed = "places that move, each by itself, are allowed for frames: a clamped one does not"
        raise InputError("scene", "loads.on", None, allowed) from None


def _not_held() -> InputError:
    allowed = "pads and supports that hold the body at s in all directions are allowed: they join it to the first frame"
    return InputError("scene", "supports", None, allowed)


def _places(scene: Scene, model: StructuralModel) -> list[str | float]:
    """Places where loads act and the tip, each point once."""
    points: dict[str | float, Array] = {}
    for place in (*(load.on for load in scene.loads), scene.observe.tip):
        point = model.centroid(place)
        if all(np.linalg.norm(point - other) > APART * np.linalg.norm(point) for other in points.values()):
            points[place] = point
    return list(points)
