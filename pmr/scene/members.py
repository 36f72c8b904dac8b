"""Bodies of a scene with all inputs of their full models, and the positions of joints' contacts on the bodies."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pmr.scene.box import Box
from pmr.scene.built import WEIGHT, Gravity, PadRing
from pmr.scene.cylinder import LuffingCylinder
from pmr.scene.frame import Frame
from pmr.scene.joints import BoomSection, JointPads
from pmr.scene.keys import Point
from pmr.scene.scene import Scene
from pmr.scene.signals import SignalBase
from pmr.scene.signals.base import Interval

#: Names of the row of sliding points on a planar beam, and of the rows along the boom by which its own cylinder holds a
#: section's tail, and by which that of the next section does if its line of action is another one.
POINT, TAIL, NEXT_TAIL = "deflection", "tail x", "tail x of the next cylinder"
#: Names of the rows that keep a planar beam straight in an overlap: where it is within the next outer section, and
#: where the next inner section is within it.
WITHIN, AROUND = ("straight within at the tail", "straight within"), ("straight around at the mouth", "straight around")
STRAIGHT = (*WITHIN, *AROUND)
#: The input that accelerates a section along the boom.
EXTENSION = "extension"


@dataclass(frozen=True)
class Seat:
    """A ring of pads of a joint, on a section that the ring touches.

    The pads' centres are within `positions` along the section over the simulated time.  `joint` is the number of the
    section whose joint the ring belongs to.  `key` is the ring's key in that joint, such as ``tail[0]``.
    """

    joint: int
    ring: JointPads
    key: str
    positions: Interval


@dataclass(frozen=True)
class MovingPads:
    """Ring of pads of a joint in the model of a section along which the pads move.

    The ring stands for all rings with the same name (`ring_name`).  The pads' centres are within `positions` over the
    simulated time; rows of the pads are defined over `travel`.
    """

    joint: int  # number of the section to whose joint the first of these rings belongs
    ring: PadRing
    positions: Interval
    travel: Interval


class RopePlace(NamedTuple):
    """Place of a section on which a rope acts: where a load on it acts, and x, y and z in m from the section's tail."""

    on: float | str
    at: tuple[float, float, float]


@dataclass(frozen=True)
class Member:
    """Section `number` of a scene with all inputs of its full model.

    The pads of both joints that touch the section are among these inputs.  All pads share one path coordinate s, their
    position along the section.
    """

    scene: Scene
    number: int = 0

    @property
    def part(self) -> BoomSection:
        """Tables of the section in the scene."""
        return self.scene.sections[self.number]

    @property
    def box(self) -> Box:
        """Box of the section, for models that the scene's checks allow with a box alone."""
        assert self.part.body.box is not None
        return self.part.body.box

    @property
    def has_joint(self) -> bool:
        """Whether the body slides in another body, or another body slides in this one."""
        return len(self.scene.sections) > 1

    @property
    def gravity(self) -> Gravity | None:
        """Weight of all bodies of the scene; None without gravity."""
        return self.scene.gravity

    @property
    def frame(self) -> Frame | None:
        """Moving frame of the scene; None if the scene has no frame."""
        return self.scene.frame

    @property
    def carries_carriages(self) -> bool:
        """Whether the body is in a joint and none of its joints has pads at a mouth: only carriages slide there."""
        return self.has_joint and not any(self.scene.joint(seat.joint).mouth for seat in self._seats)

    @property
    def cylinder(self) -> LuffingCylinder | None:
        """Luffing cylinder that holds the base; None for other sections, or if supports hold the base."""
        return None if self.number else self.scene.holding_cylinder

    @cached_property
    def _seats(self) -> list[Seat]:
        """Seats of all rings of joints on the section."""
        return list(seats(self.scene, self.number))

    @cached_property
    def moving_pads(self) -> dict[str, MovingPads]:
        """Rings of joints on faces of the section, by name (`ring_name`), with the ranges of their positions."""
        on_faces, by_name = [seat for seat in self._seats if seat.ring.faces is not None], dict[str, list[Seat]]()
        for seat in on_faces:
            by_name.setdefault(ring_name(self.scene, seat.ring), []).append(seat)
        rings = dict[str, MovingPads]()
        for name, alike in by_name.items():
            ring, positions = body_ring(alike[0].ring, name), _common_range(alike)
            travel = positions.union(self._range_on_section(on_faces, ring.length))
            rings[name] = MovingPads(alike[0].joint, ring, positions, travel)
        return rings

    @property
    def pad_positions(self) -> dict[str, list[Interval]]:
        """Ranges in m of the positions of pads of joints over the simulated time, by the names of the pads' rows."""
        positions = dict[str, list[Interval]]()
        for seat in self._seats:
            if seat.ring.faces is not None:
                for name, _, _ in body_ring(seat.ring, ring_name(self.scene, seat.ring)).named_pads:
                    positions.setdefault(name, []).append(seat.positions)
        return positions

    @property
    def pads(self) -> tuple[PadRing, ...]:
        """Rings of pads on the ground, and those on faces in both joints, which move along the section."""
        return (*self.part.pads, *(pads.ring for pads in self.moving_pads.values()))

    @property
    def points(self) -> tuple[float, ...]:
        """Distances in m of the body's sliding points ahead of the path coordinate s.

        The result is empty if pads slide on the body, or if nothing slides on it.
        """
        if not self.has_joint:
            return self.scene.points
        return (0.0,) if any(seat.ring.faces is None for seat in self._seats) else ()

    @property
    def point_names(self) -> tuple[str, ...]:
        """Names of the rows of `points`."""
        if self.has_joint:
            return (POINT,) * len(self.points)
        return tuple(_slider_name(self.points, at) for at in self.points)

    @property
    def bounds(self) -> Interval:
        """Least and largest path coordinate s in m over the simulated time.

        For a section of a boom, these are the positions of all pads of its joints.  Positions in which the longest pad
        would not be wholly on the section are left out.
        """
        return self._reach if self.has_joint else self.scene.path_bounds

    @property
    def travel(self) -> Interval:
        """Range of s in m on which rows are defined, unless `ring_ranges` has another one."""
        return self._reach if self.has_joint else self.scene.travel

    @cached_property
    def _reach(self) -> Interval:
        """Range in m of the positions of all rings of joints, as far as the longest ring is wholly on the section."""
        longest = max((pads.ring.length for pads in self.moving_pads.values()), default=0.0)
        return self._range_on_section(self._seats, longest)

    def _range_on_section(self, all_seats: Sequence[Seat], length: float) -> Interval:
        """Return the range in m of those positions of the seats at which a ring of this `length` is on the section."""
        low, high = _common_range(all_seats)
        return Interval(max(low, length / 2.0), min(high, self.part.length - length / 2.0))

    @property
    def ring_ranges(self) -> dict[str, Interval]:
        """Range of s in m in which a moving ring of a joint has rows, by the name of the ring."""
        return {name: pads.travel for name, pads in self.moving_pads.items()}

    @property
    def dented_rings(self) -> dict[str, MovingPads]:
        """Rings of joints on walls that give way, by name; empty if the walls are rigid."""
        return self.moving_pads if self.part.body.walls == "give" else {}

    @property
    def overlap_ends(self) -> dict[tuple[str, str], float]:
        """Position in m along the section of the fixed end of each rigid overlap; empty without a rigid overlap.

        The overlap with the section before has the key `WITHIN`, that with the section after has `AROUND`.  Each of
        these keys is a pair: the names of the two rows that keep this section straight in the overlap.
        """
        ends, scene, number = dict[tuple[str, str], float](), self.scene, self.number
        if number and (joint := scene.joint(number)).rigid_overlap:
            ends[WITHIN] = min(ring.at for ring in joint.tail)
        if number + 1 < len(scene.sections) and (following := scene.joint(number + 1)).rigid_overlap:
            ends[AROUND] = self.part.length - min(ring.at for ring in following.mouth)
        return ends

    @property
    def tail_points(self) -> dict[str, Point | None]:
        """Points in m at which cylinders or ropes hold the section's tail, by the names of their rows; None: centroid.

        The first point is that of the section's own cylinder or rope, which the base lacks.  The second one is that of
        the next section's, which the last section lacks.  If both have the same line of action, they share a row.  The
        result is empty without a joint.
        """
        numbers = range(max(self.number, 1), min(self.number + 2, len(self.scene.sections)))
        lines = dict.fromkeys(self.scene.joint(number).line for number in numbers)
        points = [None if line is None else (0.0, *line) for line in lines]
        return dict(zip((TAIL, NEXT_TAIL), points, strict=False))

    @property
    def signals(self) -> dict[str, SignalBase]:
        """Signals of the loads and of the weight over time, by name.

        Extensions and a moving frame drive a section too, by other inputs.
        """
        return {load.name: load.signal for load in self.part.loads} | self.weight

    @property
    def weight(self) -> dict[str, SignalBase]:
        """Signal of the weight by the name of its input; empty in a moving frame, which has inertia inputs instead."""
        return {WEIGHT: self.gravity.signal} if self.gravity and self.frame is None else {}

    @property
    def rope_places(self) -> dict[str, RopePlace]:
        """Places of the section on which the rope of a hoist acts, by ``head`` and ``winch``; empty without a hoist."""
        hoist, name = self.scene.hoist, self.scene.names[self.number]
        places = dict[str, RopePlace]()
        if hoist is not None and (hoist.section or self.scene.names[-1]) == name:
            at = self.part.length if hoist.on == "tip" else float(hoist.on)
            places["head"] = RopePlace(hoist.on, (at, *hoist.offset))
        if hoist is not None and hoist.winch.section and hoist.winch.section == name:
            places["winch"] = RopePlace(hoist.winch.at[0], hoist.winch.at)
        return places

    @property
    def content(self) -> str:
        """Text that is equal for bodies with equal full models, without names and without the signals of loads."""
        part = self.part.model_dump_json(exclude={"name": True, "joint": True, "loads": {"__all__": {"signal"}}})
        extended = self.has_joint and self.number > 0  # an extension accelerates the section
        moving = sorted(self.ring_ranges.items()), sorted(self.dented_rings)
        dented = [(pads.joint, pads.positions) for _, pads in sorted(self.dented_rings.items())]
        rows = self.pads, self.points, self.bounds, self.travel, moving, dented, self.overlap_ends, self.cylinder
        of_frame = self.frame and (self.frame.out_of_plane_key is None, self.frame.has_angles, self.frame.second_order)
        about = self.gravity and self.gravity.direction, of_frame, self.scene.damping, tuple(self.tail_points.items())
        return repr((part, extended, self.has_joint, rows, about, *self.rope_places.items()))

    @property
    def joint_rows(self) -> frozenset[str]:
        """Names of the rows between this body and other bodies; all other rows are between the body and the ground."""
        pads = [name for moving in self.moving_pads.values() for name, _, _ in moving.ring.named_pads]
        return frozenset((*pads, POINT, TAIL, NEXT_TAIL, *STRAIGHT)) if self.has_joint else frozenset()


def member_at(scene: Scene, number: int = 0) -> Member:
    """Return section `number` of a scene with all inputs of its full model."""
    return Member(scene, number)


def members(scene: Scene) -> tuple[Member, ...]:
    """Return all sections of a scene, from the base outwards, each with all inputs of its full model."""
    return tuple(Member(scene, number) for number in range(len(scene.sections)))


def _slider_name(points: tuple[float, ...], at: float) -> str:
    """Return the name of the row of the sliding point at `at` m ahead of s; `points` are the offsets of all points."""
    if points == (0.0,):
        return "slider"
    return f"slider at s{at:+g} m" if at else "slider at s"


def seats(scene: Scene, number: int) -> Iterator[Seat]:
    """Yield the seat of each ring of joints on section `number`: rings of its own joint, then of the next section's."""
    for k in range(max(number, 1), min(number + 2, len(scene.sections))):  # its own joint and the next section's
        joint, outer = scene.joint(k), scene.sections[k - 1].length
        first, last = scene.extension(k).bounds(0.0, scene.time.end)
        for i, ring in enumerate(joint.tail):
            at = Interval(ring.at, ring.at) if k == number else Interval(ring.at + first, ring.at + last)
            yield Seat(k, ring, f"tail[{i}]", at)
        for i, ring in enumerate(joint.mouth):
            mouth = outer - ring.at
            at = Interval(mouth - last, mouth - first) if k == number else Interval(mouth, mouth)
            yield Seat(k, ring, f"mouth[{i}]", at)


def ring_name(scene: Scene, ring: JointPads) -> str:
    """Return the name, such as ``pads 1``, that a ring has in the models of the two sections in contact.

    Rings with equal faces, positions and size share one name, unless walls give way: each ring then has a name of its
    own.  Rings without faces are called `POINT`.
    """
    if ring.faces is None:
        return POINT
    joints = (scene.joint(number) for number in range(1, len(scene.sections)))
    rings = [other for joint in joints for other in joint.rings if other.faces is not None]
    if any(part.body.walls == "give" for part in scene.sections):  # each ring dents the wall at its own position
        return f"pads {[other is ring for other in rings].index(True) + 1}"
    patterns = list(dict.fromkeys(_ring_key(other) for other in rings))
    return f"pads {patterns.index(_ring_key(ring)) + 1}"


def body_ring(ring: PadRing | JointPads, name: str) -> PadRing:
    """Return pads on faces as a ring called `name` that moves along a body, holds both ways and has no clearance."""
    assert ring.faces is not None
    return PadRing(
        name=name, moving=True, faces=ring.faces, length=ring.length, width=ring.width, stiffness=ring.stiffness
    )


def name_in_scene(body: str, key: str, ring: PadRing | JointPads) -> str:
    """Return the name of a ring of pads in the whole scene, such as ``fly tail``.

    `body` is the name of the body that has the ring, and `key` that of the ring there, such as ``joint.tail[0]``.
    """
    end = key.partition("[")[0].removeprefix("joint.").removeprefix("pads")
    return " ".join(filter(None, (body, end, ring.name)))


class PadOnFace(NamedTuple):
    """Pad on a face of the body: its ring, and the name of the face."""

    ring: PadRing | JointPads
    face: str

    @property
    def area(self) -> float:
        """Length times width of the pad in m^2."""
        return self.ring.length * self.ring.width

    @property
    def allowed_force(self) -> float:
        """Force in N at which the mean pressure is the allowed one; infinite if the ring states none."""
        return np.inf if self.ring.allowed_pressure is None else self.ring.allowed_pressure * self.area


def pads_on_faces(scene: Scene) -> dict[str, PadOnFace]:
    """Ring and face of each pad of a scene that is on a face, by the pad's name, such as ``fly tail bottom left``."""
    pads = dict[str, PadOnFace]()
    for body, part in scene.bodies.items():
        for key, ring in part.keyed_rings.items():
            if ring.faces is not None:
                named = body_ring(ring, name_in_scene(body, key, ring))
                pads |= {name: PadOnFace(ring, face) for name, face, _ in named.named_pads}
    return pads


def _ring_key(ring: JointPads) -> tuple[object, ...]:
    """Return faces, positions, length and width of a ring as a key; rings with equal keys may share a name."""
    assert ring.faces is not None
    return (tuple((face, tuple(places)) for face, places in sorted(ring.faces.items())), ring.length, ring.width)


def _common_range(all_seats: Sequence[Seat]) -> Interval:
    """Return the smallest range in m that contains the positions of the seats, one or more."""
    return Interval(min(seat.positions.low for seat in all_seats), max(seat.positions.high for seat in all_seats))
