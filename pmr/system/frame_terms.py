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
    """Those of a scene whose frame asks for second order, none otherwise; or `which` of them."""
    return tuple(_term(scene, one, bodies) for one in (frame_terms(scene) if which is None else which))


def _term(scene: Scene, one: FrameTerm, bodies: Mapping[str, SlidingBody]) -> Term:
    if one.of in ("cylinder", "cylinder load"):
        apart = sp.csr_matrix(_apart(scene, one, bodies))
        mass = carried(bodies[one.carried], one.component) if one.of == "cylinder" else 1.0
        moved = {name: mass * (_moved(scene, one, bodies, name).T @ apart) for name in one.bodies}
        supports = {name: A for name, A in moved.items() if A.size}
        return Term(one.name, one.bodies, stiffness=mass * (apart.T @ apart), supports=supports)
    (name,) = one.bodies
    matrix = bodies[name].matrices.get(one.matrix, sp.csr_matrix((bodies[name].size,) * 2))
    known = bodies[name].reactions
    on = None if known is None else known.matrices.get(one.matrix)
    supports = {} if on is None else {name: on[:, : bodies[name].size]}
    if one.of == "rotation":
        return Term(one.name, one.bodies, damping=_of_inertia(bodies[name], matrix), supports=supports)
    return Term(one.name, one.bodies, stiffness=matrix, supports=supports)


def _of_inertia(body: SlidingBody, matrix: Any) -> Any:
    """A matrix that acts on rates (n, n), zero on coordinates without inertia."""
    if not len(body.quasi_static):
        return matrix
    found = np.array(matrix.toarray() if sp.issparse(matrix) else matrix)
    found[body.quasi_static] = found[:, body.quasi_static] = 0.0
    return found


def _moved(scene: Scene, one: FrameTerm, bodies: Mapping[str, SlidingBody], name: str) -> Array:
    """What motions of the rigid supports of a body with that name do to the distance of `_apart`, (d, h)."""
    known, sign = bodies[name].reactions, 1.0 if name == one.bodies[0] else -1.0
    rows = tails(member_at(scene, one.number))
    if known is None or not known.ports:
        return np.zeros((len(rows), 0))
    nothing = np.zeros(len(known.names))
    return np.array([sign * known.ports.get(row, nothing) for row in rows])


def _apart(scene: Scene, one: FrameTerm, bodies: Mapping[str, SlidingBody]) -> Array:
    """Rows (d, n) that measure how far the tails of two sections are apart across the boom, from both's coordinates."""
    found = []
    for row in tails(member_at(scene, one.number)):
        parts = []
        for sign, name in zip((1.0, -1.0), one.bodies, strict=True):
            body = bodies[name]
            known = body.ports.get(row)  # none of a tail that is clamped
            parts.append(np.zeros(body.size) if known is None else sign * np.asarray(sp.csr_matrix(known).toarray())[0])
        found.append(np.concatenate(parts))
    return np.array(found)


def carried(body: SlidingBody, field: str, axis: str = "x") -> float:
    """Mass in kg of a section and what is attached to it, or its first moment about its tail in kg m.

    It is what accelerates it along the `axis`, all of which is free to move.
    """
    along, over = (np.asarray(body.B)[:, body.input_names.index(INERTIA + one)] for one in (axis, field))
    return float(along @ spla.spsolve(sp.csc_matrix(body.M), over))
