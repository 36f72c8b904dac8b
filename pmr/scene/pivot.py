"""What stands between a boom and the ground, and what a unit of its force makes about the pivot of the frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.scene.built import force_of, reaction_of
from pmr.scene.choice import directions
from pmr.scene.members import Member, members
from pmr.scene.names import SLIDER, named
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
