"""Bodies of a run as pictures and animation show them: surfaces, pads, places, stresses, and the moments to draw."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.files.arrays import Array, Indices
from pmr.report.columns import axis_points, interpolate, spread_indices
from pmr.report.numbers import enlargement
from pmr.report.subject import fixtures, is_alone, reach
from pmr.results import Fields, RunResult
from pmr.results.field_series import THICK, Grid, pad_corners
from pmr.results.quantities import wall_stress
from pmr.scene.box import Box
from pmr.scene.built import PadRing

#: Faces of each kind of cell, as indices of the cell's vertices in VTK's order.
_FACES = {
    "triangle": [(0, 1, 2)],
    "tetra": [(0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 2, 1)],
    "hexahedron": [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)],
}
KNOB = 0.012  # half the size of a slider or support in pictures, as a share of the length of the body
#: Width and height in m with which a beam is drawn if its cross-section is not known.
_THIN = 0.05


@dataclass(frozen=True)
class Surface:
    """Visible surface of a body, with P points and S faces.

    Attributes
    ----------
    points : (P, 3) array, m
        Points of the undeformed body, in the body's axes.
    faces : (S, 3 or 4) integer array
        Triangles or quadrilaterals, as indices of points.
    cell : (S,) integer array
        Index of the field's cell that each face belongs to.
    vertex : (P,) integer array
        Index of the field's vertex whose displacement each point follows.
    lever : (P, 2) array, m
        Distance of each point from its vertex along y and z; not 0 for beams, whose sections turn with their axis.
    """

    points: Array
    faces: Indices
    cell: Indices
    vertex: Indices
    lever: Array

    def point_displacements(self, fields: Fields, displacement: NDArray[np.float32]) -> NDArray[np.float32]:
        """Displacements (..., P, 3) in m of the surface's P points at all times.

        The displacements follow from `displacement` (..., N, 3) in m of the N vertices of the fields.  The sections of
        a beam stay at right angles to its axis: a point at the lever (y, z) moves along x by -(v' y + w' z), where v'
        and w' are the slopes of the axis along y and z.
        """
        displaced = np.asarray(displacement[..., self.vertex, :])
        if np.any(self.lever):
            slope = np.gradient(displacement, fields.points[:, 0], axis=-2)[..., self.vertex, 1:]
            displaced[..., 0] -= np.sum(slope * self.lever, axis=-1)  # sections stay at right angles to the axis
        return displaced

    @property
    def triangles(self) -> Indices:
        """Triangles (T, 3) as indices of points.

        Quadrilaterals are cut into two triangles: the first halves of all quadrilaterals come first, then all second
        halves.
        """
        if self.faces.shape[1] == 3:
            return self.faces
        return np.concatenate([self.faces[:, [0, 1, 2]], self.faces[:, [0, 2, 3]]])

    @property
    def edges(self) -> Indices:
        """Edges of the surface's faces as pairs (E, 2) of indices of points; each of the E edges occurs once."""
        ends = np.concatenate([self.faces, self.faces[:, :1]], axis=1)
        pairs = np.sort(np.stack([ends[:, :-1].ravel(), ends[:, 1:].ravel()], axis=1), axis=1)
        return np.unique(pairs, axis=0)


def body_surface(fields: Fields, box: Box | None = None) -> Surface:
    """Return the surface of a body from its fields.

    Shells and solids have a surface of their own, and a beam is drawn as the tube of its `box`.  The vertices of a beam
    have to be sorted along x.  A beam without a box is drawn as a thin square tube.
    """
    if fields.kind == "line":
        return _tube(fields, box)
    cells = fields.cells[:, : {"triangle": 3, "tetra": 4, "hexahedron": 8}[fields.kind]]
    table = np.array(_FACES[fields.kind])
    faces = cells[:, table].reshape(-1, table.shape[1])
    cell = np.repeat(np.arange(len(cells)), len(table))
    if len(table) > 1:
        _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
        outside = np.sort(first[count == 1])  # faces that two cells share are inside
        faces, cell = faces[outside], cell[outside]
    vertex, faces = np.unique(faces, return_inverse=True)
    faces = faces.reshape(-1, table.shape[1])
    if len(table) == 1:
        faces = _turn_outwards(fields.points[vertex], faces)
    return Surface(fields.points[vertex], faces, cell, vertex, np.zeros((len(vertex), 2)))


def _turn_outwards(points: Array, faces: Indices) -> Indices:
    """Return `faces` (S, 3 or 4) with corners in the order that runs anticlockwise as seen from outside of a body.

    The body is along x, with the points (P, 3) in m.
    """
    first, second, third = (points[faces[:, k]] for k in range(3))
    away = points[faces].mean(axis=1) - points.mean(axis=0)
    inwards = np.sum(np.cross(second - first, third - first)[:, 1:] * away[:, 1:], axis=1) < 0.0
    return np.where(inwards[:, None], faces[:, ::-1], faces)


def _tube(fields: Fields, box: Box | None) -> Surface:
    """Build the surface of a beam from its `box` along the axis, without faces at its ends; a thin tube for None."""
    thin = np.array([(-_THIN, -_THIN), (_THIN, -_THIN), (_THIN, _THIN), (-_THIN, _THIN)]) / 2.0
    count = len(fields.points)
    corners = np.tile([side.start for side in box.sides] if box else thin, (count, 1, 1))
    if box and box.varying_keys:
        corners = np.array([[side.start for side in box.profile_at(float(x)).sides] for x in fields.points[:, 0]])
    around = corners.shape[1]
    vertex, lever = np.repeat(np.arange(count), around), corners.reshape(-1, 2)
    points = fields.points[vertex].astype(float)
    points[:, 1:] += lever
    first, second = around * fields.cells[:, 0], around * fields.cells[:, 1]
    ends = [(k, (k + 1) % around) for k in range(around)]
    walls = [np.stack([first + a, second + a, second + b, first + b], axis=1) for a, b in ends]
    faces = _turn_outwards(points, np.concatenate(walls))
    return Surface(points, faces, np.tile(np.arange(len(fields.cells)), around), vertex, lever)


_CUBE = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_SIDES = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])


@dataclass(frozen=True)
class Block:
    """Cuboid to be drawn: its 8 corners (8, 3) in m, and k of its sides (k, 4) as indices of corners."""

    corners: Array
    sides: Indices


@dataclass(frozen=True)
class Surroundings:
    """Surroundings of a body alone; all are empty for a boom, whose sections surround each other.

    `section` is the next outer section, if the body slides out of its mouth.  `near` are the pads at the mouth, or
    sliders, which keep their place in the picture; `tail` are the pads and supports that move with the body.
    """

    section: tuple[Block, ...]
    near: tuple[Block, ...]
    tail: tuple[Block, ...]


def build_surroundings(result: RunResult, body: Surface) -> Surroundings:
    """Build what surrounds a body alone, whose surface is `body`, at the path coordinate s = 0; empty for a boom."""
    if not is_alone(result):
        return Surroundings((), (), ())
    low, high, box = body.points.min(axis=0), body.points.max(axis=0), result.scene.body.box
    rings_by_motion = {
        moving: [ring for ring in result.scene.pads if ring.moving is moving] for moving in (False, True)
    }
    near, tail = (
        [block for ring in rings_by_motion[moving] for block in pad_blocks(ring, np.array([low, high]), box)]
        for moving in (True, False)
    )
    half, supports = KNOB * float(high[0] - low[0]), [of for of in fixtures(result) if of.kind != "pad"]
    for blocks, places in ((near, result.scene.points), (tail, [support.position for support in supports])):
        for at in (np.array([x, 0.0, 0.0]) for x in places):
            blocks.append(_block(at - half, at + half, _SIDES))
    if not rings_by_motion[True]:
        return Surroundings((), tuple(near), tuple(tail))
    ahead = max(ring.at + ring.length / 2.0 for ring in rings_by_motion[True])
    start = np.array([low[0] - float(result.abscissa.max()) - 0.1, *(low[1:] - 1.2 * THICK)])
    end = np.array([ahead, *(high[1:] + 1.2 * THICK)])
    return Surroundings((_block(start, end, _SIDES[2:]),), tuple(near), tuple(tail))


def pad_blocks(ring: PadRing, body: Array, box: Box | None) -> list[Block]:
    """Build a block for each pad of a ring around a body.

    `body` (2, 3) in m are opposite corners of the body, and `box` is its cross-section, None if it has no box.
    """
    return [Block(pad_corners(ring, place, body, box, _CUBE + 0.5), _SIDES) for place in ring.named_pads]


def _block(start: Array, end: Array, sides: Indices) -> Block:
    """Build a block from its opposite corners `start` and `end` (3,) in m.

    `sides` (k, 4) are those to be drawn, as indices of corners.
    """
    return Block((start + end) / 2.0 + _CUBE * (end - start), sides)


DISPLACED = 0.08  # largest displacement in a picture, as a share of the length of the body
FRAMES = 1500  # largest number of times of an animation of axes
EXTENSIONS = 3  # parts of the mouth's range, each with a picture
ALIKE = 0.08  # share of the mouth's range; pictures of two positions that are less apart look alike
ALMOST_ALL = 0.98  # share of the cells within the colour scale: a few peaks must not leave all others in one colour


@dataclass(frozen=True)
class Moment:
    """A stored time at which the bodies are drawn, and the state of the bodies at this time.

    `frame` is the number of the time among the times of the fields, and `t` is the time in s.  The mouth is at the path
    coordinate `s` in m, and the body extends `extension` m beyond the mouth.  `peak` is the largest stress in Pa.
    """

    frame: int
    t: float
    s: float
    extension: float
    peak: float


class PointOfBody(NamedTuple):
    """Name of a body, and a point (3,) in m in the axes of this body."""

    body: str
    point: Array


class MovingBodies:
    """Bodies of a run that are drawn, at the F times at which their fields are stored.

    The fields are the recovered ones.  If there are none, they are displacements of the points along the axes of all
    bodies.

    Attributes
    ----------
    fields, surfaces : dict
        Fields and surface of each body, by its name; both are empty if there is nothing to draw.
    t : (F,) array, s
    mouth : (F,) array, m
        Path coordinate of the mouth.  For a boom it is the largest reach minus the reach.
    shifts : dict of (F,) arrays, m
        Shift along x with which each body is drawn.  A body alone is shifted by -s, so that the mouth is drawn at 0.  A
        section of a boom is shifted by the position of its tail along the boom, measured from the tail of the base.
    stresses : (F,) array, Pa
        Largest von Mises stress of all cells; raises ValueError if no body has stresses (`cell_stresses` is empty).
    displacements : (F,) array, m
        Length of the largest displacement of all points.
    scale : float
        Factor, a round number, by which displacements are enlarged.
    """

    def __init__(self, result: RunResult) -> None:
        self.result = result
        self.are_recovered = any(body.fields is not None for body in result.bodies.values())
        recovered = {name: body.fields for name, body in result.bodies.items() if body.fields is not None}
        self.fields = recovered if self.are_recovered else _axis_fields(result)

    @cached_property
    def surfaces(self) -> dict[str, Surface]:
        bodies = self.result.scene.bodies
        return {name: body_surface(fields, bodies[name].body.box) for name, fields in self.fields.items()}

    @cached_property
    def t(self) -> Array:
        return next(iter(self.fields.values())).t

    @cached_property
    def mouth(self) -> Array:
        result, reaches = self.result, self.result.reach
        s = result.abscissa if reaches is None else reach(result) - reaches
        return interpolate(self.t, result.responses["reduced"].t, s)

    @cached_property
    def shifts(self) -> dict[str, Array]:
        if self.result.reach is None:
            return {name: -self.mouth for name in self.fields}
        t = self.result.responses["reduced"].t
        tails = dict(zip(self.result.scene.bodies, self.result.tails.T, strict=True))
        return {name: np.interp(fields.t, t, tails[name]) for name, fields in self.fields.items()}

    @cached_property
    def cell_stresses(self) -> dict[str, NDArray[np.float32]]:
        """Von Mises stresses (F, C) in Pa of the cells of each body that has stresses, by its name."""
        return {name: cell_stresses(fields) for name, fields in self.fields.items() if fields.von_mises}

    @cached_property
    def stresses(self) -> Array:
        return np.asarray(np.max([of.max(axis=1) for of in self.cell_stresses.values()], axis=0))

    @cached_property
    def displacements(self) -> Array:
        each = [np.linalg.norm(fields.displacement, axis=2).max(axis=1) for fields in self.fields.values()]
        return np.asarray(np.max(each, axis=0))

    @cached_property
    def scale(self) -> float:
        return enlargement(float(self.displacements.max()), DISPLACED * reach(self.result))

    @cached_property
    def colour_limit(self) -> float:
        """Stress in Pa at the end of the colour scale: a round number that few cells exceed at any time.

        A quarter of the number has few digits, too.  The stress is 1e6 Pa if the fields have no stresses, and 1 Pa if
        all stresses are 0.
        """
        if not self.cell_stresses:
            return 1e6
        cells = np.concatenate([of.max(axis=0) for of in self.cell_stresses.values()])
        most = float(np.quantile(cells, ALMOST_ALL))
        if most <= 0.0:
            return 1.0
        decade = 10.0 ** np.floor(np.log10(most))
        step = (0.4 if most < 4.0 * decade else 0.8) * decade
        return float(f"{step * np.ceil(most / step - 1e-9):.2g}")

    @cached_property
    def surroundings(self) -> Surroundings:
        """Pads, supports and the next outer section of a body alone; empty for a boom (`build_surroundings`)."""
        return build_surroundings(self.result, next(iter(self.surfaces.values())))

    def moments(self) -> list[Moment]:
        """Return the moments that are drawn, in order of time: at most one for each third of the mouth's range.

        From the times at which the mouth is in a third, the time with the largest stress is taken.  Without stresses it
        is the time with the largest displacement.  If the mouth does not move, there is one moment.  Two moments are
        too much alike if their mouths are less than the share `ALIKE` of the range apart.  Then only the one with the
        larger stress or displacement is returned.
        """
        s, weight = self.mouth, self.stresses if self.cell_stresses else self.displacements
        parts = np.clip(((s - s.min()) / max(np.ptp(s), 1e-12) * EXTENSIONS).astype(int), 0, EXTENSIONS - 1)
        chosen = list[int]()
        for inside in (np.flatnonzero(parts == part) for part in np.unique(parts)):
            k = int(inside[np.argmax(weight[inside])])
            if chosen and abs(s[k] - s[chosen[-1]]) < ALIKE * np.ptp(s):
                k = max(k, chosen.pop(), key=lambda of: float(weight[of]))
            chosen.append(k)
        return [self._moment(k) for k in sorted(chosen)]

    def moment_of_peak(self) -> Moment:
        """Return the stored moment nearest to the time of the largest stress in the summary.

        Stresses may be computed at more times than fields are stored, so that the moments can be apart.  If the summary
        has no such time, the result is the moment with the largest stress in the fields.  If the fields have no
        stresses, it is the moment with the largest displacement.
        """
        named, weight = self.summary_peak.get("t"), self.stresses if self.cell_stresses else self.displacements
        return self._moment(int(np.argmax(weight)) if named is None else int(np.argmin(np.abs(self.t - named))))

    def _moment(self, k: int) -> Moment:
        """Return the stored moment number k; its `peak` is 0 without stresses."""
        t, s = float(self.t[k]), float(self.mouth[k])
        return Moment(k, t, s, reach(self.result) - s, float(self.stresses[k]) if self.cell_stresses else 0.0)

    def place_of_peak(self, moment: Moment) -> PointOfBody:
        """Return the body and the point with the largest stress, as the summary states them.

        If the summary does not state them, the point is the middle of the cell with the largest stress of all bodies at
        `moment`; then the bodies must have stresses.
        """
        peak = self.summary_peak
        if "position" in peak and (body := peak.get("section", next(iter(self.fields)))) in self.fields:
            return PointOfBody(body, np.array(peak["position"]))
        stresses = {name: of[moment.frame] for name, of in self.cell_stresses.items()}
        body = max(stresses, key=lambda name: float(stresses[name].max()))
        fields = self.fields[body]
        return PointOfBody(body, fields.points[fields.cells[int(np.argmax(stresses[body]))]].mean(axis=0))

    @property
    def summary_peak(self) -> Mapping[str, Any]:
        """Time and place of the largest stress, from the summary; empty if it has no stress.

        The stress is that in walls at pads if this is known, else that of the fields, the entry
        ``stress_peak.reduced``.
        """
        summary = self.result.summary
        return dict(wall_stress(summary) or summary.get("stress_peak", {}).get("reduced") or {})


def _axis_fields(result: RunResult) -> dict[str, Fields]:
    """Displacements of the reduced model along the axis of each body, as fields of beams, by the body's name.

    The fields have at most `FRAMES` times, evenly spread over the run, and no stresses.  Bodies without outputs along
    their axis are left out.
    """
    fields, t = dict[str, Fields](), result.responses["reduced"].t
    steps = spread_indices(len(t), FRAMES)
    for line in axis_points(result):
        x, places = np.unique(line.x, return_index=True)
        cells = np.stack([np.arange(len(x) - 1), np.arange(1, len(x))], axis=1)
        grid = Grid("line", np.stack([x, 0.0 * x, 0.0 * x], axis=1), cells)
        fields[line.body] = Fields(grid, t[steps], line.displacement[np.ix_(steps, places)].astype(np.float32), {})
    return fields


def cell_stresses(fields: Fields) -> NDArray[np.float32]:
    """Von Mises stress (F, C) in Pa of the C cells at F times.

    The stress of a cell is the largest of those that are stored for its faces.
    """
    return np.maximum.reduce(list(fields.von_mises.values()))
