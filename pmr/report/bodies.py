"""The surface of a body as triangles, from the cells of its fields."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.report.columns import onto
from pmr.report.numbers import enlargement
from pmr.report.subject import is_alone, length
from pmr.results import Fields, RunResult
from pmr.results.pads import THICK, pad_corners
from pmr.scene.box import Box
from pmr.scene.built import PadRing

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Faces of the cells in VTK's order of vertices.
_FACES = {
    "triangle": [(0, 1, 2)],
    "tetra": [(0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 2, 1)],
    "hexahedron": [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)],
}
#: A beam whose section is not known is drawn this thick, m.
_THIN = 0.05


@dataclass(frozen=True)
class Surface:
    """Visible surface of a body.

    Attributes
    ----------
    points : (P, 3) array, m
        At rest.
    faces : (S, 3 or 4) integer array
        Triangles or quadrilaterals.
    cell : (S,) integer array
        The cell that each face belongs to.
    vertex : (P,) integer array
        The vertex of the fields that each point moves with.
    lever : (P, 2) array, m
        How far a point is from that vertex along y and z: sections of beams turn with their axis.
    """

    points: Array
    faces: Indices
    cell: Indices
    vertex: Indices
    lever: Array

    def moved(self, fields: Fields, displacement: NDArray[np.float32]) -> NDArray[np.float32]:
        """Displacements (..., P, 3) in m of the points, from those (..., N, 3) of the vertices."""
        displaced = np.asarray(displacement[..., self.vertex, :])
        if np.any(self.lever):
            slope = np.gradient(displacement, fields.points[:, 0], axis=-2)[..., self.vertex, 1:]
            displaced[..., 0] -= np.sum(slope * self.lever, axis=-1)  # sections stay across the axis
        return displaced

    @property
    def triangles(self) -> Indices:
        """(T, 3): each quadrilateral as two."""
        if self.faces.shape[1] == 3:
            return self.faces
        return np.concatenate([self.faces[:, [0, 1, 2]], self.faces[:, [0, 2, 3]]])

    @property
    def edges(self) -> Indices:
        """(E, 2): edges of the faces, each once."""
        ends = np.concatenate([self.faces, self.faces[:, :1]], axis=1)
        pairs = np.sort(np.stack([ends[:, :-1].ravel(), ends[:, 1:].ravel()], axis=1), axis=1)
        return np.unique(pairs, axis=0)


def surface(fields: Fields, box: Box | None = None) -> Surface:
    """The surface of shells and solids; for beams, whose vertices go along x, the tube that `box` describes."""
    if fields.kind == "line":
        return _tube(fields, box)
    cells = fields.cells[:, : {"triangle": 3, "tetra": 4, "hexahedron": 8}[fields.kind]]
    table = np.array(_FACES[fields.kind])
    faces = cells[:, table].reshape(-1, table.shape[1])
    cell = np.repeat(np.arange(len(cells)), len(table))
    if len(table) > 1:
        _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
        outside = np.sort(first[count == 1])  # what two cells share is inside
        faces, cell = faces[outside], cell[outside]
    vertex, faces = np.unique(faces, return_inverse=True)
    faces = faces.reshape(-1, table.shape[1])
    return Surface(fields.points[vertex], faces, cell, vertex, np.zeros((len(vertex), 2)))


def surfaces(result: RunResult) -> dict[str, Surface]:
    """Surfaces of all bodies that have fields."""
    bodies = result.scene.bodies
    return {
        name: surface(body.fields, bodies[name].body.box)
        for name, body in result.bodies.items()
        if body.fields is not None
    }


def _tube(fields: Fields, box: Box | None) -> Surface:
    """Walls along a beam's axis."""
    thin = np.array([(-_THIN, -_THIN), (_THIN, -_THIN), (_THIN, _THIN), (-_THIN, _THIN)]) / 2.0
    count = len(fields.points)
    corners = np.tile([side.start for side in box.sides] if box else thin, (count, 1, 1))
    if box and box.variations:
        corners = np.array([[side.start for side in box.profile_at(float(x)).sides] for x in fields.points[:, 0]])
    around = corners.shape[1]
    vertex, lever = np.repeat(np.arange(count), around), corners.reshape(-1, 2)
    points = fields.points[vertex].astype(float)
    points[:, 1:] += lever
    first, second = around * fields.cells[:, 0], around * fields.cells[:, 1]
    ends = [(k, (k + 1) % around) for k in range(around)]
    walls = [np.stack([first + a, second + a, second + b, first + b], axis=1) for a, b in ends]
    return Surface(points, np.concatenate(walls), np.tile(np.arange(len(fields.cells)), around), vertex, lever)


_CUBE = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
_SIDES = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])


@dataclass(frozen=True)
class Block:
    """A box as drawn: its corners (8, 3) in m, and its sides (k, 4) as quadrilaterals."""

    corners: Array
    sides: NDArray[np.int64]


@dataclass(frozen=True)
class Stage:
    """The next section, pads at its mouth (`near`), which stay in the picture, and those that move with the body.

    Nothing around a boom, whose sections hold each other.
    """

    section: tuple[Block, ...]
    near: tuple[Block, ...]
    tail: tuple[Block, ...]


def stage(result: RunResult, body: Surface) -> Stage:
    """The surroundings of a body, at s = 0."""
    if not is_alone(result):
        return Stage((), (), ())
    low, high, box = body.points.min(axis=0), body.points.max(axis=0), result.scene.body.box
    rings_by_motion = {
        moving: [ring for ring in result.scene.pads if ring.moving is moving] for moving in (False, True)
    }
    near, tail = (
        tuple(block for ring in rings_by_motion[moving] for block in _pads(ring, low, high, box))
        for moving in (True, False)
    )
    ahead = max((ring.at + ring.length / 2.0 for ring in rings_by_motion[True]), default=0.1)
    start = np.array([low[0] - float(result.along.max()) - 0.1, *(low[1:] - 1.2 * THICK)])
    end = np.array([ahead, *(high[1:] + 1.2 * THICK)])
    return Stage((_block(start, end, _SIDES[2:]),), near, tail)


def _pads(ring: PadRing, low: Array, high: Array, box: Box | None) -> list[Block]:
    body = np.array([low, high])
    return [Block(pad_corners(ring, place, body, box, _CUBE + 0.5), _SIDES) for place in ring.places]


def _block(start: Array, end: Array, sides: NDArray[np.int64]) -> Block:
    return Block((start + end) / 2.0 + _CUBE * (end - start), sides)


DISPLACED = 0.08  # largest displacement as drawn, over the length of the body
EXTENSIONS = 3
#: Relative difference of two stresses that are one: they are kept in single precision.
SINGLE = 1e-5
ALMOST_ALL = 0.98  # of the cells: a few peaks must not leave the rest in one colour


@dataclass(frozen=True)
class Moment:
    """A time (s) of the fields, the mouth's position and the length beyond it (m), the largest stress (Pa)."""

    frame: int
    t: float
    s: float
    extension: float
    peak: float


def fields_by_body(result: RunResult) -> dict[str, Fields]:
    """Fields of all bodies that have some; all at the same times."""
    return {name: body.fields for name, body in result.bodies.items() if body.fields is not None}


def times(result: RunResult) -> Array:
    """Times of the fields, (F,) s."""
    return next(iter(fields_by_body(result).values())).t


def has_stresses(result: RunResult) -> bool:
    """Whether there are stresses."""
    return any(fields.von_mises for fields in fields_by_body(result).values())


def instants(result: RunResult) -> list[Moment]:
    """In each third of the stretch that the mouth visits the time of the largest stress, in order of time.

    Without stresses that of the largest displacement; one moment alone where the mouth rests.
    """
    s, t = positions(result), times(result)
    weight = _peaks(result) if has_stresses(result) else _size(result)
    parts = np.clip(((s - s.min()) / max(np.ptp(s), 1e-12) * EXTENSIONS).astype(int), 0, EXTENSIONS - 1)
    named = _named_frame(result)
    frames = [
        _largest(weight, inside, named) for part in np.unique(parts) if len(inside := np.flatnonzero(parts == part))
    ]
    largest = weight if has_stresses(result) else np.zeros_like(weight)
    chosen = sorted(frames)
    return [Moment(k, float(t[k]), float(s[k]), length(result) - float(s[k]), float(largest[k])) for k in chosen]


def of_the_peak(result: RunResult) -> Moment:
    """The stored moment nearest to the time of the largest stress that the summary names, or the one with the largest.

    Fields may be kept at fewer times than stresses.
    """
    t, s, named = times(result), positions(result), _named_peak(result).get("t")
    largest = _peaks(result) if has_stresses(result) else _size(result)
    k = int(np.argmax(largest)) if named is None else int(np.argmin(np.abs(t - named)))
    return Moment(k, float(t[k]), float(s[k]), length(result) - float(s[k]), float(largest[k]))


def place_of_the_peak(result: RunResult, moment: Moment) -> tuple[str, Array]:
    """The body with the largest stress, and where along its own axes (3,) m: as the summary has it.

    Where it has none: the middle of the cell with the largest stress at a moment.
    """
    fields, peak = fields_by_body(result), _named_peak(result)
    if "position" in peak and (body := peak.get("section", next(iter(fields)))) in fields:
        return body, np.array(peak["position"])
    stresses = {
        name: stress_of(fields_of_body)[moment.frame]
        for name, fields_of_body in fields.items()
        if fields_of_body.von_mises
    }
    body = max(stresses, key=lambda name: float(stresses[name].max()))
    stressed_fields = fields[body]
    return body, stressed_fields.points[stressed_fields.cells[int(np.argmax(stresses[body]))]].mean(axis=0)


def _largest(values: Array, among: NDArray[np.int64], preferred: int | None) -> int:
    """Number of the largest of the values `among` some; the preferred one if it is as large, as far as is kept."""
    largest = int(among[np.argmax(values[among])])
    if preferred is not None and preferred in among and values[preferred] >= (1.0 - SINGLE) * values[largest]:
        return int(preferred)
    return largest


def _named_peak(result: RunResult) -> Mapping[str, Any]:
    peak: Mapping[str, Any] = result.summary.get("stress_peak", {}).get("reduced") or {}
    return peak


def _named_frame(result: RunResult) -> int | None:
    """The frame at the time of the largest stress that the summary names, if it was kept."""
    t, field_times = _named_peak(result).get("t"), times(result)
    if t is None:
        return None
    near = int(np.argmin(np.abs(field_times - t)))
    return near if abs(field_times[near] - t) <= 1e-9 * max(1.0, abs(t)) else None


def positions(result: RunResult) -> Array:
    """Path of the mouth at the times of the fields, (F,) m; of a boom, how much shorter it is than at its longest."""
    s = result.along if result.reach is None else length(result) - result.reach
    return onto(times(result), result.responses["reduced"].t, s)


def places(result: RunResult) -> dict[str, Array]:
    """How far along x each body is drawn at the times of the fields, (F,) m: the mouth, or a base's tail, is at 0."""
    if result.reach is None:
        return {name: -positions(result) for name in fields_by_body(result)}
    return {name: along for name, (_, along) in result.travelling.items()}


def stress_of(fields: Fields) -> NDArray[np.float32]:
    """The larger of the stresses on a cell's faces, (F, C) Pa."""
    return np.maximum.reduce(list(fields.von_mises.values()))


def scale(result: RunResult) -> float:
    """How many times its size a displacement is drawn: a round number."""
    return enlargement(float(_size(result).max()), DISPLACED * length(result))


def top(result: RunResult) -> float:
    """The stress in Pa that the last colour stands for, whose quarters are short numbers; few cells ever exceed it."""
    cells = [stress_of(fields).max(axis=0) for fields in fields_by_body(result).values() if fields.von_mises]
    most = float(np.quantile(np.concatenate(cells), ALMOST_ALL))
    if most <= 0.0:
        return 1.0
    decade = 10.0 ** np.floor(np.log10(most))
    step = (0.4 if most < 4.0 * decade else 0.8) * decade
    return float(f"{step * np.ceil(most / step - 1e-9):.2g}")


def _peaks(result: RunResult) -> Array:
    """The largest stress of all bodies at each time, (F,) Pa."""
    each = [stress_of(fields).max(axis=1) for fields in fields_by_body(result).values() if fields.von_mises]
    return np.asarray(np.max(each, axis=0))


def _size(result: RunResult) -> Array:
    """The largest displacement of all bodies at each time, (F,) m."""
    each = [np.linalg.norm(fields.displacement, axis=2).max(axis=1) for fields in fields_by_body(result).values()]
    return np.asarray(np.max(each, axis=0))
