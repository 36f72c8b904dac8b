"""The box boom, meshed by gmsh: a rectangular tube along x, as a surface (mid-surface of the wall) or as a solid.

Groups: ``bottom``, ``top``, ``left`` (+y), ``right`` are the flat walls that pads slide on (outer faces of a solid),
``corners`` the rounded edges, ``frames`` the transverse stiffeners; ``tail`` and ``tip`` the two ends.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pmr.errors import InputError
from pmr.mesh.drawing import Drawing, Entity

#: The source of errors in a box's dimensions; where they stand is known to who asks for it.
DIMENSIONS = "box boom"
#: Rectangles that a drawing may have: some 40 coordinates each, four million, for which 50 GiB would be needed.
MOST_RECTANGLES = 100_000
#: Cells may be so thin, as a share of the others: gmsh takes points that lie much closer for one.
THINNEST = 1e-4
WALLS = ("bottom", "left", "top", "right")  # as one walks around the section, seen from the tip


@dataclass(frozen=True)
class BoxBoom:
    """Dimensions in m, those of the mid-surface; layers may be finer at a clamped tail, where stresses are singular."""

    length: float = 6.0  # along x
    width: float = 0.3  # along y
    height: float = 0.4  # along z
    wall: float = 0.008  # the wall's thickness
    size: float = 0.05  # edge length of the cells around the section
    size_along: float = 0.0  # along x; 0: the same
    # first layer of cells at the tail, from which layers double up to the regular one; 0: the same
    tail_layer: float = 0.0
    radius: float = 0.0  # of the corners' mid-surface; 0 for sharp ones
    frames: tuple[float, ...] = ()  # where along x a shell is stiffened by a transverse plate all around
    frame_depth: float = 0.0  # of these plates

    def __post_init__(self) -> None:
        side, thinnest = min(self.width, self.height), THINNEST * self.layer
        allowed = {
            "length": self.length > 0.0,
            "size": 0.0 < self.size <= self.length,
            "size_along": 0.0 <= self.size_along <= self.length,
            "tail_layer": self.tail_layer == 0.0 or thinnest <= self.tail_layer <= self.layer,
            "wall": 0.0 < self.wall < side / 2.0,
            "radius": self.radius == 0.0 or self.wall / 2.0 < self.radius < side / 2.0,
            "frames": bool(np.all(np.diff([0.0, *self.frames, self.length]) >= thinnest)),
            "frame_depth": not self.frames
            or THINNEST * self.size <= self.frame_depth < (self.radius if self.radius > 0.0 else side / 2.0),
        }
        words = {
            "wall": "less than half of width and height",
            "size": "more than 0 and up to the length",
            "radius": "0, or more than half the wall and less than half of width and height",
            "frames": "ascending places between tail and tip, at least a ten-thousandth of a cell apart,",
            "size_along": "0, or up to the length",
            "tail_layer": "0, or from a ten-thousandth up to all of the other layers",
            "frame_depth": "more than a ten-thousandth of a cell and less than the corners' radius, or half the width "
            "if they are sharp",
        }
        for key, fits in allowed.items():
            if not fits:
                raise InputError(DIMENSIONS, key, getattr(self, key), words.get(key, "more than 0") + " is allowed")
        rectangles = max(2.0 * (self.width + self.height) / self.size, 8.0) * self.length / self.layer
        if not rectangles <= MOST_RECTANGLES:  # too many to count, perhaps: a float, infinite or not
            said = f"sizes that make at most {MOST_RECTANGLES:,} cells are allowed; these make {rectangles:.1e}"
            finest = "size" if self.size <= self.layer else "size_along"
            raise InputError(DIMENSIONS, finest, getattr(self, finest), said)

    @property
    def layer(self) -> float:
        """Edge length of the cells along x, m."""
        return self.size_along or self.size

    def layers(self, start: float, end: float) -> list[float]:
        """Ends of the layers of cells between two stations, as shares of the distance."""
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
        """Ends of the stretches between frames, m."""
        return [0.0, *self.frames, self.length]


def write_shell(boom: BoxBoom, file: Path) -> None:
    """Triangles on the mid-surface: rectangles crossed by both diagonals, which prefers no direction."""
    with Drawing() as drawing:
        curves = _section(drawing, boom, 0.0, 0.0)
        groups: dict[str, list[Entity]] = {"tail": [(1, curve) for curve in curves]}
        names = [*WALLS] if boom.radius == 0.0 else [name for wall in WALLS for name in (wall, "corners")]
        for start, end in zip(boom.stations[:-1], boom.stations[1:], strict=True):
            swept = drawing.sweep([(1, c) for c in curves], end - start, boom.layers(start, end), quads=True)
            curves = [tag for _, tag in swept[::4]]  # of each curve: its copy, the surface, two more lines
            for name, surface in zip(names, swept[1::4], strict=True):
                groups.setdefault(name, []).append(surface)
            if end in boom.frames:
                groups.setdefault("frames", []).extend(_frame(drawing, boom, curves, end))
        groups["tip"] = [(1, curve) for curve in curves]
        drawing.write(groups, file)


def write_solid(boom: BoxBoom, file: Path, hexahedra: bool = True) -> None:
    """Hexahedra, one across the wall, or tetrahedra of the same structure."""
    if boom.frames:
        raise InputError(DIMENSIONS, "frames", boom.frames, "a solid boom has none")
    with Drawing() as drawing:
        patches = _wall_patches(drawing, boom, hexahedra)
        swept = drawing.sweep(patches, boom.length, boom.layers(0.0, boom.length), quads=hexahedra)
        volumes = [entity for entity in swept if entity[0] == 3]
        groups: dict[str, list[Entity]] = {"wall": volumes}
        for face in drawing.boundary(volumes):
            low, high = drawing.bounds(face)
            for name, (axis, at) in _outer_faces(boom).items():
                if abs(low[axis] - at) < 1e-6 and abs(high[axis] - at) < 1e-6:
                    groups.setdefault(name, []).append(face)
        drawing.write(groups, file)


def _section(drawing: Drawing, boom: BoxBoom, x: float, inset: float) -> list[int]:
    """Curves around the section at x, `inset` within the mid-surface; divided as the mid-surface is."""
    r = max(boom.radius - inset, 0.0)
    curves = []
    ends = [_wall_ends(boom, k, boom.radius if r else inset, -inset) for k in range(4)]
    for k in range(4):
        start, end = (drawing.point(x, *p) for p in ends[k])
        curves.append(drawing.line(start, end, _divisions(boom, k)))
        if r:
            after = drawing.point(x, *ends[(k + 1) % 4][0])
            curves.append(drawing.arc(end, drawing.point(x, *_corner_centre(boom, k)), after, _arc_divisions(boom)))
    return curves


def _frame(drawing: Drawing, boom: BoxBoom, outer: list[int], x: float) -> list[Entity]:
    """A plate between the section and the same one farther inside."""
    inner = _section(drawing, boom, x, boom.frame_depth)
    return drawing.strips(outer, inner, max(1, round(boom.frame_depth / boom.size)))


def _wall_patches(drawing: Drawing, boom: BoxBoom, quads: bool) -> list[Entity]:
    """The wall's cross-section at x = 0: four straight pieces and four corners."""
    t, trim = boom.wall / 2.0, boom.radius or boom.wall / 2.0
    patches = []
    for k in range(4):
        a, b = (drawing.point(0.0, *p) for p in _wall_ends(boom, k, trim, t))
        d, c = (drawing.point(0.0, *p) for p in _wall_ends(boom, k, trim, -t))
        n = _divisions(boom, k)
        sides = [drawing.line(a, b, n), drawing.line(b, c, 1), drawing.line(c, d, n), drawing.line(d, a, 1)]
        patches.append(drawing.patch(sides, quads))
        after, inside = (drawing.point(0.0, *_wall_ends(boom, (k + 1) % 4, trim, side)[0]) for side in (t, -t))
        if boom.radius:
            centre, m = drawing.point(0.0, *_corner_centre(boom, k)), _arc_divisions(boom)
            sides = [drawing.arc(b, centre, after, m), drawing.line(after, inside, 1),
                     drawing.arc(inside, centre, c, m), drawing.line(c, b, 1)]  # fmt: skip
        else:
            outside = drawing.point(0.0, *_wall_ends(boom, k, -t, t)[1])
            sides = [drawing.line(b, outside, 1), drawing.line(outside, after, 1),
                     drawing.line(after, inside, 1), drawing.line(c, b, 1)]  # fmt: skip
        patches.append(drawing.patch(sides, quads))
    return patches


def _wall_ends(boom: BoxBoom, k: int, trim: float, outward: float) -> list[tuple[float, float]]:
    """Ends (y, z) of wall k, shortened by `trim` at each, shifted outward from the mid-surface."""
    along, out = _directions(k)
    half = np.array([boom.width, boom.height]) / 2.0
    reach, distance = abs(along @ half) - trim, abs(out @ half) + outward
    return [(float(p[0]), float(p[1])) for p in (out * distance - along * reach, out * distance + along * reach)]


def _corner_centre(boom: BoxBoom, k: int) -> tuple[float, float]:
    along, out = _directions(k)
    p = (along + out) * (np.array([boom.width, boom.height]) / 2.0 - boom.radius)
    return float(p[0]), float(p[1])


def _directions(k: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors (y, z) along wall k and out of it."""
    turn = np.array([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])
    return turn[k], turn[k - 1]


def _divisions(boom: BoxBoom, k: int) -> int:
    flat = (boom.width, boom.height)[k % 2] - 2.0 * boom.radius
    return max(2, round(flat / boom.size))


def _arc_divisions(boom: BoxBoom) -> int:
    return max(2, round(boom.radius * np.pi / 2.0 / boom.size))


def _outer_faces(boom: BoxBoom) -> dict[str, tuple[int, float]]:
    """Axis and position of each named face of a solid."""
    y, z = (boom.width + boom.wall) / 2.0, (boom.height + boom.wall) / 2.0
    return {
        "tail": (0, 0.0), "tip": (0, boom.length), "left": (1, y), "right": (1, -y), "top": (2, z), "bottom": (2, -z)
    }  # fmt: skip
