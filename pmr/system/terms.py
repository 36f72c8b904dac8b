r"""Terms of the equations of motion besides bodies and contacts: matrices times signals in time, and a hoist's rope.

A term that varies in time is a constant matrix times a scalar signal:

.. math::
    M \ddot q + D \dot q + K q + \sum_k c_k(t) \, (V_k \dot q + G_k q) + C^T \lambda = B f

The amplitudes c_k(t) multiply the damping V_k and the stiffness G_k of term k.  The geometric stiffness of an axial
force N(t) is such a term, with the matrix G of a unit force and c = N.  So are the gyroscopic forces of a turning
frame, with the antisymmetric matrix V of a unit angular velocity.  An excitation has the signals c_k by the terms'
names (`pmr.simulation.excitation.Excitation.terms`).

`terms_of` makes the terms of a scene whose frame moves; signal and term have the same name.

The rope of a hoist acts on bodies too: `Hoist` says which inputs it pulls, and what it is driven by
(pmr/kernel/src/hoist.c has the equations).  Its drivers are the length of the rope or the speed of the winch, and the
wind on the payload.  In a frame that moves they are followed by gravity, accelerations of the pivot if it has any, and
the entries of the rotation R from axes of the boom into those of the ground; then, if the winch is on the machine, the
parts along x and z of the boom of the direction that is up for the machine (`RAISED`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from pmr.errors import InputError
from pmr.files.arrays import Array, Indices
from pmr.scene import Scene
from pmr.scene.built import WEIGHT
from pmr.scene.choice import rope_pulls
from pmr.scene.files import stored_scene
from pmr.scene.frame import INERTIA
from pmr.scene.frame_checks import distance_along, rope_places, still_rotation
from pmr.scene.hoist import HOIST, OUTPUTS, ROPE, WIND
from pmr.scene.keys import RECORDED, input_name
from pmr.scene.mechanism import FrameTerm, frame_terms, tail_outputs
from pmr.scene.members import member_at, members
from pmr.system.body import SlidingBody

#: Drivers of a hoist that are the parts along x and z of the boom of the direction that is up for the machine.
RAISED = (f"{HOIST}raised x", f"{HOIST}raised z")


@dataclass(frozen=True)
class Term:
    """Forces -c(t) (V q' + G q) on one or two bodies; q (n,) are the bodies' coordinates, stacked as in `bodies`.

    An InputError is raised if the term has no matrix, or if its bodies are not one body or two different ones.
    """

    name: str
    bodies: tuple[str, ...]  # names of one body, or of two different bodies
    # G (n, n) in N/m and V (n, n) in N s/m for c = 1: arrays for reduced bodies, sparse matrices of SciPy for full
    # bodies, and matrices of PETSc for a distributed body
    stiffness: Any = None
    damping: Any = None
    # by the name of a body: work (h, n) on unit motions Phi of its h rigid supports (`pmr.system.body_matrices`), Phi^T
    # G of a stiffness or Phi^T V of a damping
    supports: Mapping[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not 1 <= len(set(self.bodies)) == len(self.bodies) <= 2:
            raise term_error(self.name, "bodies", ", ".join(self.bodies), "one body or two that differ are allowed")
        if not self.matrices:
            raise term_error(self.name, "stiffness", None, "a stiffness, a damping or both are allowed")

    @property
    def matrices(self) -> dict[str, Any]:
        """Matrices of the term, by the names of their fields: ``stiffness`` G, ``damping`` V or both."""
        fields = {"stiffness": self.stiffness, "damping": self.damping}
        return {key: matrix for key, matrix in fields.items() if matrix is not None}

    @property
    def arrays(self) -> dict[str, Array]:
        """Matrices (n, n) of the term on n coordinates of its reduced bodies, as dense arrays, by the fields' names."""
        return {key: np.asarray(A.toarray() if sp.issparse(A) else A) for key, A in self.matrices.items()}

    def check(self, size: int) -> None:
        """Raise an InputError unless the matrices have the shape (size, size) and are finite."""
        for key, matrix in self.matrices.items():
            if matrix.shape != (size, size):
                raise term_error(self.name, key, matrix.shape, f"{(size, size)} is allowed")
            if not np.isfinite(matrix.data if sp.issparse(matrix) else matrix).all():
                raise term_error(self.name, key, None, "finite numbers are allowed")

    def project(self, motions: Mapping[str, Array]) -> Term:
        """Return the term with dense matrices on new coordinates p of its bodies, without its work on supports.

        `motions` maps each body's name to V (n, r), with which the old coordinates are q = V p.
        """
        V = scipy.linalg.block_diag(*(motions[name] for name in self.bodies))
        projected: dict[str, Any] = {key: np.asarray(V.T @ (A @ V)) for key, A in self.matrices.items()}
        return replace(self, **projected, supports={})

    def scatter(self, numbers: Mapping[str, Sequence[int] | Indices], size: int) -> Term:
        """Return the term with sparse matrices (size, size) on the coordinates of a system.

        `numbers` maps a body's name to the system's number of each of the body's coordinates; coordinates with a
        negative number are left out.  The returned term has no `supports`.
        """
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


class TermSum:
    """Sum A + sum_k c_k A_k of sparse matrices (n, n) for any amplitudes c_k of terms k.

    A_k is the stiffness or damping of term k, zero if the term has none.  The entries of all matrices are stored in one
    array, because adding SciPy's matrices would take far longer.
    """

    def __init__(self, A: sp.csr_matrix, terms: Sequence[Term], key: str) -> None:
        """Store A (n, n) and the matrices of the `terms` that `key` names, ``stiffness`` or ``damping``."""
        self._A, n = A, A.shape[0]
        matrices = [getattr(term, key) for term in terms]
        self._has_matrix = np.array([matrix is not None for matrix in matrices], bool)
        parts = [matrix.tocoo() for matrix in (A, *matrices) if matrix is not None]
        numbers = [part.row.astype(np.int64) * n + part.col for part in parts]
        places = np.unique(np.concatenate(numbers))
        self._entries = np.zeros((len(parts), len(places)))  # of A, then of each term that has a matrix
        for entries, part, number in zip(self._entries, parts, numbers, strict=True):
            np.add.at(entries, np.searchsorted(places, number), part.data)
        self._indices, self._indptr = places % n, np.searchsorted(places, n * np.arange(n + 1))

    def matrix(self, c: Sequence[float] | Array) -> sp.csr_matrix:
        """Matrix A + sum_k c_k A_k (n, n); A itself if the amplitudes c (k,) are empty or zero."""
        return self._sum(1.0, c) if np.any(c) else self._A

    def of_terms(self, c: Sequence[float] | Array) -> sp.csr_matrix:
        """Matrix sum_k c_k A_k (n, n) without A, with amplitudes c (k,)."""
        return self._sum(0.0, c)

    def _sum(self, share: float, c: Sequence[float] | Array) -> sp.csr_matrix:
        """Matrix `share` A + sum_k c_k A_k (n, n), without stored zeros."""
        entries = np.array([share, *np.asarray(c)[self._has_matrix]]) @ self._entries
        total = sp.csr_matrix((entries, self._indices, self._indptr), shape=self._A.shape, copy=True)
        total.eliminate_zeros()
        return total


def term_error(term: str, key: str, value: object, allowed: str) -> InputError:
    """InputError about the `value` of the property `key` of the term with the name `term`.

    `allowed` says what is allowed.
    """
    return InputError("system", f"terms.{term}.{key}", value, allowed)


def terms_of(
    scene: Scene, bodies: Mapping[str, SlidingBody], which: Iterable[FrameTerm] | None = None
) -> tuple[Term, ...]:
    """Terms of a scene with matrices from the models of its bodies, which `bodies` has by name.

    `which` are the terms to make.  None stands for all terms of the scene: those of a moving frame with second order.
    A scene without a frame, or with a frame of first order, has no terms.
    """
    return tuple(_build_term(scene, term, bodies) for term in (frame_terms(scene) if which is None else which))


def _build_term(scene: Scene, term: FrameTerm, bodies: Mapping[str, SlidingBody]) -> Term:
    """Build the term of the equations for one frame term, with its work on the motions of rigid supports.

    `bodies` are all bodies by name.  Terms of cylinders join two sections.  Such a term has the stiffness m D^T D: D
    (d, n) gives the lateral distances between the two tails, m is the mass or first moment that the cylinder carries,
    or 1 for a cylinder's load.  All other terms have a matrix of one body as their stiffness, or, for a rotation, as
    their damping.  Such a damping has zeros for coordinates without inertia.  A matrix that the body lacks is zero.
    """
    if term.kind in ("cylinder", "cylinder load"):
        apart = sp.csr_matrix(_distance_rows(scene, term, bodies))
        mass = carried_inertia(bodies[term.carried_section], term.component) if term.kind == "cylinder" else 1.0
        support_parts = {name: mass * (_distance_change(scene, term, bodies, name).T @ apart) for name in term.bodies}
        supports = {name: A for name, A in support_parts.items() if A.size}
        return Term(term.name, term.bodies, stiffness=mass * (apart.T @ apart), supports=supports)
    (name,) = term.bodies
    matrix = bodies[name].matrices.get(term.matrix, sp.csr_matrix((bodies[name].size,) * 2))
    reactions = bodies[name].reactions
    on = None if reactions is None else reactions.matrices.get(term.matrix)
    supports = {} if on is None else {name: on[:, : bodies[name].size]}
    if term.kind == "rotation":
        return Term(term.name, term.bodies, damping=_clear_without_inertia(bodies[name], matrix), supports=supports)
    return Term(term.name, term.bodies, stiffness=matrix, supports=supports)


def _clear_without_inertia(body: SlidingBody, matrix: sp.csr_matrix | Array) -> sp.csr_matrix | Array:
    """Return `matrix` (n, n) with zeros in the rows and columns of the body's coordinates without inertia.

    The result is a dense copy.  If all coordinates have inertia, it is `matrix` itself.
    """
    if not len(body.quasi_static):
        return matrix
    on_inertia = np.array(matrix if isinstance(matrix, np.ndarray) else matrix.toarray())
    on_inertia[body.quasi_static] = on_inertia[:, body.quasi_static] = 0.0
    return on_inertia


def _distance_change(scene: Scene, term: FrameTerm, bodies: Mapping[str, SlidingBody], name: str) -> Array:
    """Changes (d, h) of the d distances in `_distance_rows` if one of the h rigid supports of a body moves by 1.

    `term` joins two of the `bodies`, and `name` is the name of one of these two, whose supports move.  h is 0 if the
    supports' motions are not known.
    """
    reactions, sign = bodies[name].reactions, 1.0 if name == term.bodies[0] else -1.0
    rows = tail_outputs(member_at(scene, term.number))
    if reactions is None or not reactions.ports:
        return np.zeros((len(rows), 0))
    nothing = np.zeros(len(reactions.names))
    return np.array([sign * reactions.ports.get(row, nothing) for row in rows])


def _distance_rows(scene: Scene, term: FrameTerm, bodies: Mapping[str, SlidingBody]) -> Array:
    """Rows (d, n) of the lateral distances between the tails of the two sections that `term` joins.

    The d distances are those along the lateral directions of the model, the first section's displacement minus the
    second's.  The n coordinates are those of the first section, then those of the second.  A tail that is clamped adds
    zeros.  `bodies` maps the names of all bodies to their models.
    """
    distance_rows = []
    for row in tail_outputs(member_at(scene, term.number)):
        parts = []
        for sign, name in zip((1.0, -1.0), term.bodies, strict=True):
            body = bodies[name]
            port = body.ports.get(row)  # a tail that is clamped has no port
            parts.append(np.zeros(body.size) if port is None else sign * np.asarray(sp.csr_matrix(port).toarray())[0])
        distance_rows.append(np.concatenate(parts))
    return np.array(distance_rows)


def carried_inertia(body: SlidingBody, field: str) -> float:
    """Inertia of a section, with what is attached to it, against an acceleration along the boom.

    For `field` "x" the result is the mass in kg, for other fields the first moment in kg m about the section's tail:
    e_x^T M a with the acceleration field a that `field` names (`pmr.system.body_matrices.LINEAR`).  The result is right
    if the whole body is free to move.
    """
    along, over = (np.asarray(body.B)[:, body.input_names.index(INERTIA + name)] for name in ("x", field))
    return float(along @ spla.spsolve(sp.csc_matrix(body.M), over))


class Slot(NamedTuple):
    """A number that the kernel asks for: a constant, plus a factor times the driver or input called `name`.

    With an empty `name` it is the constant alone.
    """

    constant: float = 0.0
    factor: float = 0.0
    name: str = ""


@dataclass(frozen=True)
class Hoist:
    """A hoist whose rope pulls k inputs of a system's bodies, as names and numbers that the kernel reads.

    Without arguments there is no hoist; as a truth value the object is then false.
    """

    inputs: tuple[str, ...] = ()  # (k,): names of the system's inputs
    # (k, 6): displacements of the head (3) and of the winch (3) along x, y, z of the boom, if the point of an input
    # moves by 1 m, or turns by 1 rad, in the input's direction
    levers: Array = field(default_factory=lambda: np.zeros((0, 6)))
    numbers: Array = field(default_factory=lambda: np.zeros(0))  # (19,), as `HOIST_MASS` and what follows it in hoist.c
    reach: tuple[tuple[str, ...], ...] = ()  # paths along which the head moves, and those along which the winch does
    drivers: tuple[str, ...] = ()  # names of its drivers, as the module's docstring lists them
    is_wound: bool = False  # whether the speed of the winch drives the rope, and not the rope's length
    slots: tuple[Slot, ...] = ()  # (19,), as `SLOT_LENGTH` and what follows it in hoist.c

    def __bool__(self) -> bool:
        return bool(self.drivers)

    @property
    def outputs(self) -> Mapping[str, str]:
        """Units of the hoist's outputs by their names; empty if the system has no hoist."""
        return OUTPUTS if self else {}

    def in_frame(self, scene: Scene) -> Hoist:
        """Return this hoist with the drivers that the frame of another `scene` of the same boom needs."""
        of_frame = frame_quantities(scene)
        slots = (*self.slots[: 1 + len(WIND)], *_ground_slots(scene, tuple(of_frame)))
        return replace(self, drivers=(ROPE, *WIND, *of_frame), slots=slots)


def frame_quantities(scene: Scene) -> dict[str, tuple[str | int, ...]]:
    """Quantities of a moving frame that drive a scene's hoist, by the drivers' names; empty without frame or hoist.

    A quantity is a tuple as `pmr.kernel.further.Quantity` lists them, such as ``("turned", 2, 0)``.
    """
    if scene.frame is None or scene.hoist is None:
        return {}
    quantities: dict[str, tuple[str | int, ...]] = {f"{HOIST}gravity": ("gravity",)}
    base = scene.frame.base
    if base is not None and {"x", "y", "z"} & {*base.motions, *base.accelerations}:
        quantities |= {f"{HOIST}shaken {axis}": ("shaken", k) for k, axis in enumerate("xyz")}
    quantities |= {f"{HOIST}turned {3 * i + j}": ("turned", i, j) for i in range(3) for j in range(3)}
    on_machine = not scene.hoist.winch.section
    return quantities | {name: ("raised", k) for name, k in zip(RAISED, (0, 2), strict=True) if on_machine}


def hoist_of(scene: Scene) -> Hoist:
    """Hoist of a scene's system; an empty one if the scene has none."""
    hoist = scene.hoist
    if hoist is None:
        return Hoist()
    pulls = [
        (input_name(scene.names[m.number], pull.load.name), pull) for m in members(scene) for pull in rope_pulls(m)
    ]
    levers = np.zeros((len(pulls), 6))
    for row, (_, pull) in zip(levers, pulls, strict=True):
        row[slice(0, 3) if pull.place == "head" else slice(3, 6)] = pull.lever
    head, winch = rope_places(scene)
    on_machine = not hoist.winch.section
    first = 0.0 if hoist.length is not None else float(hoist.free_length(np.zeros(1), distance_along(scene, 0.0))[0])
    of_rope = [hoist.mass, hoist.EA, hoist.damping, hoist.falls, *head.at, *winch.at, on_machine, hoist.is_wound, first]
    reach = tuple(scene.names[1 : place.number + 1] for place in (head, winch))
    of_frame = frame_quantities(scene)
    return Hoist(
        tuple(name for name, _ in pulls),
        levers,
        np.array([*of_rope, *hoist.swing, *hoist.velocity, scene.pivot_height], float),
        reach,
        (ROPE, *WIND, *of_frame),
        hoist.is_wound,
        (Slot(0.0, 1.0, ROPE), *(Slot(0.0, 1.0, wind) for wind in WIND), *_ground_slots(scene, tuple(of_frame))),
    )


def recorded_hoist(provenance: Mapping[str, object]) -> Hoist:
    """Hoist of the scene in a system's provenance; an empty one if there is none."""
    scene = provenance.get("scene")
    if not (isinstance(scene, Mapping) and scene.get("hoist")):
        return Hoist()
    return hoist_of(stored_scene(scene, "provenance.scene", RECORDED))


def _ground_slots(scene: Scene, of_frame: tuple[str, ...]) -> list[Slot]:
    """The 15 slots of a hoist about gravity and the motion of the frame.

    They are gravity (1), the acceleration of the pivot (3), the rotation R by rows (9), and the parts of the machine's
    upward direction along x and z of the boom (2).  `of_frame` are the names in `frame_quantities`.  If it is empty, as
    without a frame, gravity is the input of the first section's weight, and all else is constant.
    """
    if of_frame:
        shaken, turned = ([f"{HOIST}{kind} {k}" for k in of] for kind, of in (("shaken", "xyz"), ("turned", range(9))))
        names = (of_frame[0], *shaken, *turned, *RAISED)
        return [Slot(0.0, 1.0, name) if name in of_frame else Slot() for name in names]
    gravity, R = Slot(0.0, 1.0, input_name(scene.names[0], WEIGHT)), still_rotation(scene)
    return [gravity, *[Slot()] * 3, *(Slot(float(entry)) for entry in (*R.ravel(), *R[2, [0, 2]]))]
