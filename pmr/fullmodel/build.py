r"""Full models of a scene's bodies, and the check that no rigid motion of them is left free.

The check uses the geometry alone.  The bodies b = 1, 2, ... are numbered from the base outwards.  A rigid motion has
six components: displacements along and rotations about x, y and z, about the origin of the base.  Body b moves as body
b - 1, which carries it, and in addition by its relative motion :math:`d_b`; its total motion is :math:`m_b`.  At the
path coordinates s, the matrix A(s) turns a motion about the origin of the base into the motion about the body's tail,
and the columns of R are the coordinates of the body under unit rigid motions about its tail.  The supports, pads and
contacts that hold the bodies are the rows of C(s) and measure

.. math:: C(s) R\, A(s)\, m, \qquad m_b = d_1 + \dots + d_b

C contains the rows of supports and pads, with or without stiffness, of clamped coordinates, and of contacts between two
bodies.  A motion d is free if all of these measures are zero.  Pads that only push are treated as if they held both
ways; whether anything presses on them is found when the static start is computed.  Rows that keep a body straight are
zero for every rigid motion.
"""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np

from pmr.errors import InputError, NotHeldError
from pmr.fem.compat import MPI
from pmr.files.arrays import Array
from pmr.files.fit import UNCHECKED
from pmr.fullmodel.from_scene import structure_of
from pmr.fullmodel.model import FullModel, FullSystem
from pmr.fullmodel.structure import Structure, structural_model
from pmr.models import DIRECTIONS, StructuralModel
from pmr.models.named_mesh import NamedMesh
from pmr.scene import Scene
from pmr.scene.choice import is_undecided, model_of
from pmr.scene.keys import ALONE, SLIDER
from pmr.scene.mechanism import frame_terms, stress_terms
from pmr.scene.members import members
from pmr.scene.signals.base import Interval
from pmr.system.from_scene import contacts_of

logger = logging.getLogger(__name__)


#: A motion is free if singular values of what holds it are below this share of the largest; pads are exact to 1e-12.
FREE = 1e-7
#: Largest angle in rad between the faces of two bodies that a pad joins.
TURNED = 5e-2
#: A row is round-off if it measures less than this share of the sum of the magnitudes of its terms.
ROUND_OFF = 1e-9
AXES = "xyz"


@dataclass(frozen=True)
class FreeMotions:
    """Free rigid motions in words, at the position with most of them; both texts are empty if there are none.

    `sentence` names all free motions, `clause` is a short clause about the first one.
    """

    sentence: str = ""  # "fly free to move along x at t = 2 s"
    clause: str = ""  # "fly can move along x"


@dataclass(frozen=True)
class CheckedPositions:
    """Positions of the bodies, T in all, at which a system is checked for free motions."""

    s: Mapping[str, Array]  # (T,) m: path coordinates, by the name of the path
    tails: Mapping[str, Array]  # (T,) m: distance of each body's tail ahead of the tail of the base, by body
    labels: Sequence[str]  # (T,) texts: each position in words


@dataclass(frozen=True)
class RigidBody:
    """Values that the rows of a body take under its six rigid motions, about its tail.

    A motion that the body's model lacks has zeros in `carrier_motions`, and a unit row in `held_motions` that holds it.
    """

    carrier_motions: Array  # (K, 6): what the K carrier rows measure of the motions
    carrier_sizes: Array  # (K, 6): the same sums of absolute values, by which round-off is judged
    held_motions: Array  # (h, 6): what clamps, springs and missing directions measure
    reach: float  # m: largest displacement coordinate under a unit rotation

    @classmethod
    def from_model(cls, model: FullModel, structural: StructuralModel) -> RigidBody:
        """Compute what the rows of a full model measure of the rigid motions of its structural model; collective.

        `structural` is the structural model from which `model` was made.  Raises a `ValueError` if the full model has
        no rigid motions (`FullModel.rigid` is None).
        """
        if model.rigid is None:
            raise ValueError("a model whose rigid motions are known is needed")
        R, comm = model.rigid.coordinates, model.comm
        U = model.carriers.carriers[:, model.share]
        numbers = [DIRECTIONS.index(direction) for direction in structural.directions]
        space = np.eye(6)[numbers]
        missing = np.delete(np.eye(6), numbers, axis=0)
        held = [model.rigid.held_measures @ space, missing]
        turning = np.array([direction.startswith("r") for direction in structural.directions])
        reach = float(np.max(comm.allgather(np.abs(R[:, turning]).max(initial=0.0))))
        measured, terms = (np.asarray(comm.allreduce(part)) @ space for part in (U @ R, abs(U) @ np.abs(R)))
        return cls(measured, terms, _span_rows(np.vstack(held), reach), reach)


def _span_rows(rows: Array, reach: float) -> Array:
    """At most six rows (h, 6) that have the same span as `rows` (m, 6); they may still depend on each other.

    A clamp of many points has many rows, but these span six dimensions at most.  The columns 3 to 5 of `rows` belong to
    rotations.  The length `reach` in m scales rotations to displacements; if it is 0, 1 m is used.
    """
    scale = np.repeat([1.0, reach or 1.0], 3)
    rows = rows / scale
    size = np.linalg.norm(rows, axis=1)
    triangle = np.linalg.qr(rows[size > 0.0] / size[size > 0.0, None], mode="r")
    return np.asarray(triangle[np.linalg.norm(triangle, axis=1) > ROUND_OFF] * scale)


def free_motions(
    system: FullSystem, structural: Mapping[str, StructuralModel], positions: CheckedPositions
) -> list[dict[str, Array]]:
    """List for each of the T positions a dict of free motions (6, f), by the names of the bodies; collective.

    The motions of a body are relative to the body that carries it.  Bodies without a free motion are left out.
    `structural` has the structural models of the bodies.
    """
    bodies = {name: RigidBody.from_model(model, structural[name]) for name, model in system.bodies.items()}
    shifts = {name: _shifts(ahead) for name, ahead in positions.tails.items()}
    scale = np.ones(6)
    scale[3:] = max(float(np.max(positions.tails[name])) + body.reach for name, body in bodies.items())
    rows = np.concatenate(
        [_contact_measures(system, bodies, positions, shifts), *_support_measures(bodies, shifts)], axis=1
    ) / np.tile(scale, len(bodies))
    size = np.linalg.norm(rows, axis=2, keepdims=True)
    rows = np.divide(rows, size, out=np.zeros_like(rows), where=size > 0.0)
    relative = np.kron(np.tril(np.ones((len(bodies), len(bodies)))), np.eye(6))  # m of d
    return [_distribute_motions(_null_space(at @ relative), tuple(bodies), scale) for at in rows]


def describe_free_motions(
    system: FullSystem, structural: Mapping[str, StructuralModel], positions: CheckedPositions
) -> FreeMotions:
    """Describe in words the free motions at the position that has most of them; collective.

    If several positions have as many, the first one is described.  The text names the position unless all positions
    have the same free motions.  `structural` has the structural models of the bodies.  Both texts are empty if nothing
    can move freely.
    """
    by_position = [
        {name: describe_motions(motions) for name, motions in at.items()}
        for at in free_motions(system, structural, positions)
    ]
    counts = [sum(map(len, at.values())) for at in by_position]
    most, last = int(np.argmax(counts)), list(system.bodies)[-1]
    if not counts[most]:
        return FreeMotions()
    sentence = "; ".join(
        f"{'the body' if name == ALONE else name if name == last else f'{name} with what it carries'} free to "
        + ", ".join(motions)
        for name, motions in by_position[most].items()
    )
    always = all(at == by_position[most] for at in by_position)
    first = next(iter(by_position[most].values()))[0]
    names = [name for name, motions in by_position[most].items() if first in motions]
    who = "it" if names == [ALONE] else " and ".join(filter(None, (", ".join(names[:-1]), names[-1])))
    further = counts[most] - len(names)
    more = f", and in {further} more way{'s' if further > 1 else ''}" if further else ""
    return FreeMotions(sentence if always else f"{sentence} {positions.labels[most]}", f"{who} can {first}{more}")


def _contact_measures(
    system: FullSystem, bodies: Mapping[str, RigidBody], positions: CheckedPositions, shifts: Mapping[str, Array]
) -> Array:
    """Values (T, m, 6 b) that m contacts take at T positions under the six rigid motions of each of b bodies.

    `shifts` are matrices (T, 6, 6) by body, as `_shifts` returns them.  A row is set to zero if it is a sum of terms
    that cancel up to the share `ROUND_OFF`.
    """
    names, x = list(bodies), system.side_coordinates(positions.s)
    rows, terms = np.zeros((2, len(positions.labels), len(system.contacts), 6 * len(names)))
    for side, row, at in zip(system.sides, system.side_rows, x.T, strict=True):
        name = side.place.body
        motions_of_body, weights = slice(6 * names.index(name), 6 * names.index(name) + 6), row.weights(at)
        rows[:, side.contact, motions_of_body] = side.sign * _multiply_each(
            weights @ bodies[name].carrier_motions, shifts[name]
        )
        terms[:, side.contact, motions_of_body] = _multiply_each(
            abs(weights) @ bodies[name].carrier_sizes, np.abs(shifts[name])
        )
    counts = np.linalg.norm(rows, axis=2) > ROUND_OFF * np.linalg.norm(terms, axis=2)
    return rows * counts[:, :, None]


def _support_measures(bodies: Mapping[str, RigidBody], shifts: Mapping[str, Array]) -> Iterator[Array]:
    """Yield for each of b bodies the values (T, h, 6 b) that its h clamps and springs take under the rigid motions.

    There are six rigid motions of each body, and T positions.  `shifts` are matrices (T, 6, 6) by body, as `_shifts`
    returns them.
    """
    for k, (name, body) in enumerate(bodies.items()):
        rows = np.einsum("hk,tkl->thl", body.held_motions, shifts[name])
        yield np.pad(rows, ((0, 0), (0, 0), (6 * k, 6 * (len(bodies) - k - 1))))


def _multiply_each(rows: Array, shifts: Array) -> Array:
    """Products (T, 6) of each row of `rows` (T, 6) with the matrix in `shifts` (T, 6, 6) at the same index."""
    return np.asarray(np.einsum("tk,tkl->tl", rows, shifts))


def _shifts(distances: Array) -> Array:
    """Matrices (T, 6, 6) that turn a rigid motion about the base's origin into the same motion about another point.

    The T points are at the `distances` (T,) in m from the origin, along x.
    """
    A = np.tile(np.eye(6), (len(distances), 1, 1))
    A[:, 2, 4], A[:, 1, 5] = -distances, distances
    return A


def _distribute_motions(free: Array, names: tuple[str, ...], scale: Array) -> dict[str, Array]:
    """Distribute the f orthonormal motions `free` (6 b, f) over b bodies, each to the first body that moves in it.

    `names` are the names of the b bodies.  The result maps each body with free motions to its motions (6, f_b),
    relative to the body that carries it and divided by `scale` (6,).
    """
    motions = {}
    for k, name in enumerate(names):
        of_body = free[6 * k : 6 * k + 6]
        _, sigma, Vt = np.linalg.svd(of_body, full_matrices=True)
        count = int(np.sum(sigma > FREE))
        if count:
            motions[name] = of_body @ Vt[:count].T / scale[:, None]
        free = free @ Vt[count:].T
    return motions


def _null_space(C: Array) -> Array:
    """Orthonormal basis (n, f) of the motions x with C x = 0, for C (m, n).

    Singular values of C up to the share `FREE` of the largest one count as zero.  If C has no rows, f = n.
    """
    _, sigma, Vt = np.linalg.svd(np.linalg.qr(C, mode="r"), full_matrices=True)
    return np.asarray(Vt[int(np.sum(sigma > FREE * sigma.max(initial=0.0))) :].T)


def describe_motions(motions: Array) -> list[str]:
    """Describe f independent free motions (6, f) in words, one phrase each: translations first, then rotations.

    Phrases are such as ``move along x`` and ``turn about z through (2, 0, 0) m``.
    """
    theta = motions[3:]
    _, sigma, Vt = np.linalg.svd(theta, full_matrices=True)
    turns = int(np.sum(sigma > FREE * np.abs(motions).max(initial=0.0)))
    shifts = _reduce_rows(Vt[turns:] @ motions[:3].T)
    phrases = [f"move along {_direction(shift)}" for shift in shifts]
    for motion in _reduce_rows(Vt[:turns] @ np.vstack([theta, motions[:3]]).T):
        about, linear = motion[:3], motion[3:]
        if len(shifts):
            linear = linear - shifts.T @ np.linalg.lstsq(shifts.T, linear, rcond=None)[0]
        phrases.append(f"turn about {_direction(about)} through {_place(np.cross(about, linear) / (about @ about))}")
    return phrases


def _reduce_rows(A: Array) -> Array:
    """Basis of the row space of A (f, d) with many zeros, by Gauss-Jordan elimination; overwrites A.

    Entries up to the share `FREE` of the largest one count as zero.
    """
    row = 0
    for column in range(A.shape[1]):
        if row == len(A):
            break
        pivot = row + int(np.abs(A[row:, column]).argmax())
        if np.abs(A[pivot, column]) <= FREE * np.abs(A).max():
            continue
        A[[row, pivot]] = A[[pivot, row]]
        A[row] /= A[row, column]
        other_rows = np.arange(len(A)) != row
        A[other_rows] -= np.outer(A[other_rows, column], A[row])
        row += 1
    return A[:row]


def _direction(vector: Array) -> str:
    """Name of the axis x, y or z to which a vector (3,) is parallel, in either sense; else its unit vector as text."""
    unit = vector / np.linalg.norm(vector)
    along = int(np.abs(unit).argmax())
    if np.abs(unit[along]) > 1.0 - 1e-6:
        return AXES[along]
    return "({})".format(", ".join(f"{c + 0.0:.3g}" for c in np.round(unit, 3)))


def _place(point: Array) -> str:
    """Coordinates of a point (3,) in m as text."""
    return "({}) m".format(", ".join(f"{c + 0.0:.4g}" for c in np.round(point, 6)))


#: Relative error of the lowest frequency above which a warning says that the mesh is too fine.
NOTICED_ROUND_OFF = 1e-4
#: Number of positions at which free motions are looked for.
PLACES = 33


@dataclass(frozen=True)
class AssembledBody:
    """Full model of a body, and the structure from which it was assembled."""

    model: FullModel
    structure: Structure


def build(scene: Scene, comm: MPI.Comm = MPI.COMM_WORLD) -> AssembledBody:
    """Assemble the full model of a scene with one body on `comm`; collective.

    Raises the errors of `build_bodies`, and an `InputError` for a scene of several bodies.
    """
    scene.only_section  # noqa: B018 - refuses others
    return build_bodies(scene, comm)[ALONE]


def full_model(scene: Scene, comm: MPI.Comm = MPI.COMM_WORLD) -> FullModel:
    """Assemble the full model of a scene with one body on `comm`, and log its warnings; collective.

    Raises the errors of `build`.
    """
    built = build(scene, comm)
    log_warnings([built], comm)
    return built.model


def log_warnings(built: Iterable[AssembledBody], comm: MPI.Comm) -> None:
    """Log the warnings of the structures of the bodies `built` on rank 0, each text once."""
    messages = dict.fromkeys(message for model in built for message in warnings(model.structure))
    for message in messages if comm.rank == 0 else ():
        logger.warning("%s", message)


def warnings(structure: Structure) -> list[str]:
    """Warning about a structure, as a list of one text; empty if there is nothing to warn of.

    If several of these apply, the warning is about the first one:

    - nodes of given matrices could not be checked;
    - a mesh has an open seam, where several nodes lie at one place;
    - elements are so short that round-off in the stiffness changes the lowest frequency by more than the share
      `NOTICED_ROUND_OFF`.
    """
    if getattr(structure.model, "unchecked", False):
        return [UNCHECKED]
    mesh = getattr(structure.model, "mesh", None)
    if isinstance(mesh, NamedMesh) and len(mesh.open_seam):
        first = ", ".join(f"{x + 0.0:.4g}" for x in mesh.open_seam[0].round(6))
        return [
            f"{mesh.source}: at {len(mesh.open_seam)} places, first at ({first}) m, several nodes lie that no cell "
            "joins; merge them if the body is not open there: a slit takes most of a box's stiffness in torsion"
        ]
    round_off = getattr(structure.model, "round_off", 0.0)
    if round_off <= NOTICED_ROUND_OFF:
        return []
    return [
        "round-off in the stiffness of so short elements changes the lowest frequency by about "
        f"{round_off:.0e} of its value; fewer elements are more accurate"
    ]


def build_bodies(scene: Scene, comm: MPI.Comm = MPI.COMM_WORLD) -> Mapping[str, AssembledBody]:
    """Assemble the full models of all bodies of a scene, by name; equal bodies share one `AssembledBody`.  Collective.

    Raises an `InputError` in these cases:

    - a body's model is still ``auto``, or it needs FEniCSx, which is not installed;
    - a mesh can't be read or drawn;
    - a load, mass, support, pad or probe does not fit the mesh;
    - a pad joins faces of two bodies that are not parallel.

    Raises a `NotHeldError` if a rigid motion is free and the scene does not allow it.
    """
    for member in filter(is_undecided, members(scene)):
        allowed = "a model by its name is allowed here: pmr.run and pmr.reduce measure which one will do"
        raise InputError("scene", scene.section_key(member.number, "body.model"), "auto", allowed)
    by_content, bodies = dict[tuple[str, str], AssembledBody](), dict[str, AssembledBody]()
    # of second order, too, where the scene leaves it out: a message says how much that changes
    matrices = tuple(dict.fromkeys(term.matrix for term in (*frame_terms(scene), *stress_terms(scene))))
    for name, member in zip(scene.names, members(scene), strict=True):
        key = member.content, model_of(member)
        if key not in by_content:
            try:
                structure = replace(structure_of(member, comm), matrices=matrices)
                by_content[key] = AssembledBody(structural_model(structure, comm), structure)
            except InputError as error:
                raise error.with_key(scene.section_key(member.number, error.key)) from None
        bodies[name] = by_content[key]
    _check_facing(scene, bodies)
    if scene.free_motions == "refused" and (free := _find_free_motions(scene, bodies)).sentence:
        allowed = f"{_free_motion_sentence(bodies, free)}; a support that holds it is needed, or 'allowed'"
        raise NotHeldError("scene", "free_motions", scene.free_motions, allowed, free.clause)
    return bodies


def within_reach(scene: Scene, built: Mapping[str, AssembledBody]) -> dict[str, AssembledBody]:
    """Return the bodies `built` with rows of pads cut to the positions that pads of joints have in the simulated time.

    Each position that a row covers takes static solves later.  The pads of both joints of a section share their rows,
    so a row also covers the positions between the joints, where no pad comes.  Therefore the row becomes zero at all
    positions that its pads do not reach.  Only rows of joints' pads with a stiffness are cut; all others stay as they
    are.  Equal bodies still share one `AssembledBody`; their rows cover each position that one of them needs.
    """
    ranges, reached = dict[int, dict[str, list[Interval]]](), dict[int, AssembledBody]()
    for name, member in zip(scene.names, members(scene), strict=True):
        of_body = ranges.setdefault(id(built[name]), defaultdict(list))
        for row_name, positions in member.pad_positions.items():
            of_body[row_name] += positions
    for body in built.values():
        of_body, rows = ranges[id(body)], body.model.rows
        reaching = [
            row.restrict_to(of_body[row.name]) if row.name in of_body and row.compliance else row for row in rows.rows
        ]
        reached[id(body)] = replace(body, model=replace(body.model, rows=replace(rows, rows=tuple(reaching))))
    return {name: reached[id(body)] for name, body in built.items()}


def models_of(built: Mapping[str, AssembledBody]) -> dict[str, FullModel]:
    """Full models of the bodies `built`, by name."""
    return {name: body.model for name, body in built.items()}


def free_motion_warnings(scene: Scene, built: Mapping[str, AssembledBody]) -> list[str]:
    """List a sentence that names the rigid motions which nothing resists; empty if there are none; collective.

    The sentence is about the position with most free motions, among those that the bodies `built` pass through in the
    scene.
    """
    free = _find_free_motions(scene, built)
    return [_free_motion_sentence(built, free)] if free.sentence else []


def _free_motion_sentence(built: Mapping[str, AssembledBody], free: FreeMotions) -> str:
    """Sentence that names the motions which the supports and pads of the bodies `built` leave free."""
    holds = "supports and pads" if ALONE in built else "supports, pads and cylinders"
    return f"{holds} leave {free.sentence}: loads along that move it without limit"


def _check_facing(scene: Scene, built: Mapping[str, AssembledBody]) -> None:
    """Raise an `InputError` if a pad joins faces of two of the bodies `built` that are not parallel; collective.

    Faces count as parallel if the angle between their normals is at most `TURNED`.  The angle is larger if, for
    example, another axis is upwards in the file of a mesh.  The normal of a face is the direction along which the pad
    measures displacements of the face's body, at the first of the checked positions.  Directions along which one of the
    bodies of the scene can't move are left out.
    """
    models, structural = models_of(built), {name: body.structure.model for name, body in built.items()}
    system, positions = FullSystem(models, contacts_of(scene, models)), _checked_positions(scene)
    bodies = {name: RigidBody.from_model(model, structural[name]) for name, model in models.items()}
    shifts = {name: _shifts(ahead) for name, ahead in positions.tails.items()}
    measured = _contact_measures(system, bodies, positions, shifts)[0].reshape(len(system.contacts), len(bodies), 6)
    shared = [k for k in range(3) if all(DIRECTIONS[k] in model.directions for model in structural.values())]
    for contact, of_bodies in zip(system.contacts, measured[..., shared], strict=True):
        if contact.outer is None or contact.kind != "pad":
            continue
        inner, outer = contact.inner.body, contact.outer.body
        normals = [of_bodies[scene.names.index(name)] for name in (inner, outer)]
        size = float(np.prod(np.linalg.norm(normals, axis=1)))
        if normals[0] @ normals[1] > -np.cos(TURNED) * size:  # of opposite signs: a pad measures the difference
            allowed = (
                f"faces of {inner} and {outer} that are parallel are allowed, but those at the pad {contact.name} are "
                "not; do both bodies have x along the boom and z upwards?"
            )
            raise InputError("scene", f"sections[{scene.names.index(inner)}].joint", None, allowed)


def _find_free_motions(scene: Scene, built: Mapping[str, AssembledBody]) -> FreeMotions:
    """Find the free rigid motions of the bodies `built` of a scene; collective.

    Supports count as contacts with the ground.
    """
    models = models_of(built)
    system = FullSystem(models, contacts_of(scene, models)).with_supports()
    return describe_free_motions(
        system, {name: body.structure.model for name, body in built.items()}, _checked_positions(scene)
    )


def _checked_positions(scene: Scene) -> CheckedPositions:
    """Positions at which free motions are looked for.

    A scene of a single body is checked at `PLACES` path coordinates.  A scene of several bodies is checked at `PLACES`
    times and at the times at which the signal of a driven path breaks.
    """
    if ALONE in scene.bodies:
        along = np.linspace(*scene.travel, PLACES)
        return CheckedPositions({SLIDER: along}, {ALONE: np.zeros(PLACES)}, [f"with s at {at:.4g} m" for at in along])
    end, breaks = scene.time.end, [t for path in scene.driven_paths.values() for t in path.breaks]
    t = np.unique(np.clip([*np.linspace(0.0, end, PLACES), *breaks], 0.0, end))
    s = {name: path.value(t) for name, path in scene.paths.items()}
    tails = accumulate(s.values(), np.add, initial=np.zeros(len(t)))
    s_of_all = {name: path.value(t) for name, path in scene.driven_paths.items()}
    return CheckedPositions(s_of_all, dict(zip(scene.names, tails, strict=True)), [f"at t = {at:.4g} s" for at in t])
