r"""Profiles: the flat plates and rounded corners of a closed cross-section, and the gap between two profiles.

Dimensions are those of the mid-surface.  Seen from the tip y points to the right and z up; sides are numbered
counter-clockwise, from the bottom.  A rectangle loses what a chamfer cuts off its corners, y along and z up, which
leaves slanted plates::

                  top
               __________
    top right /          \ top left         y = -width/2 is the right, y = width/2 the left
             |            |
       right |            | left
             |            |
              \__________/
    bottom right  bottom   bottom left

A coordinate across a face is zero at the face's point nearest to the axis y = z = 0.  It grows with y on bottom and
top, with z on left and right, and upwards on slanted faces.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Literal, Self, get_args

import numpy as np
from pydantic import ConfigDict, Field, ModelWrapValidatorHandler, model_validator

from pmr.files.arrays import Array
from pmr.scene.keys import Distance, Length, SceneTable, Schema, Thickness, Usual, key_error

Pair = tuple[float, float]
Face = Literal["bottom", "bottom left", "left", "top left", "top", "top right", "right", "bottom right"]
Half = Literal["bottom", "top"]
FACES: tuple[Face, ...] = get_args(Face)
#: Components of a unit vector, and lengths as a share of the larger of width and height, that count as zero.
NOTHING = 1e-9


@dataclass(frozen=True)
class Side:
    """A flat plate of a profile or the arc of a rounded corner; start and end are in counter-clockwise order."""

    name: str  # name of the face or, for an arc, of the corner
    start: Pair  # (y, z) m on the mid-surface
    end: Pair
    thickness: float  # m
    centre: Pair | None = None  # (y, z) m of an arc's centre; None for a plate
    angle: float = 0.0  # rad, of an arc; 0 for a plate

    @property
    def radius(self) -> float:
        """Radius of the mid-line in m; 0 for a flat plate."""
        return 0.0 if self.centre is None else float(np.hypot(*np.subtract(self.start, self.centre)))

    @property
    def length(self) -> float:
        """Length of the mid-line, m."""
        return self.radius * self.angle if self.centre is not None else float(np.hypot(*self._chord))

    def cells(self, size: float) -> int:
        """Return the number of cells, two or more, into which a mesh of cell length `size` (m) divides the mid-line."""
        return max(2, round(self.length / size))

    @property
    def direction(self) -> Array:
        """Unit vector (2,) in y and z from the start to the end of a flat plate."""
        return np.asarray(self._chord / np.hypot(*self._chord))

    @property
    def normal(self) -> Array:
        """Outward unit normal (2,) in y and z of a flat plate."""
        y, z = self.direction
        return np.array([z, -y]) + 0.0

    @property
    def across_direction(self) -> Array:
        """Unit vector (2,) in y and z along which the coordinate across a flat plate grows."""
        along = self.direction
        return np.asarray(np.abs(along) if abs(along).max() > 1.0 - NOTHING else along * np.sign(along[1]))

    @property
    def span(self) -> Pair:
        """Least and largest coordinate in m across a flat plate.

        The coordinate is 0 at the point of the plate's plane that is nearest to the axis.
        """
        low, high = sorted(float(self.across_direction @ end) for end in (self.start, self.end))
        return low, high

    @property
    def _chord(self) -> Array:
        """Vector (2,) in m from the start to the end of the side."""
        return np.subtract(self.end, self.start)


@dataclass(frozen=True)
class Corner:
    """Outer corner in which two neighbouring flat plates would meet if it were not rounded."""

    name: str
    position: Pair  # (y, z) m
    thickness: float  # of the thinner plate, m


@dataclass(frozen=True)
class Edge:
    """A face as if its corners were sharp, and the arc that rounds the corner at the start of the face."""

    face: Face
    start: Array  # (2,) m
    end: Array
    thickness: float  # m
    arc: str  # name of the arc
    radius: float  # m; 0: none
    arc_thickness: float

    @cached_property
    def length(self) -> float:
        """Length between the sharp corners, m."""
        return math.hypot(*(self.end - self.start))

    @cached_property
    def direction(self) -> Array:
        """Unit vector (2,) in y and z from start to end."""
        return np.asarray((self.end - self.start) / self.length)

    @property
    def normal(self) -> Array:
        """Outward unit normal (2,) in y and z."""
        return np.array([self.direction[1], -self.direction[0]])

    def turn(self, before: Edge) -> float:
        """Return the angle in rad between the directions of the edge `before` and of this edge, at their corner."""
        return math.acos(max(-1.0, min(1.0, float(before.direction @ self.direction))))

    def trim(self, before: Edge) -> float:
        """Length in m by which the arc at this edge's start shortens both this edge and the edge `before`."""
        return self.radius * math.tan(self.turn(before) / 2.0)


def shifted_corner(before: Edge | Side, after: Edge | Side, apart: Array) -> Array:
    """Return the point (2,) in m where two flat plates meet that are shifted outwards by `apart` (2,) in m."""
    return np.asarray(after.start + np.linalg.solve(np.array([before.normal, after.normal]), apart))


def gaps(inner: Sequence[Side], outer: Sequence[Side]) -> dict[str, float]:
    """Return the gap in m between the outside of an inner profile and the inside of an outer one, by side.

    Keys are the names of the outer profile's faces and rounded corners.  A negative gap is an overlap.  The gap is
    infinite at a rounded corner that no point of the inner profile faces.
    """
    places = [place for k in range(len(inner)) for place in _outer_points(inner, k)]
    gap_of_face = dict[str, float]()
    for side in outer:
        if side.centre is None:
            room = [float(side.normal @ (np.array(side.start) - p)) - side.thickness / 2.0 for p in places]
        else:
            arms = [p - side.centre for p in places]
            within = [float(np.hypot(*arm)) for arm in arms if _is_within_arc(side, arm)]
            room = [side.radius - side.thickness / 2.0 - distance for distance in within]
        gap_of_face[side.name] = min(room, default=np.inf)
    return gap_of_face


def _outer_points(sides: Sequence[Side], k: int) -> list[Array]:
    """Return points (2,) in m on the outside of side number k of a profile.

    For an arc the result has 33 points.  For a flat plate it has the mitred corner with the next plate, or both ends of
    the plate if an arc follows.
    """
    side, after = sides[k], sides[(k + 1) % len(sides)]
    out = side.thickness / 2.0
    if side.centre is not None:
        y, z = np.subtract(side.start, side.centre)
        angles = np.arctan2(z, y) + np.linspace(0.0, side.angle, 33)
        return [side.centre + (side.radius + out) * np.array([np.cos(angle), np.sin(angle)]) for angle in angles]
    if after.centre is None:
        return [shifted_corner(side, after, np.array([side.thickness, after.thickness]) / 2.0)]
    return [np.array(end) + side.normal * out for end in (side.start, side.end)]


def _is_within_arc(arc: Side, arm: Array) -> bool:
    """Whether the vector `arm` (2,) from an arc's centre lies within the arc's angle."""
    middle = np.add(arc.start, arc.end) / 2.0 - np.asarray(arc.centre)
    return bool(middle @ arm >= np.cos(arc.angle / 2.0) * np.hypot(*middle) * np.hypot(*arm) - 1e-12)


def _pair(p: Array) -> Pair:
    """Return the array p (2,) as two floats."""
    return float(p[0]), float(p[1])


WallName = Literal["sides", Face]
Cut = tuple[Distance, Distance]
CORNERS = "corners"


#: Sign by which corners move outwards from the surface that a scene's sizes are of to the mid-surface.
SURFACES = {"middle": 0.0, "outer": -1.0, "inner": 1.0}


def _allow_sizes(schema: Schema) -> None:
    """Change the JSON schema of a profile in place: add the key ``sizes``.

    The key names the surface of the walls whose dimensions a scene gives.
    """
    about = "Surface of the walls that width, height, radius and chamfer are of; all else follows from the mid-surface"
    sizes = {"enum": list(SURFACES), "default": "middle", "type": "string", "description": about}
    schema["properties"] |= {"sizes": sizes}


class BoxProfile(SceneTable):
    """A closed profile of plates, by the dimensions of its mid-surface; width along y, height along z.

    With `sizes` ``outer`` or ``inner``, a scene gives the dimensions of the outer or inner surface of the walls: each
    plate's middle is half its thickness inside or outside of them.
    """

    model_config = ConfigDict(json_schema_extra=_allow_sizes)

    width: Annotated[Length, Usual(0.002, 10.0)] = Field(description="Width along y")
    height: Annotated[Length, Usual(0.002, 10.0)] = Field(description="Height along z")
    wall: Thickness | dict[WallName, Thickness] = Field(
        description="Thickness of the walls: one for all, or by face. `bottom` and `top` include their slanted plates "
        "and rounded corners, `sides` are left and right, in m"
    )
    radius: Annotated[Distance | dict[Half, Distance], Usual(0.0, 5.0)] = Field(
        default=0.0, description="Radius of the corners: one for all, or by `bottom` and `top`, in m"
    )
    chamfer: Annotated[Distance | Cut | dict[Half, Distance | Cut], Usual(0.0, 5.0)] = Field(
        default=0.0,
        description="Size of the chamfers, for all or by `bottom` and `top`: one number, or along y and z, in m",
    )

    @model_validator(mode="wrap")
    @classmethod
    def _resolve_sizes(cls, data: object, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Validate a table; dimensions of one with `sizes` are replaced by those of the mid-surface.

        Other words for `sizes` than those of `SURFACES` are refused.
        """
        if not (isinstance(data, dict) and "sizes" in data):
            return handler(data)
        sizes, dimensions = data["sizes"], {key: value for key, value in data.items() if key != "sizes"}
        if sizes not in SURFACES:
            raise key_error("sizes", sizes, f"one of {', '.join(SURFACES)} is allowed")
        written = handler(dimensions)
        return handler(dimensions | written.mid_dimensions(SURFACES[sizes])) if SURFACES[sizes] else written

    def mid_dimensions(self, sign: float) -> dict[str, Any]:
        """Return the dimensions in m of the mid-surface of the walls whose outer or inner surface has these dimensions.

        The keys are ``width`` and ``height``, and ``radius`` and ``chamfer`` if one is not 0, by ``bottom`` and
        ``top``.  `sign` is -1 if the profile has the dimensions of the outer surface, 1 if those of the inner one.  The
        axis y = z = 0 is in the middle of the dimensions, before and after.  Raises an error of the key `sizes` for
        chamfers between plates that differ left and right.
        """
        edges, by_half = self.edges, dict[Half, tuple[float, float]]()
        ends = np.array([edge.start + sign * (corner.position - edge.start) for edge, corner in
                         zip(edges, self.corners, strict=True)])  # fmt: skip
        low, high = ends.min(axis=0), ends.max(axis=0)
        near = NOTHING * float(np.max(high - low))
        for half, level in zip(get_args(Half), (low[1], high[1]), strict=True):
            flat = ends[np.abs(ends[:, 1] - level) <= near, 0]
            cuts = []
            for side, along in ((low[0], flat.min() - low[0]), (high[0], high[0] - flat.max())):
                upright = ends[np.abs(ends[:, 0] - side) <= near, 1]
                up = upright.min() - level if half == "bottom" else level - upright.max()
                cuts.append((float(along), float(up)))
            if not np.allclose(cuts[0], cuts[1], rtol=0.0, atol=near):
                raise key_error(
                    "sizes", None, "chamfers between plates as thick on the left as on the right are allowed"
                )
            by_half[half] = cuts[0]
        radii = {half: r and r + sign * self.thickness(half) / 2.0 for half in by_half for r in [self.radius_at(half)]}
        cut_off = {half: cut if max(cut) > near else (0.0, 0.0) for half, cut in by_half.items()}
        dimensions: dict[str, Any] = dict(zip(("width", "height"), (high - low).tolist(), strict=True))
        dimensions |= {"radius": radii} if any(radii.values()) else {}
        return dimensions | ({"chamfer": cut_off} if any(max(cut) for cut in cut_off.values()) else {})

    @model_validator(mode="after")
    def _check_closed(self) -> BoxProfile:
        """Refuse chamfers, walls and radii for which the profile does not close."""
        _check_chamfers(self)
        _check_walls(self)
        _check_radii(self)
        return self

    @property
    def edges(self) -> list[Edge]:
        """Faces as if all corners were sharp, in counter-clockwise order; faces without a length are left out."""
        b, h = self.width / 2.0, self.height / 2.0
        (y0, z0), (y1, z1) = self.cut("bottom"), self.cut("top")
        right = [(-b + y1, h), (-b, h - z1), (-b, -h + z0)]
        ends = [np.array(p) for p in [(-b + y0, -h), (b - y0, -h), (b, -h + z0), (b, h - z1), (b - y1, h), *right]]
        alike, edges = self.thickness("bottom") == self.thickness("top"), list[Edge]()
        for face, start, end in zip(FACES, ends, [*ends[1:], ends[0]], strict=True):
            half: Half = "top" if start[1] > -self.negligible else "bottom"
            arc = CORNERS if alike else f"{half} {CORNERS}"
            edge = Edge(face, start, end, self.thickness(face), arc, self.radius_at(half), self.thickness(half))
            edges += [edge] * (edge.length > self.negligible)
        return edges

    @property
    def sides(self) -> tuple[Side, ...]:
        """Flat plates and arcs in counter-clockwise order."""
        sides, edges = list[Side](), self.edges
        for k, edge in enumerate(edges):
            after = edges[(k + 1) % len(edges)]
            a, b = edge.start + edge.trim(edges[k - 1]) * edge.direction, edge.end - after.trim(edge) * edge.direction
            if (b - a) @ edge.direction > self.negligible:
                sides.append(Side(edge.face, _pair(a), _pair(b), edge.thickness))
            if after.radius:
                end, centre = after.start + after.trim(edge) * after.direction, b - after.radius * edge.normal
                angle = after.turn(edge)
                sides.append(Side(after.arc, _pair(b), _pair(end), after.arc_thickness, _pair(centre), angle))
        return tuple(sides)

    @property
    def faces(self) -> dict[str, Side]:
        """Flat plates by the names of their faces."""
        return {side.name: side for side in self.sides if side.centre is None}

    @property
    def corners(self) -> tuple[Corner, ...]:
        """Outer corners in counter-clockwise order; a rounded corner is taken as if it were sharp."""
        corners, edges = list[Corner](), self.edges
        for k, edge in enumerate(edges):
            before = edges[k - 1]
            walls = np.array([before.thickness, edge.thickness])
            at = shifted_corner(before, edge, walls / 2.0)
            up, side = sorted((before.face, edge.face), key=lambda face: face not in ("bottom", "top"))
            name = f"{before.face} - {edge.face}" if " " in up + side else f"{up} {side}"
            corners.append(Corner(name, _pair(at), float(walls.min())))
        return tuple(corners)

    @property
    def walls(self) -> dict[str, float]:
        """Thickness in m by the name of each face and arc; if all are equal, a single entry with the key ``""``."""
        each = {side.name: side.thickness for side in self.sides}
        return each if len(set(each.values())) > 1 else {"": next(iter(each.values()))}

    @property
    def negligible(self) -> float:
        """Length in m below which another length of the profile counts as zero."""
        return NOTHING * max(self.width, self.height)

    def thickness(self, face: str) -> float:
        """Return the thickness in m of the plate on a face; 0 if `wall` has no entry for it.

        Without an entry of their own, left and right have that of ``sides``, and slanted faces that of ``bottom`` or
        ``top``, the first word of their names.  The rounded corners at the bottom are as thick as the face ``bottom``,
        those at the top as the face ``top``.
        """
        if not isinstance(self.wall, dict):
            return self.wall
        by_name = {str(name): wall for name, wall in self.wall.items()}
        half = "sides" if face in ("left", "right") else face.split()[0]
        return by_name.get(face, by_name.get(half, 0.0))

    def shift(self, face: str) -> float:
        """Distance in m by which the plate on a face is farther out than the dimensions say, as doublers shift it."""
        return 0.0

    def radius_at(self, half: Half) -> float:
        """Return the radius in m of the corners in a `half`, bottom or top; 0 if `radius` does not name it."""
        return self.radius.get(half, 0.0) if isinstance(self.radius, dict) else self.radius

    def cut(self, half: Half) -> Pair:
        """Return the lengths in m along y and z that chamfers cut off the corners in a `half`, bottom or top.

        Both are 0 if `chamfer` does not name the half.
        """
        cut = self.chamfer.get(half, 0.0) if isinstance(self.chamfer, dict) else self.chamfer
        return cut if isinstance(cut, tuple) else (cut, cut)


def _check_chamfers(profile: BoxProfile) -> None:
    """Refuse chamfers that do not fit into the profile.

    A chamfer has to cut off something along y and along z, or nothing.  Along y it is at most half the width; along z,
    those at bottom and top together are at most the height.
    """
    cuts = profile.cut("bottom"), profile.cut("top")
    wide = any(bool(y) != bool(z) or y > profile.width / 2.0 + profile.negligible for y, z in cuts)
    if wide or sum(z for _, z in cuts) > profile.height + profile.negligible:
        allowed = (
            f"0 is allowed, or up to {profile.width / 2.0:g} m along y, half the width, and along z as much as leaves "
            f"bottom and top {profile.height:g} m together, the height"
        )
        raise key_error("chamfer", profile.chamfer, allowed)


def _check_walls(profile: BoxProfile) -> None:
    """Refuse walls without a thickness, of faces that the profile does not have, or too thick to leave room inside."""
    edges, half = profile.edges, min(profile.width, profile.height) / 2.0
    faces = [edge.face for edge in edges]
    if isinstance(profile.wall, dict):
        missing = [edge.face for edge in edges if not edge.thickness]
        strange = [name for name in profile.wall if name not in (*faces, "sides", "bottom", "top")]
        if missing or strange:
            allowed = f"the faces of this profile are allowed, and all of them needed: {', '.join(faces)}"
            raise key_error("wall", ", ".join(strange or missing), f"{allowed}; sides are left and right")
    if max(edge.thickness for edge in edges) >= half:
        allowed = f"less than {half:g} m, half of width and height of the mid-surface, is allowed"
        raise key_error("wall", profile.wall, allowed)
    for k, edge in enumerate(edges):
        before, after = edges[k - 1], edges[(k + 1) % len(edges)]
        inside = edge.length - _mitre(edge, before, edge.turn(before)) - _mitre(edge, after, after.turn(edge))
        if inside <= profile.negligible:
            raise key_error("wall", profile.wall, f"thinner walls are allowed: {edge.face} has no room inside")


def _mitre(edge: Edge, other: Edge, angle: float) -> float:
    """Length in m by which an edge is shorter inside than at its mid-line, at a corner of `angle` rad with `other`."""
    return float((other.thickness - edge.thickness * np.cos(angle)) / (2.0 * np.sin(angle)))


def _check_radii(profile: BoxProfile) -> None:
    """Refuse radii of at most half the wall's thickness, and radii that leave too short plates next to the arcs."""
    edges = profile.edges
    for half in ("bottom", "top"):
        r, wall, most = profile.radius_at(half), profile.thickness(half), np.inf
        for k, edge in enumerate(edges):
            tangents, straight = 0.0, edge.length
            for after, before in ((edge, edges[k - 1]), (edges[(k + 1) % len(edges)], edge)):
                has_radius = not isinstance(profile.radius, dict) or (after.start[1] > -profile.negligible) == (
                    half == "top"
                )
                tangents += has_radius * np.tan(after.turn(before) / 2.0)
                straight -= 0.0 if has_radius else after.trim(before)
            most = min(most, max(straight, 0.0) / tangents) if tangents else most
        if r and not wall / 2.0 < r <= most + profile.negligible:
            allowed = f"0 is allowed, or more than {wall / 2.0:g} m, half the wall, and at most {most:g} m"
            raise key_error("radius", None, f"{allowed} on the mid-surface, where it is {r:g} m")
