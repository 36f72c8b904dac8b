"""Terms of a frame that moves: matrices of a scene's bodies, by the names that their signals have."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from pmr.scene import Scene
from pmr.scene.frame import INERTIA
from pmr.scene.frame_terms import FrameTerm, frame_terms, tails
from pmr.scene.members import member_at
from pmr.system.body import SlidingBody
from pmr.system.terms import Term

Array = NDArray[np.float64]


def terms_of(
    scene: Scene, bodies: Mapping[str, SlidingBody], which: Iterable[FrameTerm] | None = None
) -> tuple[Term, ...]:
    """Terms of a scene whose frame asks for second order, none otherwise; or the `which` of them."""
    return tuple(_term(scene, term, bodies) for term in (frame_terms(scene) if which is None else which))


def _term(scene: Scene, term: FrameTerm, bodies: Mapping[str, SlidingBody]) -> Term:
    if term.of in ("cylinder", "cylinder load"):
        apart = sp.csr_matrix(_distance_rows(scene, term, bodies))
        mass = carried_inertia(bodies[term.carried], term.component) if term.of == "cylinder" else 1.0
        support_parts = {name: mass * (_distance_change(scene, term, bodies, name).T @ apart) for name in term.bodies}
        supports = {name: A for name, A in support_parts.items() if A.size}
        return Term(term.name, term.bodies, stiffness=mass * (apart.T @ apart), supports=supports)
    (name,) = term.bodies
    matrix = bodies[name].matrices.get(term.matrix, sp.csr_matrix((bodies[name].size,) * 2))
    reactions = bodies[name].reactions
    on = None if reactions is None else reactions.matrices.get(term.matrix)
    supports = {} if on is None else {name: on[:, : bodies[name].size]}
    if term.of == "rotation":
        return Term(term.name, term.bodies, damping=_of_inertia(bodies[name], matrix), supports=supports)
    return Term(term.name, term.bodies, stiffness=matrix, supports=supports)


def _of_inertia(body: SlidingBody, matrix: Any) -> Any:
    """A matrix that acts on rates (n, n), zero on coordinates without inertia."""
    if not len(body.quasi_static):
        return matrix
    on_inertia = np.array(matrix.toarray() if sp.issparse(matrix) else matrix)
    on_inertia[body.quasi_static] = on_inertia[:, body.quasi_static] = 0.0
    return on_inertia


def _distance_change(scene: Scene, term: FrameTerm, bodies: Mapping[str, SlidingBody], name: str) -> Array:
    """Change of the distance of `_distance_rows` by motions of the rigid supports of a body with that name, (d, h)."""
    reactions, sign = bodies[name].reactions, 1.0 if name == term.bodies[0] else -1.0
    rows = tails(member_at(scene, term.number))
    if reactions is None or not reactions.ports:
        return np.zeros((len(rows), 0))
    nothing = np.zeros(len(reactions.names))
    return np.array([sign * reactions.ports.get(row, nothing) for row in rows])


def _distance_rows(scene: Scene, term: FrameTerm, bodies: Mapping[str, SlidingBody]) -> Array:
    """Rows (d, n) that measure how far the tails of two sections are apart across the boom, from both's coordinates."""
    distance_rows = []
    for row in tails(member_at(scene, term.number)):
        parts = []
        for sign, name in zip((1.0, -1.0), term.bodies, strict=True):
            body = bodies[name]
            port = body.ports.get(row)  # none of a tail that is clamped
            parts.append(np.zeros(body.size) if port is None else sign * np.asarray(sp.csr_matrix(port).toarray())[0])
        distance_rows.append(np.concatenate(parts))
    return np.array(distance_rows)


def carried_inertia(body: SlidingBody, field: str, axis: str = "x") -> float:
    """Mass in kg of a section and what is attached to it, or its first moment about its tail in kg m.

    It is what accelerates it along the `axis`, all of which is free to move.
    """
    along, over = (
        np.asarray(body.B)[:, body.input_names.index(INERTIA + inertia_axis)] for inertia_axis in (axis, field)
    )
    return float(along @ spla.spsolve(sp.csc_matrix(body.M), over))
