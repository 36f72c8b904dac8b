"""Bodies of a scene with all inputs of their full models, and the positions of joints' contacts on the bodies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from pmr.scene.built import WEIGHT, Gravity, PadRing
from pmr.scene.frame import Frame, LuffingCylinder
from pmr.scene.joints import BoomSection, JointPads
from pmr.scene.run_settings import Recovery
from pmr.scene.scene import Scene
from pmr.scene.signals import SignalBase
from pmr.scene.structures import Damping

#: Names of the row of sliding points on a planar beam, and of the row that holds a section's tail along the boom.
POINT, TAIL = "deflection", "tail x"
#: Names of the rows that keep a planar beam straight in an overlap: where it is within the next outer section, and
#: where the next inner section is within it.
WITHIN, AROUND = ("straight within at the tail", "straight within"), ("straight around at the mouth", "straight around")
STRAIGHT = (*WITHIN, *AROUND)
#: The input that accelerates a section along the boom.
EXTENSION = "extension"


@dataclass(frozen=True)
class PositionRange:
    """First and last position in m of a range along a section."""

    first: float
    last: float

    def union(self, other: PositionRange) -> PositionRange:
        """Return the smallest range that contains this one and another one."""
        return PositionRange(min(self.first, other.first), max(self.last, other.last))


@dataclass(frozen=True)
class Seat:
    """A ring of pads of a joint, on a section that the ring touches.

    The pads' centres are within `positions` along the section over the simulated time.  `joint` is the number of the
    section whose joint the ring belongs to.  `key` is the ring's key in that joint, such as ``tail[0]``.
    """

    joint: int
    ring: JointPads
    key: str
    positions: PositionRange


@dataclass(frozen=True)
class Member:
    """A body of a scene with all inputs of its full model."""

    part: BoomSection
    number: int  # index of the section in the scene
    pads: tuple[PadRing, ...]  # pads at fixed positions and pads that move along it, also of both joints
    points: tuple[float, ...]  # distances in m of sliding points ahead of s
    point_names: tuple[str, ...]  # names of the rows of `points`
    bounds: tuple[float, float]  # m: least and largest s
    travel: tuple[float, float]  # m: range of s on which rows are defined
    gravity: Gravity | None
    frame: Frame | None
    damping: Damping
    recovery: Recovery | None
    has_joint: bool = False  # whether it slides in another body, or another body in it
    # range of s in m where a moving ring has rows, by name; other rings have the range `travel`
    ring_ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    # for rings on walls that give way: the section of their joint, and first and last position in m of their centres
    flexible_ring_ranges: Mapping[str, tuple[int, float, float]] = field(default_factory=dict)
    # position in m of the fixed end of each rigid overlap, by the names of its two rows
    overlap_ends: Mapping[tuple[str, str], float] = field(default_factory=dict)
    cylinder: LuffingCylinder | None = None  # luffing cylinder that holds the base
    # all other sections, each with empty `other_sections`, if the model of this one is ``auto``
    other_sections: tuple[Member, ...] = ()

    @property
    def signals(self) -> dict[str, SignalBase]:
        """Signals of the loads and of the weight over time, by name.

        Extensions and a moving frame drive a section too, by other inputs.
        """
        return {load.name: load.signal for load in self.part.loads} | self.weight

    @property
    def weight(self) -> dict[str, SignalBase]:
        """Signal of the weight by the name of its input; empty in a moving frame, which has other inputs for it."""
        return {WEIGHT: self.gravity.signal} if self.gravity and self.frame is None else {}

    @property
    def content(self) -> str:
        """Text that is equal for bodies with equal full models: names and the signals of loads are left out of it."""
        part = self.part.model_dump_json(exclude={"name": True, "joint": True, "loads": {"__all__": {"signal"}}})
        extended = self.has_joint and self.number > 0  # an extension accelerates the section
        moving = sorted(self.ring_ranges.items()), sorted(self.flexible_ring_ranges.items())
        rows = self.pads, self.points, self.bounds, self.travel, *moving, self.overlap_ends, self.cylinder
        of_frame = self.frame and (self.frame.out_of_plane_key is None, self.frame.has_angles, self.frame.second_order)
        return repr(
            (part, extended, self.has_joint, rows, self.gravity and self.gravity.direction, of_frame, self.damping)
        )

    @property
    def joint_rows(self) -> frozenset[str]:
        """Names of the rows between this body and other bodies; all other rows are between it and the ground."""
        pads = [name for ring in self.pads if ring.name in self.ring_ranges for name, _, _ in ring.named_pads]
        return frozenset((*pads, POINT, TAIL, *STRAIGHT)) if self.has_joint else frozenset()


def member_at(scene: Scene, number: int = 0) -> Member:
    """Return section `number` of a scene with all inputs of its full model."""
    if len(scene.sections) == 1:
        return _only_member(scene)
    member = _section(scene, number)
    if member.part.body.model != "auto":
        return member
    return replace(member, other_sections=tuple(_section(scene, k) for k in range(len(scene.sections)) if k != number))


def members(scene: Scene) -> tuple[Member, ...]:
    """Return all sections of a scene, from the base outwards, each with all inputs of its full model."""
    return tuple(member_at(scene, number) for number in range(len(scene.sections)))


def _only_member(scene: Scene) -> Member:
    """Return the only body of a scene with all inputs of its full model."""
    points, about = scene.points, (scene.gravity, scene.frame, scene.damping, scene.recovery)
    names = tuple(_slider_name(points, at) for at in points)
    return Member(scene.only_section, 0, scene.pads, points, names, scene.path_bounds, scene.travel, *about)


def _slider_name(points: tuple[float, ...], at: float) -> str:
    """Return the name of the row of the sliding point at `at` m ahead of s; `points` are the offsets of all points."""
    if points == (0.0,):
        return "slider"
    return f"slider at s{at:+g} m" if at else "slider at s"


def _section(scene: Scene, number: int) -> Member:
    """Return a section of a boom with all inputs of its full model, such as the pads of both joints that touch it.

    The pads of both joints have one path coordinate s, the position of pads along the section.  The bounds of s contain
    the positions of all rings at all times, as far as pads fit on the section.  The rows of each ring are defined over
    the bounds, as far as the ring's own length allows.
    """
    part, seats_here = scene.sections[number], list(seats(scene, number))
    faced = [seat for seat in seats_here if seat.ring.faces is not None]
    longest = max((seat.ring.length for seat in faced), default=0.0) / 2.0
    everywhere = _common_range(seats_here)
    reach = max(everywhere.first, longest), min(everywhere.last, part.length - longest)
    points = (0.0,) if len(faced) < len(seats_here) else ()
    rings, stretches = dict[str, PadRing](), dict[str, tuple[float, float]]()
    ways = dict[str, tuple[int, float, float]]()
    for seat in faced:
        name, half = footprint(scene, seat.ring), seat.ring.length / 2.0
        if name not in rings:
            rings[name] = body_ring(seat.ring, name)
            of_footprint = _common_range(
                [seat_of_footprint for seat_of_footprint in faced if footprint(scene, seat_of_footprint.ring) == name]
            )
            taken, last = _common_range(faced), part.length - half
            travel = of_footprint.union(PositionRange(max(taken.first, half), min(taken.last, last)))
            stretches[name] = travel.first, travel.last
            if part.body.walls == "give":
                ways[name] = seat.joint, of_footprint.first, of_footprint.last
    return Member(
        part,
        number,
        pads=(*part.pads, *rings.values()),
        points=points,
        point_names=(POINT,) * len(points),
        bounds=reach,
        travel=reach,
        gravity=scene.gravity,
        frame=scene.frame,
        damping=scene.damping,
        recovery=scene.recovery,
        has_joint=True,
        ring_ranges=stretches,
        flexible_ring_ranges=ways,
        overlap_ends=_straight_rows(scene, number),
        cylinder=None if number else scene.holding_cylinder,
    )


def seats(scene: Scene, number: int) -> Iterator[Seat]:
    """Yield the seat of each ring of joints on a section: rings of its own joint, then of the next section's joint."""
    for k in range(max(number, 1), min(number + 2, len(scene.sections))):  # its own joint and the next section's
        joint, outer = scene.joint(k), scene.sections[k - 1].length
        first, last = scene.extension(k).bounds(0.0, scene.time.end)
        for i, ring in enumerate(joint.tail):
            at = PositionRange(ring.at, ring.at) if k == number else PositionRange(ring.at + first, ring.at + last)
            yield Seat(k, ring, f"tail[{i}]", at)
        for i, ring in enumerate(joint.mouth):
            mouth = outer - ring.at
            at = PositionRange(mouth - last, mouth - first) if k == number else PositionRange(mouth, mouth)
            yield Seat(k, ring, f"mouth[{i}]", at)


def footprint(scene: Scene, ring: JointPads) -> str:
    """Return the name that a ring's pads have in the models of the sections that they touch.

    Rings with equal faces, positions and size share one name, unless walls give way: each ring then has a name of its
    own.
    """
    if ring.faces is None:
        return POINT
    joints = (scene.joint(number) for number in range(1, len(scene.sections)))
    rings = [other for joint in joints for other in joint.rings if other.faces is not None]
    if any(part.body.walls == "give" for part in scene.sections):  # each ring dents the wall at its own position
        return f"pads {[other is ring for other in rings].index(True) + 1}"
    patterns = list(dict.fromkeys(_ring_key(other) for other in rings))
    return f"pads {patterns.index(_ring_key(ring)) + 1}"


def _straight_rows(scene: Scene, number: int) -> dict[tuple[str, str], float]:
    """Positions in m along a section of the fixed ends of its rigid overlaps, by the names of two rows.

    A key is `WITHIN` or `AROUND`, the names of the two rows that keep the section straight in the overlap.
    """
    ends = {}
    if number and (joint := scene.joint(number)).rigid_overlap:
        ends[WITHIN] = joint.least_distance(joint.tail)
    if number + 1 < len(scene.sections) and (following := scene.joint(number + 1)).rigid_overlap:
        ends[AROUND] = scene.sections[number].length - following.least_distance(following.mouth)
    return ends


def body_ring(ring: JointPads, name: str) -> PadRing:
    """Return a joint's ring as a ring called `name` that moves along a body."""
    assert ring.faces is not None
    return PadRing(
        name=name, moving=True, faces=ring.faces, length=ring.length, width=ring.width, stiffness=ring.stiffness
    )


def _ring_key(ring: JointPads) -> tuple[object, ...]:
    """Return faces, positions, length and width of a ring as a key that is equal for rings that may share a name."""
    assert ring.faces is not None
    return (tuple((face, tuple(places)) for face, places in sorted(ring.faces.items())), ring.length, ring.width)


def _common_range(taken: list[Seat]) -> PositionRange:
    """Return the smallest range that contains the positions of all `taken` seats."""
    return PositionRange(
        float(np.min([seat.positions.first for seat in taken])), float(np.max([seat.positions.last for seat in taken]))
    )
