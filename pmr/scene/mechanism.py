r"""What moves a boom: pivot and luffing cylinder, terms of the moving frame, and ropes.

What stands between a boom and the ground, and what a unit of its force makes about the pivot of the frame.

What a frame that moves adds to the equations of small motions, as terms: which matrix of which body, times what.

.. math::
    2 \omega_k T_k \dot q + \alpha_k T_k q + (\omega_j \omega_k N_{jk} - |\omega|^2 M)\, q + \sum_j N_j(t)\, K_{g,j}\, q

with the axial force that a section's own acceleration along the boom makes of it, :math:`a_x + A_{xx} x` from its tail
on, a load along x at its tip, and that of cylinders between two tails: one of length l that pushes with F has
:math:`-F/(2 l)\, (w_i - w_o)^2`, where F accelerates all that it carries, against the loads along x
on it.  :math:`M = N_{xx} + N_{yy} + N_{zz}`.

Sections that hang on ropes or chains that other ones drive: the force in these, how long and stiff they are.

A rope from the head of section k - 2 over a sheave at the head of section k - 1 to the tail of section k has

.. math:: l = (s_{k-1} + L_{k-1} - L_{k-2}) + (L_{k-1} - s_k), \qquad k = z\, EA / l

with the extensions s, the sections' lengths L and z strands.  Section k goes as far as section k - 1 does,
:math:`s_k = s_{k-1} + c`, so that l and its stiffness are the same all along the way.  Any other rope, from a winch
say, is as long as its keys say, :math:`l = l_0 + l' s_k`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.scene.built import force_of, reaction_of
from pmr.scene.choice import directions, has_tail, is_axial, loads_of, transverse
from pmr.scene.frame import LuffingCylinder
from pmr.scene.keys import LUFFING, LUFFING_CYLINDER, SLIDER, cylinder_of, named
from pmr.scene.members import Member, member_at, members
from pmr.scene.scene import Scene

Array = NDArray[np.float64]

#: What force and moment at the pivot are called, by their directions, and what the cylinder bears that raises the boom.
AT_PIVOT = "pivot"
MOMENT, CYLINDER = reaction_of(f"{AT_PIVOT} ry"), reaction_of(f"{AT_PIVOT} cylinder")
#: How near to the lug of a luffing cylinder its support is, and a pin to the pivot, m.
NEAR = 1e-6
#: Faces that every body has: along which axis out of them, and the sense.
OUTWARDS = {"bottom": ("z", -1.0), "top": ("z", 1.0), "left": ("y", 1.0), "right": ("y", -1.0)}


@dataclass(frozen=True)
class Pressed:
    """Force and moment (T, 6), by unit of a force that a run has under one of some names."""

    names: tuple[str, ...]
    wrench: Array


def pressed_on_ground(scene: Scene, along: Mapping[str, Array]) -> list[Pressed]:
    """Everything that stands between bodies and the ground, where the scene's paths, by their names, are (T,) m."""
    return [pressed for member in members(scene) for pressed in _ground_contacts(scene, member, along)]


@dataclass(frozen=True)
class PinAndCylinder:
    """A rigid pin at the pivot, and the support across the boom that stands for the luffing cylinder, at its lug.

    Names of the pin's forces along x and z, and names that the force of the support may have.
    """

    pin: tuple[str, str]
    across: tuple[str, ...]


def supports_at_lug(scene: Scene) -> tuple[str, ...]:
    """Names of supports of the base that stand for the luffing cylinder: across the boom, at its lug."""
    if scene.frame is None or scene.frame.cylinder is None:
        return ()
    part, lug = members(scene)[0].part, scene.frame.cylinder.lug[0] - scene.frame.place[0]
    places = {support.name: part.place(support.on) for support in part.supports if support.held == ("z",)}
    return tuple(name for name, x in places.items() if x is not None and abs(x - lug) <= NEAR)


def forces_of_cylinder(scene: Scene) -> tuple[str, ...]:
    """Names that the force of a luffing cylinder that holds the base may have."""
    return _names(scene.names[0], LUFFING_CYLINDER)


def pin_and_cylinder(scene: Scene) -> PinAndCylinder | None:
    """Rigid pin and single luffing cylinder that alone hold a base; None for any other base."""
    at_lug, base = supports_at_lug(scene), members(scene)[0]
    if len(at_lug) != 1 or base.part.pads or (base.points and not base.jointed):
        return None
    assert scene.frame is not None
    name, place = scene.names[0], scene.frame.place
    other_supports = [support for support in base.part.supports if support.name not in at_lug]
    rows = {d: [support for support in other_supports if d in support.held] for d in ("x", "z", "ry")}
    if [len(rows[d]) for d in ("x", "z", "ry")] != [1, 1, 0]:
        return None
    for support in (rows["x"][0], rows["z"][0]):
        at = base.part.place(support.on)
        if at is None or np.hypot(at + place[0], place[2]) > NEAR or support.stiffness != "rigid":
            return None
    x, z = (reaction_of(named(name, rows[d][0].row_name(d))) for d in ("x", "z"))
    across = next(support for support in base.part.supports if support.name in at_lug)
    return PinAndCylinder((x, z), _names(name, across.row_name("z")))


def _ground_contacts(scene: Scene, member: Member, along: Mapping[str, Array]) -> Iterator[Pressed]:
    """Everything that stands between a body and the ground."""
    body, moves = scene.names[member.number], directions(member)
    count = len(next(iter(along.values())))
    travelled = np.zeros(count) if member.jointed else along[SLIDER]
    tail = np.array(scene.frame.place if scene.frame else (0.0, 0.0, 0.0)) + np.zeros((count, 3))
    for name in scene.names[1 : member.number + 1]:
        tail[:, 0] += along[name]
    if member.cylinder is not None:
        yield _along_cylinder(body, member.cylinder, along[LUFFING])
    for support in member.part.supports:
        at = member.part.place(support.on)
        for held in support.held:
            if at is None:
                yield Pressed((), tail)  # a place that only a mesh knows
            elif held in moves:
                place = tail + [at, 0.0, 0.0]
                yield Pressed(_names(body, support.row_name(held)), _wrench(place, held))
    for ring in member.part.pads:
        for name, face, across in ring.places:
            place = tail + [ring.at, 0.0, 0.0]
            place[:, 0] += travelled * ring.moving
            if face in OUTWARDS:
                direction, sign = OUTWARDS[face]
                place[:, 1 if direction == "z" else 2] += across
                if direction in moves:
                    yield Pressed(_names(body, name), sign * _wrench(place, direction))
                continue
            box = member.part.body.box
            if box is None:
                yield Pressed((), tail)  # a face that only a mesh knows
                continue
            side = box.faces[face]
            place[:, 1:] += across * side.across
            yield Pressed(
                _names(body, name), sum(n * _wrench(place, d) for n, d in zip(side.normal, "yz", strict=True))
            )
    for name, ahead in zip(member.point_names, member.points, strict=True) if not member.jointed else ():
        place = tail + np.outer(travelled + ahead, [1.0, 0.0, 0.0])
        yield Pressed(_names(body, name), _wrench(place, "z"))


def _along_cylinder(body: str, cylinder: LuffingCylinder, angle: Array) -> Pressed:
    """A luffing cylinder at luffing angles (T,) rad: where it presses the boom up, the boom presses it down."""
    wrench = np.zeros((len(angle), 6))
    wrench[:, [0, 2]] = -cylinder.direction(angle)
    wrench[:, 3:] = np.cross(np.array([cylinder.lug[0], 0.0, cylinder.lug[1]]), wrench[:, :3])
    return Pressed(_names(body, LUFFING_CYLINDER), wrench)


def _names(body: str, what: str) -> tuple[str, ...]:
    """Names that a force between a body and the ground may have, from a body, a contact or a permanent row."""
    return (
        named(body, force_of(what)),
        force_of(f"{body} {what}"),
        reaction_of(named(body, what)),
    )


def _wrench(place: Array, direction: str) -> Array:
    """Force and moment (T, 6) about the pivot of a unit force, or moment, at a place (T, 3) m from it."""
    axis, wrench = np.eye(3)["xyz".index(direction[-1])], np.zeros((len(place), 6))
    if direction.startswith("r"):
        wrench[:, 3:] = axis
    else:
        wrench[:, :3], wrench[:, 3:] = axis, np.cross(place, axis)
    return wrench


#: Unit force states, what a section's acceleration has to be multiplied with, by its field.
OF_FIELD = {"x": "axial uniform", "xx": "axial linear"}


@dataclass(frozen=True)
class FrameTerm:
    """A term by its name, the bodies that it acts on, and its matrix."""

    name: str
    bodies: tuple[str, ...]  # one, or the inner and the outer one of a cylinder
    matrix: str  # of the body; of a cylinder that of `carried`
    of: str  # `rotation`, `turning`, `carried`, `field`, `load`, `cylinder` (inertia) or `cylinder load`
    component: str  # ``y`` of a rotation, ``xz`` of what is carried; a field; the name of a load
    number: int = 0  # of the section that is accelerated
    carried: str = ""  # name of the section that a cylinder carries


#: Of which kinds a term is that changes the stiffness, by axial forces or by the frame's speed.
STRESSES, AXIAL = (
    ("field", "load", "cylinder", "cylinder load", "carried"),
    ("field", "load", "cylinder", "cylinder load"),
)


def frame_terms(scene: Scene) -> Iterator[FrameTerm]:
    """All of them; none without second order."""
    if scene.frame is not None and scene.frame.second_order:
        yield from _all(scene)


def stress_terms(scene: Scene) -> Iterator[FrameTerm]:
    """Terms that change the stiffness, with second order or without it; none without a frame."""
    if scene.frame is not None:
        yield from (term for term in _all(scene) if term.of in STRESSES)


def _all(scene: Scene) -> Iterator[FrameTerm]:
    for member in members(scene):
        yield from _of_section(scene, member)
    for number, member in enumerate(members(scene)):
        if number and has_tail(member):
            for beyond in range(number, len(scene.sections)):
                for field in _fields(scene):
                    yield _of_cylinder(scene, number, beyond, field)
                for load in _axial_inputs(member_at(scene, beyond)):
                    yield replace(_of_cylinder(scene, number, beyond, load), of="cylinder load")


def _fields(scene: Scene) -> dict[str, str]:
    """Fields of acceleration that a frame has: without an angle it accelerates all places alike."""
    return OF_FIELD if scene.frame is not None and scene.frame.turns else {"x": OF_FIELD["x"]}


def _of_section(scene: Scene, member: Member) -> Iterator[FrameTerm]:
    assert scene.frame is not None  # of a scene that has terms
    body, slews, turns = scene.names[member.number], scene.frame.leaves_plane is not None, scene.frame.turns
    turning = "xyz" if slews else "y"
    for axis in turning if is_axial(member) and turns else ():
        matrix = f"rotating {axis}"
        yield FrameTerm(named(body, matrix), (body,), matrix, "rotation", axis)
        yield FrameTerm(named(body, f"turning {axis}"), (body,), matrix, "turning", axis)
    pairs = ("xx", "yy", "zz", "xy", "xz", "yz") if slews else ("xx", "zz")
    for pair in pairs if turns else ():
        if set(pair) <= set(directions(member)):
            yield FrameTerm(named(body, f"carried {pair}"), (body,), f"carried {pair}", "carried", pair)
    for field, matrix in _fields(scene).items():
        yield FrameTerm(named(body, matrix), (body,), matrix, "field", field, member.number)
    for load in loads_of(member):
        if load.direction == "x" and load.on == "tip":
            yield FrameTerm(named(body, f"axial {load.name}"), (body,), "axial tip", "load", load.name, member.number)


def _axial_inputs(member: Member) -> Iterator[str]:
    """Names of the inputs that act along a section."""
    return (load.name for load in loads_of(member) if load.direction == "x")


def _of_cylinder(scene: Scene, number: int, beyond: int, field: str) -> FrameTerm:
    inner, outer, carried = (scene.names[k] for k in (number, number - 1, beyond))
    name = f"{cylinder_of(inner)} that carries {carried}, {field}"
    return FrameTerm(name, (inner, outer), OF_FIELD.get(field, "axial tip"), "cylinder", field, number, carried)


def tails(member: Member) -> tuple[str, ...]:
    """Names of what measures the tail of a section across the boom in a frame, where cylinders act."""
    leans = member.frame is not None and member.jointed and has_tail(member)
    return tuple(f"tail {axis}" for axis in transverse(member)) if leans else ()


def rope_shares(scene: Scene) -> dict[str, dict[str, float]]:
    r"""Shares of the sections' forces along the boom that a rope or cylinder carries, by the section it moves.

    :math:`T_j = F_j + \sum_{k\ \mathrm{follows}\ j} r_k T_k`, of each section that follows another one, is followed
    or hangs on a rope.
    """
    names = scene.names[1:]
    follows = {name: scene.joint(k).follows for k, name in enumerate(names, 1)}
    ropes = {name for k, name in enumerate(names, 1) if scene.joint(k).rope is not None}
    joined = [name for name in names if follows[name] is not None or name in {*follows.values(), *ropes}]

    def shares_of(name: str) -> dict[str, float]:
        shares = {name: 1.0}
        for other in joined:
            if follows[other] == name:
                ratio = scene.joint(scene.names.index(other)).ratio
                for carried, share in shares_of(other).items():
                    shares[carried] = shares.get(carried, 0.0) + ratio * share
        return shares

    return {name: shares_of(name) for name in joined}


def drive_rows(scene: Scene, forces: Sequence[str]) -> dict[str, Array]:
    """Forces of what moves each section along the boom: shares (m,) of the forces with these names, by section.

    Of a section on ropes, or that others follow, it is T of `rope_shares`, of any other the force of its cylinder; not
    a number where a cylinder is not among the names.
    """
    shares = {name: {name: 1.0} for name in scene.names[1:]} | rope_shares(scene)
    rows = {name: np.zeros(len(forces)) for name in shares}
    for name, row in rows.items():
        for section, share in shares[name].items():
            if cylinder_of(section) in forces:
                row[forces.index(cylinder_of(section))] += share
            else:
                row[:] = np.nan
    return rows


def rope_length(scene: Scene, number: int) -> float | None:
    """Length of the rope of a section, 1 or more, in m, where the section's extension is 0.

    None without one, or where it goes another way and none is given.
    """
    joint = scene.joint(number)
    if joint.rope is None or joint.rope.length is not None:
        return None if joint.rope is None else joint.rope.length
    if number < 2 or joint.follows != scene.names[number - 1] or joint.ratio != 1.0:
        return None
    length = 2.0 * scene.sections[number - 1].length - scene.sections[number - 2].length - joint.offset
    return length if length > 0.0 else None


def longest(scene: Scene, number: int) -> float:
    """Greatest length of such a rope on the whole way, m; negative where it is used up on the way."""
    rope, length = scene.joint(number).rope, rope_length(scene, number)
    assert rope is not None and length is not None  # as the scene's checks say
    ends = [length + rope.lengthens * s for s in scene.extension(number).bounds(0.0, scene.time.end)]
    return max(ends) if min(ends) > 0.0 else min(ends)


@dataclass(frozen=True)
class Drive:
    """How what holds a section along the boom gives way under the force that it bears."""

    compliance: float  # m/N, where the section's extension is 0
    lengthening: float = 0.0  # 1/N: by how much that grows with the extension

    @classmethod
    def of(cls, scene: Scene, number: int) -> Drive:
        """Drive of a section, 1 or more."""
        joint = scene.joint(number)
        if joint.rope is not None:
            length, EA = rope_length(scene, number), joint.rope.strands * joint.rope.EA
            assert length is not None  # as the scene's checks say
            return cls(length / EA, joint.rope.lengthens / EA)
        return cls(0.0 if joint.cylinder.stiffness == "rigid" else 1.0 / float(joint.cylinder.stiffness))
