r"""What a boom presses on its machine with: three forces and three moments about the pivot, in the boom's own axes.

.. math::
    F = \sum_k \lambda_k n_k, \qquad \mathfrak M = \sum_k (p + r_k) \times \lambda_k n_k

over all that stands between the base and the ground: pads, supports, and cylinders that are supports, with their places
r_k from the base's tail, which is p from the pivot.  As supports they are positive along the axes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.built import force_of, reaction_of
from pmr.scene.choice import directions
from pmr.scene.members import Member, members
from pmr.scene.names import named

Array = NDArray[np.float64]

#: What the six are called, by their directions.
AT_PIVOT = "pivot"
#: Faces that every body has: along which axis out of them, and the sense.
OUTWARDS = {"bottom": ("z", -1.0), "top": ("z", 1.0), "left": ("y", 1.0), "right": ("y", -1.0)}


@dataclass(frozen=True)
class Pressed:
    """Force and moment (T, 6), by unit of a force that the response has under one of some names."""

    names: tuple[str, ...]
    wrench: Array


def at_pivot(scene: Scene, response: Response) -> Response:
    """With what acts at the pivot, where the scene has a frame and all of its parts are known."""
    if scene.frame is None:
        return response
    total, known = np.zeros((len(response.t), 6)), dict(zip(response.force_names, response.slider_force.T, strict=True))
    known |= {} if response.others is None else dict(zip(response.other_names, response.others.T, strict=True))
    pressed = [one for member in members(scene) for one in _pressed(scene, member, response.t)]
    for one in pressed:
        name = next((name for name in one.names if name in known), None)
        if name is None:
            return response
        total += known[name][:, None] * one.wrench
    axes = directions(members(scene)[0])
    numbers = ["xyz".index(axis) if len(axis) == 1 else 3 + "xyz".index(axis[1]) for axis in axes]
    return replace(
        response,
        others=np.hstack([total[:, :0] if response.others is None else response.others, total[:, numbers]]),
        other_names=(*response.other_names, *(reaction_of(f"{AT_PIVOT} {axis}") for axis in axes)),
        other_units=(*response.other_units, *("N" if len(axis) == 1 else "N m" for axis in axes)),
        kinds=(*response.kinds, *("reaction" for _ in axes)),
        bodies=(*response.bodies, *(scene.names[0] for _ in axes)),
    )


def _pressed(scene: Scene, member: Member, t: Array) -> Iterator[Pressed]:
    """What stands between a body and the ground."""
    body, moves = scene.names[member.number], directions(member)
    tail = np.array(scene.frame.place if scene.frame else (0.0, 0.0, 0.0)) + np.zeros((len(t), 3))
    for number in range(1, member.number + 1):
        tail[:, 0] += scene.extension(number).value(t)
    travelled = np.zeros_like(t) if member.jointed else np.asarray(scene.slider.path.value(t))
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
    """What a force between a body and the ground may be called, from a body, a contact or a row that always holds."""
    return (
        named(body, force_of(what)),
        force_of(f"{body} {what}"),
        reaction_of(named(body, what)),
    )


def _wrench(place: Array, direction: str) -> Array:
    """Force and moment (T, 6) about the pivot of a unit force, or moment, at a place (T, 3) m from it."""
    axis, found = np.eye(3)["xyz".index(direction[-1])], np.zeros((len(place), 6))
    if direction.startswith("r"):
        found[:, 3:] = axis
    else:
        found[:, :3], found[:, 3:] = axis, np.cross(place, axis)
    return found
