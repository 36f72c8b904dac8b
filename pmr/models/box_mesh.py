r"""The boom, meshed by gmsh: plates around a closed profile along x, as a surface (their mid-surface) or a solid.

Groups: the flat walls that pads slide on, by the names of their faces (a solid's outer faces); ``corners``, the rounded
edges; ``frames``, the transverse stiffeners; ``tail`` and ``tip``, the two ends.

A box that tapers is first drawn with one profile all along; then its points are moved.  A point drawn in side k of the
profile has a share :math:`\xi` in [0, 1] along the side and a depth :math:`\eta` inwards from the wall, 0 on walls and
up to 1 on frames.  It is moved to the point p that has the same :math:`\xi` and :math:`\eta` in the profile at its
coordinate x:

.. math:: p = (1 - \eta)\, a_k(\xi) + \eta\, b_k(\xi)

The point :math:`a_k` is on the middle of wall k, and :math:`b_k` is farther inside by the depth of the frames.  Both
change linearly along x.  Points of plates that close the section, which are not on walls, keep their shares in the
triangle of the axis and a side.

Where plates on one side of a wall begin or end, the mid-surface has a step.  It is drawn as a ramp of two layers of
cells, in a group of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pmr.errors import InputError
from pmr.files.arrays import Array, Mask
from pmr.models.mesh_drawing import Drawing, Entity
from pmr.models.trace import RAMP
from pmr.scene.box import Stretch, mid_lines
from pmr.scene.profile import Pair, Side

#: Suffix of the group names of walls that are not parallel to the axis.
TAPERED = " tapered"


class Ends(NamedTuple):
    """Start and end (2,) in m of a line across the section, or (N, 2) of N lines."""

    start: Array
    end: Array


def shifted_ends(sides: Sequence[Side], k: int, outward: Callable[[Side], float]) -> Ends:
    """Start and end (2,) in m of side k of the `sides`, after all of them are shifted outwards from their mid-surfaces.

    `outward` returns for a side how far it is shifted, in m.  At a sharp corner the ends are where the shifted sides
    meet.
    """
    side, neighbours = sides[k], (sides[k - 1], sides[(k + 1) % len(sides)])
    ends = []
    for at, other in zip((side.start, side.end), neighbours, strict=True):
        sharp = side.centre is None and other.centre is None
        normals, apart = [outward_normal(side, at), outward_normal(other, at)], [outward(side), outward(other)]
        ends.append(at + (np.linalg.solve(normals, apart) if sharp else apart[0] * normals[0]))
    return Ends(ends[0], ends[1])


def outward_normal(side: Side, at: Pair) -> Array:
    """Outward unit vector (2,) of a side at one of its ends, the point `at` (y, z) in m."""
    if side.centre is not None:
        arm = np.subtract(at, side.centre)
        return np.asarray(arm / np.hypot(*arm))
    return side.normal


#: Shares along a side beyond 0 and 1 that count as round-off of the drawing.
SLACK = 1e-6
#: Depth of a wall without frames, as a share of the side: its points are within this distance of its middle.
THIN = 1e-6


def move_points(
    points: Array, sides: Sequence[Side], parts: Sequence[Stretch], depth: float, ramps: Mapping[float, float]
) -> Array:
    """New positions (N, 3) in m of points that were drawn as if a box had the profile `sides` along its whole length.

    `points` (N, 3) m are the drawn points, and `parts` are the stretches of the box, each with its own profile.  Points
    in stretches with the drawn profile keep their position; without `parts` all points do.  `depth` in m is the depth
    of the frames, infinite if frames close the section.  `ramps` are half lengths in m of ramps between two stretches,
    by the x of the ramp's middle.
    """
    if not parts:
        return points
    moved_points, unplaced, depth = points.copy(), np.ones(len(points), bool), depth if np.isfinite(depth) else 0.0
    begun = [_share_behind(points[:, 0], part.start, ramps) for part in parts[1:]]
    begun = [np.ones(len(points)), *begun, np.zeros(len(points))]
    for place in (_in_side, _in_triangle):
        for k in range(len(sides)):
            first_share, second_share, within = place(points[:, 1:], sides, k, depth)
            placed = unplaced & within
            unplaced &= ~placed
            for part, inside in zip(parts, -np.diff(begun, axis=0), strict=True):
                rows = np.flatnonzero(placed & (inside > 0.0))
                if (part.is_tapered or mid_lines(part.first.sides) != mid_lines(sides)) and len(rows):
                    share = (points[rows, 0] - part.start)[:, None] / (part.end - part.start)
                    at = _side_points if place is _in_side else _triangle_points
                    first, last = (
                        at(first_share[rows], second_share[rows], each, k, depth)
                        for each in (part.first.sides, part.last.sides)
                    )
                    moved = (1.0 - share) * first + share * last - points[rows, 1:]
                    moved_points[rows, 1:] += inside[rows, None] * moved
    return moved_points


def _share_behind(x: Array, at: float, ramps: Mapping[float, float]) -> Array:
    """Share (N,) in [0, 1] that the profile behind the coordinate `at` has in the profile at each x (N,), all in m.

    The share is 0 before `at`, 1 behind it, and 1/2 at it.  If there is a ramp at `at`, the share rises linearly from 0
    to 1 along the ramp.
    """
    half = ramps.get(at, 0.0)
    return np.clip((x - at) / (2.0 * half) + 0.5, 0.0, 1.0) if half else np.heaviside(x - at, 0.5)


Places = tuple[Array, Array, Mask]


def _in_side(p: Array, sides: Sequence[Side], k: int, depth: float) -> Places:
    """Shares xi, eta (N,) of points p (N, 2) in m along side k and in its depth, and whether both are in [0, 1]."""
    xi, eta = _side_shares(p, sides, k, depth)
    return xi, eta, (np.abs(xi - 0.5) <= 0.5 + SLACK) & (np.abs(eta - 0.5) <= 0.5 + SLACK)


def _in_triangle(p: Array, sides: Sequence[Side], k: int, depth: float) -> Places:
    """Two shares (N,) of points p (N, 2) in m along the vectors from the axis to both ends of side k, and a mask (N,).

    Side k is one of `sides`.  The mask marks points without a negative share, which are in the sector between the two
    vectors.  `depth` is not used.
    """
    first_share, second_share = np.linalg.solve(np.array([sides[k].start, sides[k].end]).T, p.T)
    return first_share, second_share, (first_share >= -SLACK) & (second_share >= -SLACK)


def _triangle_points(first_share: Array, second_share: Array, sides: Sequence[Side], k: int, depth: float) -> Array:
    """Points (N, 2) m with given shares (N,) along the vectors to the ends of side k of `sides`.

    `first_share` is the share along the vector from the axis to the start of the side, and `second_share` the share
    along the vector to its end.  `depth` is not used.
    """
    return np.outer(first_share, sides[k].start) + np.outer(second_share, sides[k].end)


def _side_shares(p: Array, sides: Sequence[Side], k: int, depth: float) -> Array:
    """Share xi along side k of `sides` and relative depth eta of points p (N, 2) in m, as an array (2, N).

    The depth eta is relative to `depth` in m.  If `depth` is 0, it is relative to `THIN` of the side's length.  For
    points outside of the side xi or eta is not in [0, 1].
    """
    side = sides[k]
    scale = depth or THIN * side.length
    if side.centre is not None:
        arm, start = p - side.centre, np.subtract(side.start, side.centre)
        radius, angle = np.hypot(*start), np.arctan2(arm[:, 1], arm[:, 0]) - np.arctan2(start[1], start[0])
        angle = (angle + np.pi) % (2.0 * np.pi) - np.pi
        return np.array([angle / side.angle, (radius - np.hypot(*arm.T)) / scale])
    a, b = shifted_ends(sides, k, lambda _: 0.0)
    along = (b - a) / np.linalg.norm(b - a)
    eta = (p - a) @ [-along[1], along[0]] / scale
    start, end = _ends_at_depth(eta, sides, k, scale)
    return np.array([(p - start) @ along / np.maximum((end - start) @ along, SLACK * side.length), eta])


def _ends_at_depth(eta: Array, sides: Sequence[Side], k: int, depth: float) -> Ends:
    """Ends (N, 2) m of lines along the flat side k of `sides`, at the shares eta (N,) of the `depth` in m inwards."""
    (a, b), (c, d) = shifted_ends(sides, k, lambda _: 0.0), shifted_ends(sides, k, lambda _: -depth)
    return Ends(np.outer(1.0 - eta, a) + np.outer(eta, c), np.outer(1.0 - eta, b) + np.outer(eta, d))


def _side_points(xi: Array, eta: Array, sides: Sequence[Side], k: int, depth: float) -> Array:
    """Points (N, 2) m with the shares xi (N,) along side k of `sides` and eta (N,) of the `depth` in m."""
    side = sides[k]
    if side.centre is not None:
        start = np.subtract(side.start, side.centre)
        angle, r = np.arctan2(start[1], start[0]) + xi * side.angle, np.hypot(*start) - eta * depth
        return np.asarray(side.centre + r[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    start, end = _ends_at_depth(eta, sides, k, depth)
    return np.asarray((1.0 - xi)[:, None] * start + xi[:, None] * end)


#: Source of errors in a box's dimensions; the caller replaces it by the scene's key.
DIMENSIONS = "box boom"
#: Most rectangles of a drawing: with some 40 coordinates each, there are four million coordinates, which take 50 GiB.
MOST_RECTANGLES = 100_000
#: Smallest thickness of a layer as a share of that of others: gmsh merges points that are much closer.
THINNEST = 1e-4
#: Largest cosine of an angle that counts as a right one.
SQUARE = 1e-6


@dataclass(frozen=True)
class BoxBoom:
    """A box along x and the sizes of its cells, in m.

    Layers of cells may be finer at a clamped tail, where stresses are singular.  Raises an `InputError` with the source
    `DIMENSIONS` for dimensions that can't be meshed.
    """

    sides: tuple[Side, ...]
    length: float = 6.0  # of the box along x
    size: float = 0.05  # edge length of the cells around the section
    size_along: float = 0.0  # edge length of the cells along x; 0: as around the section
    # length of the first layer of cells at the tail, from which layers double up to the regular one; 0: as all others
    tail_layer: float = 0.0
    frames: tuple[float, ...] = ()  # coordinates x at which a transverse plate stiffens a shell all around
    frame_depth: float = 0.0  # depth of these plates inwards from the walls; infinite: they close the section
    parts: tuple[Stretch, ...] = ()  # stretches along x; by default a single one with these sides

    def __post_init__(self) -> None:
        thinnest, around = THINNEST * self.layer, sum(side.length for side in self.sides)
        tail_fits = self.tail_layer == 0.0 or thinnest <= self.tail_layer <= self.layer
        gaps = np.concatenate([np.diff([0.0, *self.frames, self.length]), np.diff(self.stations)])
        apart = "ascending places between tail and tip, at least a ten-thousandth of a cell from each other and "
        allowed = {
            "size": (0.0 < self.size <= self.length, "more than 0 and up to the length"),
            "size_along": (0.0 <= self.size_along <= self.length, "0, or up to the length"),
            "tail_layer": (tail_fits, "0, or from a ten-thousandth up to all of the other layers"),
            "frames": (bool(np.all(gaps >= thinnest)), f"{apart}from where a doubler ends,"),
            "frame_depth": (
                not self.frames or THINNEST * self.size <= self.frame_depth,
                "more than a ten-thousandth of a cell",
            ),
        }
        for key, (fits, words) in allowed.items():
            if not fits:
                raise InputError(DIMENSIONS, key, getattr(self, key), f"{words} is allowed")
        rectangles = max(around / self.size, 8.0) * self.length / self.layer
        if not rectangles <= MOST_RECTANGLES:  # a float, which may be infinite
            allowed_sizes = (
                f"sizes that make at most {MOST_RECTANGLES:,} cells are allowed; these make {rectangles:.1e}"
            )
            finest = "size" if self.size <= self.layer else "size_along"
            raise InputError(DIMENSIONS, finest, getattr(self, finest), allowed_sizes)

    @property
    def layer(self) -> float:
        """Edge length of the cells along x, m."""
        return self.size_along or self.size

    def layers(self, start: float, end: float) -> list[float]:
        """Ends of the layers of cells between the stations `start` and `end` (m), as shares of their distance.

        Layers have about the length `layer`, and all have the same length.  A boom with a `tail_layer` is an exception
        if `start` is 0: the first layer has this short length, and each further layer is twice as long as the one
        before.  This ends when a layer would have the ordinary length, or when half of the distance would be filled.
        """
        fine: list[float] = []
        if start == 0.0 and self.tail_layer:
            thickness = self.tail_layer
            while thickness < 0.999 * self.layer and sum(fine) + thickness < (end - start) / 2.0:
                fine.append(thickness)
                thickness *= 2.0
        count = max(1, round((end - start - sum(fine)) / self.layer))
        ends = np.concatenate([np.cumsum([0.0, *fine])[:-1], np.linspace(start + sum(fine), end, count + 1) - start])
        return [float(x) for x in ends[1:] / (end - start)]

    @property
    def stations(self) -> list[float]:
        """Coordinates x in m where layers of cells must end: tail, tip, frames, and ends of stretches and ramps."""
        ramped = {x for at, half in self.ramps.items() for x in (at - half, at + half)}
        return sorted({*self._stops, *ramped})

    @property
    def _stops(self) -> list[float]:
        """Coordinates x in m of tail and tip, frames, and ends of stretches, ascending."""
        ends = {part.end for part in self.parts if part.end < self.length}
        return [0.0, *sorted(ends | set(self.frames)), self.length]

    @property
    def ramps(self) -> dict[float, float]:
        """Half lengths in m of the ramps at steps of the mid-surface, by their coordinate x in m.

        A half length is the length of a layer of cells.  It is shorter if the next frame or end of a stretch is near:
        at most a third of the way to it.
        """
        stops, half_lengths = self._stops, dict[float, float]()
        for part, after in pairwise(self.parts):
            if mid_lines(part.last.sides) != mid_lines(after.first.sides):
                k = stops.index(part.end)
                half_lengths[part.end] = min(self.layer, *(np.diff(stops[k - 1 : k + 2]) / 3.0).tolist())
        return half_lengths

    def suffix(self, k: int, x: float) -> str:
        """Suffix of the name of the group of side k at the coordinate `x` in m.

        It is empty if the side is parallel to the axis there.  It is `TAPERED` if the profile tapers there, and `RAMP`
        on a ramp that moves the side.
        """
        on_ramp = any(
            abs(x - part.end) < self.ramps.get(part.end, 0.0)
            and abs(_distance(part.last.sides[k]) - _distance(after.first.sides[k])) > SLACK * self.size
            for part, after in pairwise(self.parts)
        )
        tapers = any(part.is_tapered for part in self.parts if part.start < x < part.end)
        return TAPERED if tapers else RAMP * on_ramp


def write_shell(boom: BoxBoom, file: Path) -> None:
    """Mesh the mid-surface of a boom by triangles and write the mesh to `file`.

    Each rectangle is split by both of its diagonals, so that no direction is preferred.
    """
    with Drawing() as drawing:
        curves = _section_curves(drawing, boom, 0.0, 0.0)
        groups: dict[str, list[Entity]] = {"tail": [(1, curve) for curve in curves]}
        for start, end in zip(boom.stations[:-1], boom.stations[1:], strict=True):
            swept = drawing.sweep([(1, c) for c in curves], end - start, boom.layers(start, end), quads=True)
            curves = [tag for _, tag in swept[::4]]  # of each curve: its copy, the surface, two more lines
            for k, surface in enumerate(swept[1::4]):
                name = boom.sides[k].name + boom.suffix(k, (start + end) / 2.0)
                groups.setdefault(name, []).append(surface)
            if end in boom.frames:
                groups.setdefault("frames", []).extend(_frame_surfaces(drawing, boom, curves, end))
        groups["tip"] = [(1, curve) for curve in curves]
        shape = boom.sides, boom.parts, boom.frame_depth, boom.ramps
        drawing.write(groups, file, lambda points: move_points(points, *shape))


def write_solid(boom: BoxBoom, file: Path, hexahedra: bool = True) -> None:
    """Mesh the walls of a boom by hexahedra, one across the thickness, or by tetrahedra, and write the mesh to `file`.

    The tetrahedra divide the same hexahedra.  Raises an `InputError` if the boom has frames, or walls of different
    thickness with rounded corners.
    """
    if boom.frames:
        raise InputError(DIMENSIONS, "frames", boom.frames, "a solid boom has none")
    walls = {side.thickness for side in boom.sides}
    if len(walls) > 1 and any(side.centre is not None for side in boom.sides):
        allowed = "one thickness of all walls is allowed for a solid with rounded corners"
        raise InputError(DIMENSIONS, "wall", ", ".join(f"{wall:g}" for wall in sorted(walls)), allowed)
    with Drawing() as drawing:
        patches = _wall_patches(drawing, boom, hexahedra)
        swept = drawing.sweep(patches, boom.length, boom.layers(0.0, boom.length), quads=hexahedra)
        volumes = [entity for entity in swept if entity[0] == 3]
        groups: dict[str, list[Entity]] = {"wall": volumes}
        for face in drawing.boundary(volumes):
            low, high = drawing.bounds(face)
            for name, plane in _outer_faces(boom).items():
                if plane.holds(low, high):
                    groups.setdefault(name, []).append(face)
        drawing.write(groups, file)


def _section_curves(drawing: Drawing, boom: BoxBoom, x: float, inset: float) -> list[int]:
    """Tags in gmsh of the curves around the section of a boom at x (m), moved inwards by `inset` (m).

    The curves have the divisions of the mid-line.
    """
    curves = []
    for k, side in enumerate(boom.sides):
        start, end = (drawing.point(x, *p) for p in shifted_ends(boom.sides, k, lambda side: -inset))
        if side.centre is None:
            curves.append(drawing.line(start, end, side.cells(boom.size)))
        else:
            curves.append(drawing.arc(start, drawing.point(x, *side.centre), end, side.cells(boom.size)))
    return curves


def _frame_surfaces(drawing: Drawing, boom: BoxBoom, outer: list[int], x: float) -> list[Entity]:
    """Surfaces of a frame at x (m): from the curves `outer` inwards to the frames' depth.

    If that depth is infinite, the surface is all that `outer` encloses.
    """
    if boom.frame_depth == np.inf:
        return [drawing.fill(outer)]
    inner = _section_curves(drawing, boom, x, boom.frame_depth)
    return drawing.strips(outer, inner, max(1, round(boom.frame_depth / boom.size)))


def _wall_patches(drawing: Drawing, boom: BoxBoom, quads: bool) -> list[Entity]:
    """Surfaces of the walls' cross-section at x = 0: one for each side, and one for each right-angled sharp corner.

    The surfaces are meshed by rectangles if `quads`, else by triangles.
    """
    patches, count = [], len(boom.sides)
    inside = [[drawing.point(0.0, *p) for p in shifted_ends(boom.sides, k, _inner_distance)] for k in range(count)]
    outside = [[drawing.point(0.0, *p) for p in _outer_ends(boom, k)] for k in range(count)]
    for k, side in enumerate(boom.sides):
        (a, b), (d, c) = outside[k], inside[k]
        n, after = side.cells(boom.size), (k + 1) % count
        if side.centre is None:
            along = drawing.line(a, b, n), drawing.line(c, d, n)
        else:
            centre = drawing.point(0.0, *side.centre)
            along = drawing.arc(a, centre, b, n), drawing.arc(c, centre, d, n)
        patches.append(drawing.patch([along[0], drawing.line(b, c, 1), along[1], drawing.line(d, a, 1)], quads))
        if _is_square(boom, k):
            corner = drawing.point(0.0, *shifted_ends(boom.sides, k, _outer_distance)[1])
            next_ = outside[after][0]
            sides = [drawing.line(b, corner, 1), drawing.line(corner, next_, 1), drawing.line(next_, c, 1)]
            patches.append(drawing.patch([*sides, drawing.line(c, b, 1)], quads))
    return patches


def _distance(side: Side) -> float:
    """Distance in m of the plane of a flat side from the axis, or radius of an arc."""
    return side.radius or float(side.normal @ side.start)


def _outer_distance(side: Side) -> float:
    """Distance in m from the mid-surface of a side to its outer surface."""
    return side.thickness / 2.0


def _inner_distance(side: Side) -> float:
    """Distance in m from the mid-surface of a side to its inner surface; negative, as distances count outwards."""
    return -side.thickness / 2.0


def _outer_ends(boom: BoxBoom, k: int) -> Ends:
    """Both ends of the outer line of side k's patch, points (y, z) in m.

    At a corner that has a patch of its own the ends are opposite the ends of the inner line; at other corners the
    patches meet in a mitre.
    """
    side, outer = boom.sides[k], shifted_ends(boom.sides, k, _outer_distance)
    inner = [
        at + side.thickness * outward_normal(side, end)
        for end, at in zip((side.start, side.end), shifted_ends(boom.sides, k, _inner_distance), strict=True)
    ]
    first = inner[0] if _is_square(boom, k - 1) else outer[0]
    return Ends(first, inner[1] if _is_square(boom, k) else outer[1])


def _is_square(boom: BoxBoom, k: int) -> bool:
    """Whether side k of a boom and the next side are flat and meet at a right angle."""
    side, after = boom.sides[k], boom.sides[(k + 1) % len(boom.sides)]
    flat = side.centre is None and after.centre is None
    return flat and abs(float(outward_normal(side, side.end) @ outward_normal(after, after.start))) < SQUARE


@dataclass(frozen=True)
class _Plane:
    """The plane of points p with normal . p = distance."""

    normal: Array  # (3,)
    distance: float

    def holds(self, low: Array, high: Array) -> bool:
        """Whether a flat face with the bounding box from `low` (3,) to `high` (3,), in m, lies in the plane."""
        rising = float(np.prod(self.normal[1:])) <= 0.0
        ends = (low, high) if rising else (np.array([low[0], low[1], high[2]]), np.array([high[0], high[1], low[2]]))
        return all(abs(self.normal @ end - self.distance) < 1e-6 for end in ends)


def _outer_faces(boom: BoxBoom) -> dict[str, _Plane]:
    """Planes of both ends and of the outside of each flat wall of a solid, by name."""
    planes = {"tail": _Plane(np.eye(3)[0], 0.0), "tip": _Plane(np.eye(3)[0], boom.length)}
    for side in boom.sides:
        if side.centre is None:
            normal = outward_normal(side, side.start)
            planes[side.name] = _Plane(np.array([0.0, *normal]), float(normal @ side.start) + side.thickness / 2.0)
    return planes
