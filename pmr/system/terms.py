r"""Terms of the equations of motion that vary in time: constant matrices times scalar signals.

.. math::
    M \ddot q + D \dot q + K q + \sum_k c_k(t) \, (V_k \dot q + G_k q) + C^T \lambda = B f

The geometric stiffness of an axial force N(t) is one, with G of a unit force and c = N; so are the gyroscopic forces
of a frame that turns, with an antisymmetric V of a unit angular velocity.  The signals c_k stand in an excitation
(`pmr.simulation.excitation.Excitation.terms`), by the terms' names.

Terms of a frame that moves: matrices of a scene's bodies, by the names that their signals have.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.scene import Scene
from pmr.scene.frame import INERTIA
from pmr.scene.mechanism import FrameTerm, frame_terms, tails
from pmr.scene.members import member_at
from pmr.system.body import SlidingBody

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Term:
    """Forces -c(t) (V q' + G q) on one body or on two, on whose stacked coordinates q (n,) the matrices act.

    An InputError is raised where it has no matrix, or not one or two bodies.
    """

    name: str
    bodies: tuple[str, ...]  # names of one body, or of two that differ
    # G (n, n) in N/m and V (n, n) in N s/m, of c = 1: dense of reduced bodies, SciPy's sparse ones of full bodies,
    # PETSc's of a distributed body
    stiffness: Any = None
    damping: Any = None
    # Phi^T G, or of a damping Phi^T V, (h, n): by the name of a body, the work on motions of its rigid supports
    # (`pmr.reduced.matrices`)
    supports: Mapping[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 1 <= len(set(self.bodies)) == len(self.bodies) <= 2:
            raise term_refusal(self.name, "bodies", ", ".join(self.bodies), "one body or two that differ are allowed")
        if not self.matrices:
            raise term_refusal(self.name, "stiffness", None, "a stiffness, a damping or both are allowed")

    @property
    def matrices(self) -> dict[str, Any]:
        """Matrices of the term, by the names of their fields."""
        fields = {"stiffness": self.stiffness, "damping": self.damping}
        return {key: matrix for key, matrix in fields.items() if matrix is not None}

    @property
    def arrays(self) -> dict[str, Array]:
        """Matrices of reduced bodies, dense."""
        return {key: np.asarray(A.toarray() if sp.issparse(A) else A) for key, A in self.matrices.items()}

    def check(self, size: int) -> None:
        """Raise an InputError unless its matrices are finite and of bodies with so many coordinates in all."""
        for key, matrix in self.matrices.items():
            if matrix.shape != (size, size):
                raise term_refusal(self.name, key, matrix.shape, f"{(size, size)} is allowed")
            if not np.isfinite(matrix.data if sp.issparse(matrix) else matrix).all():
                raise term_refusal(self.name, key, None, "finite numbers are allowed")

    def on(self, motions: Mapping[str, Array]) -> Term:
        """Term on other coordinates p of its bodies, q = V p with V (n, r) by the bodies' names; dense."""
        V = sp.block_diag([sp.csr_matrix(motions[name]) for name in self.bodies], format="csr")
        projected: dict[str, Any] = {key: (V.T @ (sp.csr_matrix(A) @ V)).toarray() for key, A in self.matrices.items()}
        return replace(self, **projected, supports={})

    def among(self, numbers: Mapping[str, Sequence[int] | NDArray[np.int64]], size: int) -> Term:
        """Among `size` coordinates, where those of a body with number 0 or more stand; others are left out; sparse."""
        at = np.concatenate([np.asarray(numbers[name], np.int64) for name in self.bodies])
        scattered = dict[str, Any]()
        for key, A in self.matrices.items():
            entries = sp.coo_matrix(A)
            places = at[entries.row], at[entries.col]
            is_kept = np.minimum(*places) >= 0
            scattered[key] = sp.csr_matrix(
                (entries.data[is_kept], tuple(places_of_axis[is_kept] for places_of_axis in places)), shape=(size, size)
            )
        return replace(self, **scattered, supports={})


def add_terms(A: sp.csr_matrix, terms: Sequence[Term], key: str, c: Sequence[float] | Array) -> sp.csr_matrix:
    """A + sum_k c_k of the terms' ``stiffness`` or ``damping``, all sparse and of one size; no amplitudes leave A.

    All in one sum, as one by one what SciPy does for each takes longer than the sum.
    """
    each = [(c_k, getattr(term, key)) for term, c_k in zip(terms, c, strict=len(c) > 0)]
    parts = [(1.0, A.tocoo()), *((c_k, part.tocoo()) for c_k, part in each if part is not None and c_k != 0.0)]
    if len(parts) == 1:
        return A
    entries = np.concatenate([c_k * part.data for c_k, part in parts])
    places = tuple(np.concatenate([getattr(part, side) for _, part in parts]) for side in ("row", "col"))
    total = sp.csr_matrix((entries, places), shape=A.shape)
    total.eliminate_zeros()
    return total


def term_refusal(term: str, key: str, value: object, allowed: str) -> InputError:
    """Error about a term, by its name."""
    return InputError("system", f"terms.{term}.{key}", value, allowed)


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


def carried_inertia(body: SlidingBody, field: str) -> float:
    """Mass in kg of a section and what is attached to it, or its first moment about its tail in kg m.

    It is what accelerates it along the boom, where all of it is free to move.
    """
    along, over = (np.asarray(body.B)[:, body.input_names.index(INERTIA + name)] for name in ("x", field))
    return float(along @ spla.spsolve(sp.csc_matrix(body.M), over))
