"""Each section of a boom as a body by itself: the scene that its full model is built from, and where contacts sit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pmr.scene.boom import Boom, JointPads
from pmr.scene.built import PadRing, Slider
from pmr.scene.choice import directions, model_of
from pmr.scene.scene import Scene
from pmr.scene.signals import Ramp, bounds

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
    length, end = boom.length(number), boom.time.end
    if number > 0:
        joint, out = boom.sections[number].joint, Ends(*bounds(boom.extension(number), 0.0, end))
        assert joint is not None  # as the checks say
        outer = boom.length(number - 1)
        for i, ring in enumerate(joint.tail):
            yield Seat(number, ring, f"tail[{i}]", Ends(ring.at, ring.at))
        for i, ring in enumerate(joint.mouth):
            yield Seat(number, ring, f"mouth[{i}]", Ends(outer - ring.at - out.last, outer - ring.at - out.first))
    if number + 1 < len(boom.sections):
        joint, out = boom.sections[number + 1].joint, Ends(*bounds(boom.extension(number + 1), 0.0, end))
        assert joint is not None
        for i, ring in enumerate(joint.tail):
            yield Seat(number + 1, ring, f"tail[{i}]", Ends(ring.at + out.first, ring.at + out.last))
        for i, ring in enumerate(joint.mouth):
            yield Seat(number + 1, ring, f"mouth[{i}]", Ends(length - ring.at, length - ring.at))


def footprint(boom: Boom, ring: JointPads) -> str:
    """What the pads of a ring are called on the sections that they touch; those of one pattern and size are alike."""
    if ring.faces is None:
        return POINT
    joints = [part.joint for part in boom.sections if part.joint is not None]
    known = list(dict.fromkeys(_pattern(one) for joint in joints for one in joint.rings if one.faces is not None))
    return f"pads {known.index(_pattern(ring)) + 1}"


def footprints(boom: Boom, number: int) -> tuple[Footprint, ...]:
    """Of all rings with faces that touch a section.

    All of them travel where any of them does, as far as the section's ends allow: rows of a body are then defined on a
    common stretch.
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
        body=part.body,
        mesh=part.mesh,
        supports=part.supports,
        pads=(*part.pads, *(one.ring for one in footprints(boom, number))),
        slider=Slider(
            path=Ramp(times=(0.0, end), values=(reach.first, reach.last)), offsets=(0.0,) if points else None
        ),
        masses=part.masses,
        loads=part.loads,
        gravity=boom.gravity,
        damping=boom.damping,
        time=boom.time,
        observe=part.observe,
        probes=part.probes,
        recovery=boom.recovery,
        reduction=part.reduction,
    )


def stiffened(boom: Boom, number: int) -> dict[tuple[str, str], float]:
    """Rows that keep a section straight in its rigid overlaps: their names, and the end of each that stays, m."""
    found = {}
    own = boom.sections[number].joint
    if own is not None and own.rigid_overlap:
        found[WITHIN] = own.first_at(own.tail)
    following = boom.sections[number + 1].joint if number + 1 < len(boom.sections) else None
    if following is not None and following.rigid_overlap:
        found[AROUND] = boom.length(number) - following.first_at(following.mouth)
    return found


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
        name=name,
        moving=True,
        faces=ring.faces,
        length=ring.length,
        width=ring.width,
        stiffness=ring.stiffness,
    )


def _pattern(ring: JointPads) -> tuple[object, ...]:
    assert ring.faces is not None
    return (tuple((face, tuple(places)) for face, places in sorted(ring.faces.items())), ring.length, ring.width)


def _everywhere(found: list[Seat]) -> Ends:
    return Ends(float(np.min([seat.at.first for seat in found])), float(np.max([seat.at.last for seat in found])))
