"""A box boom described by its dimensions: profile, doublers, tapers and frames, and how its section varies along x."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator

from pmr.scene.keys import Distance, Length, SceneTable, Size, Thickness, Usual, key_error
from pmr.scene.profile import BoxProfile, Cut, Edge, Face, Half, Side, WallName, shifted_corner
from pmr.scene.signals.base import Interval

#: Least distance between breaks along a box as a share of its length: beams on shorter elements lose accuracy.
LEAST_BREAK_DISTANCE = 1e-3
#: Round-off of a user's arithmetic, as a share of a length.
SLACK = 1e-9
HALVES: tuple[Half, ...] = ("bottom", "top")


#: How far the middle of a wall moves outwards by a plate, over the plate's thickness, by the side of the wall.
SIDES = {"middle": 0.0, "outer": 0.5, "inner": -0.5}


class Doubler(SceneTable):
    """Plates on walls over a part of the length: the walls are thicker there, on one side or about their middle."""

    start: Distance = Field(description="Where the plates begin along x")
    end: Length = Field(description="Where the plates end along x")
    thickness: Thickness = Field(description="Thickness of the plates")
    faces: tuple[Face, ...] | None = Field(
        default=None,
        min_length=1,
        description="Faces with plates, by default all; rounded corners go with bottom and top",
    )
    side: Literal["middle", "outer", "inner"] = Field(
        default="middle",
        description="Side of the wall on which the plates lie; middle: half of their thickness on each side",
    )

    def thickness_on(self, name: WallName) -> float:
        """Return the thickness in m that the plates add to the wall `name`.

        The name is that of a face; for rounded corners it is bottom or top.
        """
        return self.thickness if self.faces is None or name in self.faces else 0.0


class Taper(SceneTable):
    """Linear change of the profile towards an end of the box; the axis stays the same.

    Dimensions for which no value at the end is given are constant.
    """

    length: Length = Field(description="Length over which the profile changes, up to the end")
    width: Annotated[Length, Usual(0.002, 10.0)] | None = Field(default=None, description="Width at the end, along y")
    height: Annotated[Length, Usual(0.002, 10.0)] | None = Field(default=None, description="Height at the end, along z")
    wall: Thickness | dict[WallName, Thickness] | None = Field(
        default=None, description="Thickness of the walls at the end"
    )
    radius: Distance | dict[Half, Distance] | None = Field(default=None, description="Radius of the corners at the end")
    chamfer: Distance | Cut | dict[Half, Distance | Cut] | None = Field(
        default=None, description="What is cut off the corners at the end"
    )


class ShiftedProfile(BoxProfile):
    """A profile whose plates are farther out than its dimensions say, by `shifts` in m; no scene has this table."""

    shifts: dict[WallName, float]

    @property
    def edges(self) -> list[Edge]:
        """Faces as if all corners were sharp, where the shifted plates meet."""
        edges = super().edges
        apart = np.array([self.shift(edge.face) for edge in edges])
        corners = [shifted_corner(edges[k - 1], edge, apart[[k - 1, k]]) for k, edge in enumerate(edges)]
        ends = zip(edges, corners, [*corners[1:], corners[0]], strict=True)
        return [replace(edge, start=start, end=end) for edge, start, end in ends]

    def shift(self, face: str) -> float:
        return {str(name): by for name, by in self.shifts.items()}.get(face, 0.0)

    def radius_at(self, half: Half) -> float:
        """Return the radius in m of the corners in a `half`, which shift with bottom or top; 0 for sharp corners."""
        radius = super().radius_at(half)
        return radius and radius + self.shift(half)


@dataclass(frozen=True)
class Stretch:
    """Range of a box from `start` to `end`, m along x, in which its profile changes linearly from `first` to `last`."""

    start: float
    end: float
    first: BoxProfile
    last: BoxProfile

    @property
    def middle(self) -> float:
        """Middle of the range, m along x."""
        return (self.start + self.end) / 2.0

    def profile_at(self, x: float) -> BoxProfile:
        """Return the profile at `x`, m along the box, between `start` and `end`."""
        return interpolate_profile(self.first, self.last, (x - self.start) / (self.end - self.start))

    def sub_range(self, start: float, end: float) -> Stretch:
        """Return the part of this stretch from `start` to `end`, m along the box.

        A stretch whose profile stays the same is returned whole.
        """
        return self if self.first is self.last else Stretch(start, end, self.profile_at(start), self.profile_at(end))

    @property
    def is_tapered(self) -> bool:
        """Whether the walls' mid-lines change along the stretch; a change of thickness alone does not count."""
        return mid_lines(self.first.sides) != mid_lines(self.last.sides)


def mid_lines(sides: Sequence[Side]) -> list[tuple[object, ...]]:
    """Return start, end and centre of each of the `sides`, which say where their mid-lines are."""
    return [(side.start, side.end, side.centre) for side in sides]


def interpolate_profile(first: BoxProfile, last: BoxProfile, share: float) -> BoxProfile:
    """Return the profile with dimensions (1 - share) * `first` + share * `last`; share is from 0 to 1.

    Both profiles have the same faces, and the same shifts of their plates.
    """
    if first is last or share == 0.0:
        return first

    def mean(a: float, b: float) -> float:
        """Return (1 - share) * a + share * b, which is never outside of a and b."""
        return min(max((1.0 - share) * a + share * b, min(a, b)), max(a, b))  # round-off could go beyond both

    names: dict[WallName, None] = dict.fromkeys((*(edge.face for edge in first.edges), *HALVES))
    cuts = {half: zip(first.cut(half), last.cut(half), strict=True) for half in HALVES}
    radii = {half: [BoxProfile.radius_at(profile, half) for profile in (first, last)] for half in HALVES}
    dimensions = {
        "width": mean(first.width, last.width),
        "height": mean(first.height, last.height),
        "wall": {name: mean(first.thickness(name), last.thickness(name)) for name in names},
        "radius": {half: mean(*ends) for half, ends in radii.items()},
        "chamfer": {half: (mean(*y), mean(*z)) for half, (y, z) in cuts.items()},
    }
    if isinstance(first, ShiftedProfile):
        return ShiftedProfile(**dimensions, shifts=first.shifts)
    return BoxProfile(**dimensions)


class Box(BoxProfile):
    """A tube of plates along x by the dimensions of its mid-surface; width along y, height along z.

    With `sizes`, these dimensions and those at the ends of tapers are of the outer or inner surface of the walls.
    """

    length: Length = Field(description="Length along x")
    doublers: tuple[Doubler, ...] = Field(default=(), description="Plates that thicken walls over a part of the length")
    tail_taper: Taper | None = Field(default=None, description="How the box tapers towards its tail")
    tip_taper: Taper | None = Field(default=None, description="How the box tapers towards its tip")
    frames: tuple[Size, ...] = Field(default=(), description="Places along x of transverse plates within the box")
    frame_depth: Distance | Literal["full"] = Field(
        default=0.0, description="How far these plates reach inwards from the wall; full: they close the section"
    )
    frame_thickness: Thickness | None = Field(
        default=None, description="Thickness of these plates, by default that of the thickest wall"
    )

    @model_validator(mode="after")
    def _check_variation(self) -> Box:
        """Refuse tapers and doublers that do not fit the box, breaks along x too close to each other, and thick walls.

        Walls are too thick if the profile has no room for its doublers.
        """
        apart = LEAST_BREAK_DISTANCE * self.length
        for key, taper in self._tapers.items():
            self._check_taper(key, taper)
        for i, doubler in enumerate(self.doublers):
            key = f"doublers[{i}]"
            least = doubler.start + apart
            if not least <= doubler.end <= (1.0 + SLACK) * self.length:
                allowed = f"from {least:g} m up to the length, {self.length:g} m, is allowed"
                raise key_error(f"{key}.end", doubler.end, allowed)
            strange = next((face for face in doubler.faces or () if face not in self._face_names), None)
            if strange:
                allowed = f"faces of this profile are allowed: {', '.join(self._face_names)}"
                raise key_error(f"{key}.faces", strange, allowed)
        for a, b in pairwise(self.breaks):
            if b - a < (1.0 - SLACK) * apart:
                allowed = f"one place, or places {apart:g} m apart, a thousandth of the length, are allowed"
                raise key_error(self.varying_keys[0], None, f"{allowed}: something ends at {a:.6g} and at {b:.6g} m")
            self._stretch(a, b)
        return self

    def mid_dimensions(self, sign: float) -> dict[str, Any]:
        """Return, by key, the dimensions of the mid-surface of a box that has `sizes`.

        The keys are those of `BoxProfile.mid_dimensions`, and ``tail_taper`` and ``tip_taper``, tables with the
        dimensions at the end of the taper.  `sign` is -1 if the box has the dimensions of the outer surface, 1 if those
        of the inner one.
        """
        dimensions = super().mid_dimensions(sign)
        for key, taper in self._tapers.items():
            end = self._end_profile(taper).mid_dimensions(sign)
            dimensions[key] = taper.model_dump(exclude_none=True) | {
                name: end[name] for name in dimensions if name in end
            }
        return dimensions

    @property
    def frame_plate_thickness(self) -> float:
        """Thickness in m of the transverse plates `frames`: `frame_thickness`, or that of the thickest wall."""
        return self.frame_thickness or max(self.walls.values())

    @property
    def volume(self) -> float:
        """Volume of the walls in m^3, with doublers and tapers, without frames.

        All dimensions are linear in x between breaks.  A plate's area is thickness times length, so Simpson's rule is
        exact.
        """
        areas = [
            [
                sum(s.thickness * s.length for s in profile.sides)
                for profile in (of.first, of.profile_at(of.middle), of.last)
            ]
            for of in self.stretches
        ]
        return sum(
            (of.end - of.start) * (a + 4.0 * b + c) / 6.0 for of, (a, b, c) in zip(self.stretches, areas, strict=True)
        )

    @property
    def varying_keys(self) -> tuple[str, ...]:
        """Keys of the box that make its section vary along x; empty for a uniform box."""
        return tuple(key for key in ("doublers", "tail_taper", "tip_taper") if getattr(self, key))

    @property
    def breaks(self) -> list[float]:
        """Positions along x in m, ascending, where a doubler or taper begins or ends, and both ends of the box.

        Positions that are equal to round-off are one.
        """
        low, high = self.untapered_range
        breaks = [0.0]
        for at in sorted([low, high, *(at for doubler in self.doublers for at in (doubler.start, doubler.end))]):
            if SLACK * self.length < at - breaks[-1] and at < (1.0 - SLACK) * self.length:
                breaks.append(at)
        return [*breaks, self.length]

    @property
    def untapered_range(self) -> Interval:
        """First and last position along x in m between which no taper changes the dimensions."""
        low, high = (0.0 if taper is None else taper.length for taper in (self.tail_taper, self.tip_taper))
        return Interval(low, self.length - high)

    @property
    def parallel_range(self) -> Interval:
        """First and last position along x in m between which all faces are parallel to the axis.

        A taper that changes only the thickness of the walls leaves the faces parallel.
        """
        low, high = self.untapered_range
        tapering = [stretch for stretch in self.stretches if stretch.is_tapered]
        behind, before = any(stretch.start < low for stretch in tapering), any(part.end > high for part in tapering)
        return Interval(low if behind else 0.0, high if before else self.length)

    @property
    def stretches(self) -> list[Stretch]:
        """Ranges along x between neighbouring `breaks`, in ascending order, with their doublers."""
        return [self._stretch(a, b) for a, b in pairwise(self.breaks)]

    def profile_at(self, x: float) -> BoxProfile:
        """Return the profile at x in m with its doublers; at a break, that of the stretch which begins there.

        At the tip it is that of the last stretch.
        """
        pairs = list(pairwise(self.breaks))
        return self._stretch(*next((pair for pair in pairs if x < pair[1]), pairs[-1])).profile_at(x)

    @property
    def _tapers(self) -> dict[str, Taper]:
        """Tapers that the box has, by the keys ``tail_taper`` and ``tip_taper``."""
        tapers = {"tail_taper": self.tail_taper, "tip_taper": self.tip_taper}
        return {key: taper for key, taper in tapers.items() if taper is not None}

    @property
    def _face_names(self) -> list[Face]:
        """Names of the faces of the profile."""
        return [edge.face for edge in self.edges]

    def _check_taper(self, key: str, taper: Taper) -> None:
        """Refuse a taper without dimensions, one that is too long, and a wrong profile at its end.

        The profile at the end must not be wider or higher than the box, and must have the same faces and rounded
        corners.  `key` is the taper's key.
        """
        dimensions: dict[str, Any] = taper.model_dump(exclude={"length"}, exclude_none=True)
        if not dimensions:
            raise key_error(key, None, "a dimension at the end is needed: width, height, wall, radius or chamfer")
        low, high = self.untapered_range
        if low > high + SLACK * self.length:
            allowed = f"tapers of up to the box's length, {self.length:g} m, are allowed together"
            raise key_error(f"{key}.length", taper.length, allowed)
        thicker = max(self.walls.values()) - min(taper_walls) if (taper_walls := _wall_values(taper)) else 0.0
        for name in ("width", "height"):
            if dimensions.get(name, 0.0) > getattr(self, name) + max(thicker, 0.0):
                allowed = f"up to the box's own {getattr(self, name):g} m is allowed"
                raise key_error(f"{key}.{name}", dimensions[name], allowed)
        try:
            end = self._end_profile(taper)
        except ValidationError as error:
            first_error = error.errors()[0]
            name = str(first_error.get("ctx", {}).get("key", "wall"))
            raise key_error(f"{key}.{name}", dimensions.get(name), f"at the end, {first_error['msg']}") from None
        kinds = [[side.name if side.centre is None else None for side in profile.sides] for profile in (self, end)]
        if kinds[0] != kinds[1]:
            allowed = "the faces and rounded corners of the box are allowed at the end too: none may come or go"
            raise key_error(f"{key}.{next(iter(dimensions))}", None, allowed)

    def _end_profile(self, taper: Taper) -> BoxProfile:
        """Return the profile at the end of a taper; dimensions that the taper lacks are those of the box."""
        dimensions = {key: getattr(self, key) for key in BoxProfile.model_fields}
        return BoxProfile(**(dimensions | {k: v for k in dimensions if (v := getattr(taper, k)) is not None}))

    def _profile_without_doublers(self, x: float) -> BoxProfile:
        """Return the profile at x in m without doublers."""
        low, high = self.untapered_range
        if self.tail_taper is not None and x < low:
            return interpolate_profile(self, self._end_profile(self.tail_taper), 1.0 - x / low)
        if self.tip_taper is not None and x > high:
            return interpolate_profile(self, self._end_profile(self.tip_taper), (x - high) / (self.length - high))
        return self

    def _stretch(self, start: float, end: float) -> Stretch:
        """Return the stretch between two neighbouring breaks `start` and `end`, m, with the doublers that cover it."""
        middle = (start + end) / 2.0
        doublers = {i: doubler for i, doubler in enumerate(self.doublers) if doubler.start < middle < doubler.end}
        first, last = self._profile_without_doublers(start), self._profile_without_doublers(end)
        same = first is last
        if doublers:
            first = self._thicken(first, doublers)
            last = first if same else self._thicken(last, doublers)
        return Stretch(start, end, first, last)

    def _thicken(self, profile: BoxProfile, doublers: dict[int, Doubler]) -> BoxProfile:
        """Return a profile whose walls are thicker by the `doublers`, which are given by their number in the box.

        The middle of a wall with plates on one side is farther out or in than that of the wall alone.

        If the profile has no room for all of them, an error is raised for the key of the first doubler that does not
        fit.
        """
        names: dict[WallName, None] = dict.fromkeys(
            (*self._face_names, *HALVES)
        )  # corners are as thick as the bottom or the top
        walls: dict[WallName, float] = {
            name: profile.thickness(name) + sum(doubler.thickness_on(name) for doubler in doublers.values())
            for name in names
        }
        dimensions = {key: getattr(profile, key) for key in BoxProfile.model_fields} | {"wall": walls}
        shifts = {
            name: sum(SIDES[doubler.side] * doubler.thickness_on(name) for doubler in doublers.values())
            for name in names
        }
        try:
            return ShiftedProfile(**dimensions, shifts=shifts) if any(shifts.values()) else BoxProfile(**dimensions)
        except ValidationError as error:
            *earlier, (i, doubler) = doublers.items()
            self._thicken(profile, dict(earlier))
            why = error.errors()[0]["msg"]
            allowed = f"plates that the profile has room for are allowed; with its walls: {why}"
            raise key_error(f"doublers[{i}].thickness", doubler.thickness, allowed) from None


def _wall_values(taper: Taper) -> list[float]:
    """Return the thicknesses in m of the walls at the end of a taper; empty if the walls stay as thick as they are."""
    wall = taper.wall
    return [] if wall is None else list(wall.values()) if isinstance(wall, dict) else [wall]
