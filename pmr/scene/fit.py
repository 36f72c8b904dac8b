"""Whether a section fits into the next outer one, with its pads and their play."""

from __future__ import annotations

import numpy as np

from pmr.scene.box import Box
from pmr.scene.members import Seat, seats
from pmr.scene.plates import gaps
from pmr.scene.scene import Scene
from pmr.scene.structure_checks import refusal

#: Round-off of a user's arithmetic.
SLACK = 1e-9
#: Cosine of the angle between faces that a pad lies between.
PARALLEL = 1.0 - 1e-6


def check_fit(scene: Scene, number: int) -> None:
    """The inner box within the outer one, and the play of its pads within the gap between them."""
    inner, outer = scene.sections[number].body.box, scene.sections[number - 1].body.box
    if inner is None or outer is None:
        return
    name, around = scene.names[number], scene.names[number - 1]
    for side, walls in (("width", ("left", "right")), ("height", ("bottom", "top"))):
        has = getattr(inner, side) + sum(map(inner.thickness, walls)) / 2.0
        room = getattr(outer, side) - sum(map(outer.thickness, walls)) / 2.0
        if has >= room:
            allowed = (
                f"outside {name} is {has:.6g} m, inside {around} there are {room:.6g} "
                "m: a section has to fit into the one before it"
            )
            raise refusal(f"sections[{number}].body.box.{side}", getattr(inner, side), allowed)
    beyond, face = min((room, face) for face, room in gaps(inner.sides, outer.sides).items())
    if beyond <= 0.0:
        allowed = f"{name} comes {-beyond:.6g} m too close to the {face} of {around}: a section has to fit into it"
        raise refusal(f"sections[{number}].body.box", None, allowed)
    _tail(scene, number, inner, outer)
    _frames(scene, number, inner, outer)
    for seat in seats(scene, number):
        if seat.joint == number:
            _play(seat, f"sections[{number}].joint.{seat.key}", (name, inner), (around, outer))


def _tail(scene: Scene, number: int, inner: Box, outer: Box) -> None:
    """The tail of the inner box, farthest in, where the outer one tapers towards its own."""
    first, _ = scene.extension(number).bounds(0.0, scene.time.end)
    low, _ = outer.parallel
    if first >= low:
        return
    ends = inner.profile_at(0.0), outer.profile_at(max(first, 0.0))
    beyond = min(gaps(*(profile.sides for profile in ends)).values())
    if beyond <= 0.0:
        allowed = (
            f"{scene.names[number]} gets {first:.6g} m near the tail of {scene.names[number - 1]}, which tapers over "
            f"{low:.6g} m: there it comes {-beyond:.6g} m too close"
        )
        raise refusal(f"sections[{number - 1}].body.box.tail_taper.length", low, allowed)


def _frames(scene: Scene, number: int, inner: Box, outer: Box) -> None:
    """The inner box slides past frames of the outer one, or does not get there."""
    first, _ = scene.extension(number).bounds(0.0, scene.time.end)
    reached = [x for x in outer.frames if x >= first]
    if not reached:
        return
    gap = gaps(inner.sides, outer.sides)
    room = min(gap[side.name] + side.thickness / 2.0 for side in outer.sides)
    if outer.frame_depth == "full" or outer.frame_depth >= room:
        allowed = (
            f"places of less than {first:.6g} m are allowed, or a frame_depth of less than {room:.6g} m: "
            f"{scene.names[number]} slides past {reached[0]:g} m"
        )
        raise refusal(f"sections[{number - 1}].body.box.frames", list(outer.frames), allowed)


def _play(seat: Seat, key: str, inner: tuple[str, Box], outer: tuple[str, Box]) -> None:
    """Pads stand on faces of both sections that are parallel, and have no more play than the gap there."""
    (name, section), (around, tube) = inner, outer
    inner_faces, outer_faces = section.faces, tube.faces
    for face in seat.ring.faces or ():
        for body, faces in ((name, inner_faces), (around, outer_faces)):
            if face not in faces:
                raise refusal(f"{key}.faces", face, f"faces that {body} has are allowed: {', '.join(faces) or 'none'}")
        if inner_faces[face].normal @ outer_faces[face].normal < PARALLEL:
            allowed = f"faces that are parallel are allowed: the {face} of {name} and that of {around} are not"
            raise refusal(f"{key}.faces", face, allowed)
    room = gaps(section.sides, tube.sides)
    for face in seat.ring.faces or ("bottom", "top"):  # points stand above and below
        clearance, gap = seat.ring.clearance_on(face), room.get(face, np.inf)
        if clearance > gap * (1.0 + SLACK):
            allowed = f"at most {gap:.6g} m is allowed: so wide is the gap between {name} and {around} there"
            raise refusal(f"{key}.clearance", clearance, allowed)
