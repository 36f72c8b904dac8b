"""Each section of a boom as a body by itself: the scene that its full model is built from, and where contacts sit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pmr.scene.boom import Boom, JointPads
from pmr.scene.built import PadRing, Slider
from pmr.scene.choice import directions, model_of
from pmr.scene.scene import OneBody, Scene
from pmr.scene.signals import Ramp

#: What the row of points on a planar beam is called, and that of a section's tail along the boom.
POINT, TAIL = "deflection", "tail x"
#: What the rows are called that keep a planar beam straight within an overlap: within the next outer section, and what
#: of the next inner one is within it.
WITHIN, AROUND = ("straight within at the tail", "straight within"), ("straight around at the mouth", "straight around")
STRAIGHT = (*WITHIN, *AROUND)
#: The input that accelerates a section along the boom.
DRIVEN = "extension"


@dataclass(frozen=True)
class Ends:
    """First and last place in m along a section."""

    first: float
    last: float

    def with_(self, other: Ends) -> Ends:
        """What holds both."""
        return Ends(min(self.first, other.first), max(self.last, other.last))


@dataclass(frozen=True)
class Seat:
    """Where a ring of pads sits on a section: centres from `at.first` to `at.last`, of the joint of section `joint`."""

    joint: int
    ring: JointPads
    key: str
    at: Ends


@dataclass(frozen=True)
class Footprint:
    """Pads of one size and pattern: what a section measures wherever such a ring sits on it."""

    name: str
    ring: PadRing
    travel: Ends


def seats(boom: Boom, number: int) -> Iterator[Seat]:
    """All rings that touch a section, its own joint's first."""
    for k in range(max(number, 1), min(number + 2, len(boom.sections))):  # in which it slides, and what slides in it
        joint, outer = boom.joint(k), boom.length(k - 1)
        first, last = boom.extension(k).bounds(0.0, boom.time.end)
        for i, ring in enumerate(joint.tail):
            at = Ends(ring.at, ring.at) if k == number else Ends(ring.at + first, ring.at + last)
            yield Seat(k, ring, f"tail[{i}]", at)
        for i, ring in enumerate(joint.mouth):
            mouth = outer - ring.at
            at = Ends(mouth - last, mouth - first) if k == number else Ends(mouth, mouth)
            yield Seat(k, ring, f"mouth[{i}]", at)


def footprint(boom: Boom, ring: JointPads) -> str:
    """What the pads of a ring are called on the sections that they touch; those of one pattern and size are alike."""
    if ring.faces is None:
        return POINT
    rings = [one for number in range(1, len(boom.sections)) for one in boom.joint(number).rings]
    known = list(dict.fromkeys(_pattern(one) for one in rings if one.faces is not None))
    return f"pads {known.index(_pattern(ring)) + 1}"


def footprints(boom: Boom, number: int) -> tuple[Footprint, ...]:
    """Of all rings with faces that touch a section; rows of a body are defined on a common stretch.

    So all of them travel where any of them does, as far as the section's ends allow.
    """
    found = [seat for seat in seats(boom, number) if seat.ring.faces is not None]
    if not found:
        return ()
    everywhere, length, taken = _everywhere(found), boom.length(number), dict[str, Footprint]()
    for seat in found:
        name, half = footprint(boom, seat.ring), seat.ring.length / 2.0
        if name not in taken:
            own = _everywhere([one for one in found if footprint(boom, one.ring) == name])
            travel = own.with_(Ends(max(everywhere.first, half), min(everywhere.last, length - half)))
            taken[name] = Footprint(name, as_pads(seat.ring, name), travel)
    return tuple(taken.values())


def section_scene(boom: Boom, number: int) -> Scene:
    """A section as a scene of its own, with the pads of all joints that touch it on one path, its reach."""
    part, end = boom.sections[number], boom.time.end
    found = list(seats(boom, number))
    everywhere = _everywhere(found)
    points = any(seat.ring.faces is None for seat in found)
    longest = max((seat.ring.length for seat in found if seat.ring.faces is not None), default=0.0) / 2.0
    reach = Ends(max(everywhere.first, longest), min(everywhere.last, boom.length(number) - longest))
    return Scene(
        title=f"{boom.title}: {part.name}",
        pads=(*part.pads, *(one.ring for one in footprints(boom, number))),
        slider=Slider(
            path=Ramp(times=(0.0, end), values=(reach.first, reach.last)), offsets=(0.0,) if points else None
        ),
        **{name: getattr(part, name) for name in OneBody.model_fields if name != "pads"},
        **{name: getattr(boom, name) for name in ("gravity", "damping", "time", "recovery")},
    )


def stiffened(boom: Boom, number: int) -> dict[tuple[str, str], float]:
    """Rows that keep a section straight in its rigid overlaps: their names, and the end of each that stays, m."""
    found = {}
    if number and (own := boom.joint(number)).rigid_overlap:
        found[WITHIN] = own.first_at(own.tail)
    if number + 1 < len(boom.sections) and (following := boom.joint(number + 1)).rigid_overlap:
        found[AROUND] = boom.length(number) - following.first_at(following.mouth)
    return found


def joint_rows(boom: Boom, number: int) -> tuple[str, ...]:
    """What names of a section's rows begin with that belong to its joints; the others are between it and the ground."""
    return (*(f"{one.name} " for one in footprints(boom, number)), POINT, TAIL, *STRAIGHT)


def is_axial(boom: Boom, number: int) -> bool:
    """Whether a section moves along the boom, so that a cylinder can drive it."""
    return "x" in directions(section_scene(boom, number))


def is_planar(boom: Boom, number: int) -> bool:
    """Whether a section is a planar beam."""
    return model_of(section_scene(boom, number)) == "beam2d"


def as_pads(ring: JointPads, name: str) -> PadRing:
    """A joint's ring as one that moves along a body."""
    assert ring.faces is not None
    return PadRing(
        name=name, moving=True, faces=ring.faces, length=ring.length, width=ring.width, stiffness=ring.stiffness
    )


def _pattern(ring: JointPads) -> tuple[object, ...]:
    assert ring.faces is not None
    return (tuple((face, tuple(places)) for face, places in sorted(ring.faces.items())), ring.length, ring.width)


def _everywhere(found: list[Seat]) -> Ends:
    return Ends(float(np.min([seat.at.first for seat in found])), float(np.max([seat.at.last for seat in found])))
