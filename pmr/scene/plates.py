"""Plates around a closed profile, and arcs between them: where they are, and how much room is between two profiles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Pair = tuple[float, float]
Face = Literal["bottom", "bottom left", "left", "top left", "top", "top right", "right", "bottom right"]
Half = Literal["bottom", "top"]
FACES: tuple[Face, ...] = get_args(Face)
#: Components of a unit vector that are less are none.
NOTHING = 1e-9


@dataclass(frozen=True)
class Side:
    """A flat plate of a profile or the arc of a corner, as one walks around it counter-clockwise."""

    name: str  # of its face; of an arc that it is a corner
    start: Pair  # (y, z) m on the mid-surface
    end: Pair
    thickness: float  # m
    centre: Pair | None = None  # of an arc
    angle: float = 0.0  # rad, of an arc

    @property
    def radius(self) -> float:
        """Radius of an arc, m."""
        return 0.0 if self.centre is None else float(np.hypot(*np.subtract(self.start, self.centre)))

    @property
    def length(self) -> float:
        """Length of the mid-line, m."""
        return self.radius * self.angle if self.centre is not None else float(np.hypot(*self._chord))

    def cells(self, size: float) -> int:
        """How many cells of about that size, in m, it is divided into."""
        return max(2, round(self.length / size))

    @property
    def direction(self) -> Array:
        """Unit vector (2,) along a flat plate."""
        return np.asarray(self._chord / np.hypot(*self._chord))

    @property
    def normal(self) -> Array:
        """Unit vector (2,) out of a flat plate."""
        y, z = self.direction
        return np.array([z, -y]) + 0.0

    @property
    def across(self) -> Array:
        """Unit vector (2,) along which places across a flat plate count."""
        along = self.direction
        return np.asarray(np.abs(along) if abs(along).max() > 1.0 - NOTHING else along * np.sign(along[1]))

    @property
    def span(self) -> Pair:
        """Least and largest place across on a flat plate, m, from the one nearest to the axis."""
        low, high = sorted(float(self.across @ end) for end in (self.start, self.end))
        return low, high

    @property
    def _chord(self) -> Array:
        return np.subtract(self.end, self.start)


@dataclass(frozen=True)
class Corner:
    """Corner where two flat plates would meet outside if nothing were rounded."""

    name: str
    at: Pair  # (y, z) m
    thickness: float  # of the thinner one of both, m


@dataclass(frozen=True)
class Edge:
    """A face as if its corners were sharp, and the arc that rounds the corner where it starts."""

    face: Face
    start: Array  # (2,) m
    end: Array
    thickness: float  # m
    arc: str  # name of the arc
    radius: float  # m; 0: none
    arc_thickness: float

    @cached_property
    def length(self) -> float:
        """Between the corners, m."""
        return math.hypot(*(self.end - self.start))

    @cached_property
    def along(self) -> Array:
        """Unit vector (2,)."""
        return np.asarray((self.end - self.start) / self.length)

    @property
    def out(self) -> Array:
        """Unit vector (2,) out of the profile."""
        return np.array([self.along[1], -self.along[0]])

    def turn(self, before: Edge) -> float:
        """Angle of the corner where it starts, rad."""
        return math.acos(max(-1.0, min(1.0, float(before.along @ self.along))))

    def trim(self, before: Edge) -> float:
        """Length that the arc at this corner takes from both plates, m."""
        return self.radius * math.tan(self.turn(before) / 2.0)


def sides_of(edges: Sequence[Edge], nothing: float) -> tuple[Side, ...]:
    """Flat plates longer than `nothing`, and arcs."""
    sides = list[Side]()
    for k, edge in enumerate(edges):
        after = edges[(k + 1) % len(edges)]
        a, b = edge.start + edge.trim(edges[k - 1]) * edge.along, edge.end - after.trim(edge) * edge.along
        if (b - a) @ edge.along > nothing:
            sides.append(Side(edge.face, _pair(a), _pair(b), edge.thickness))
        if after.radius:
            end, centre = after.start + after.trim(edge) * after.along, b - after.radius * edge.out
            angle = after.turn(edge)
            sides.append(Side(after.arc, _pair(b), _pair(end), after.arc_thickness, _pair(centre), angle))
    return tuple(sides)


def corners_of(edges: Sequence[Edge]) -> tuple[Corner, ...]:
    """Corners of a profile as if all were sharp."""
    corners = list[Corner]()
    for k, edge in enumerate(edges):
        before = edges[k - 1]
        walls = np.array([before.thickness, edge.thickness])
        at = edge.start + np.linalg.solve(np.array([before.out, edge.out]), walls / 2.0)
        up, side = sorted((before.face, edge.face), key=lambda face: face not in ("bottom", "top"))
        name = f"{before.face} - {edge.face}" if " " in up + side else f"{up} {side}"
        corners.append(Corner(name, _pair(at), float(walls.min())))
    return tuple(corners)


def gaps(inner: Sequence[Side], outer: Sequence[Side]) -> dict[str, float]:
    """Between what is outside a profile and inside one around it, by face of the outer one, corners as others, m.

    Negative: so far it stands out.
    """
    places = [place for k in range(len(inner)) for place in _outside(inner, k)]
    gap_of_face = dict[str, float]()
    for side in outer:
        if side.centre is None:
            room = [float(side.normal @ (np.array(side.start) - p)) - side.thickness / 2.0 for p in places]
        else:
            arms = [p - side.centre for p in places]
            within = [float(np.hypot(*arm)) for arm in arms if _faces(side, arm)]
            room = [side.radius - side.thickness / 2.0 - distance for distance in within]
        gap_of_face[side.name] = min(room, default=np.inf)
    return gap_of_face


def _outside(sides: Sequence[Side], k: int) -> list[Array]:
    """Points outside a side: the mitred corner where it meets a flat plate, else its ends, and places on an arc."""
    side, after = sides[k], sides[(k + 1) % len(sides)]
    out = side.thickness / 2.0
    if side.centre is not None:
        y, z = np.subtract(side.start, side.centre)
        angles = np.arctan2(z, y) + np.linspace(0.0, side.angle, 33)
        return [side.centre + (side.radius + out) * np.array([np.cos(angle), np.sin(angle)]) for angle in angles]
    if after.centre is None:
        normals = np.array([side.normal, after.normal])
        return [side.end + np.linalg.solve(normals, np.array([side.thickness, after.thickness]) / 2.0)]
    return [np.array(end) + side.normal * out for end in (side.start, side.end)]


def _faces(arc: Side, arm: Array) -> bool:
    """Whether a direction from an arc's centre leads to the arc."""
    middle = np.add(arc.start, arc.end) / 2.0 - np.asarray(arc.centre)
    return bool(middle @ arm >= np.cos(arc.angle / 2.0) * np.hypot(*middle) * np.hypot(*arm) - 1e-12)


def _pair(p: Array) -> Pair:
    return float(p[0]), float(p[1])
