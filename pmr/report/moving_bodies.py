"""Bodies of a run as pictures and animation show them: surfaces, places, stresses, and the moments to draw."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.files.arrays import Array
from pmr.report.bodies import Surface, Surroundings, body_surface, build_surroundings
from pmr.report.columns import axis_points, interpolate, spread_indices
from pmr.report.numbers import enlargement
from pmr.report.subject import reach
from pmr.results import Fields, RunResult
from pmr.results.field_series import Grid

DISPLACED = 0.08  # largest displacement in a picture, as a share of the length of the body
FRAMES = 1500  # largest number of times of an animation of axes
EXTENSIONS = 3  # parts of the mouth's range, each with a picture
ALMOST_ALL = 0.98  # share of the cells within the colour scale: a few peaks must not leave all others in one colour


@dataclass(frozen=True)
class Moment:
    """Stored time of the fields that is drawn: its index `frame`, the time t in s, and the state at this time.

    The mouth is at the path coordinate s in m, and the body extends `extension` m beyond the mouth; `peak` is the
    largest stress in Pa.
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

    The fields are the recovered ones; if there are none, displacements of the points along the axes of all bodies.

    Attributes
    ----------
    fields, surfaces : dict
        Fields and surface of each body, by its name; both are empty if there is nothing to draw.
    t : (F,) array, s
    mouth : (F,) array, m
        Path coordinate of the mouth.  For a boom it is the largest reach minus the reach.
    shifts : dict of (F,) arrays, m
        Shift along x with which each body is drawn.  A body alone is shifted by -s, so that the mouth is drawn at 0; a
        section of a boom by the position of its tail along the boom, measured from the tail of the base.
    stresses, displacements : (F,) arrays, Pa and m
        Largest von Mises stress of all cells, and length of the largest displacement.
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

        A quarter of the number has few digits, too.  The stress is 1e6 Pa if the fields have no stresses.
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

        In each third, it is the stored time with the largest stress among all times at which the mouth is there.  If
        there are no stresses, it is the time with the largest displacement.  If the mouth does not move, there is one
        moment.
        """
        s, weight = self.mouth, self.stresses if self.cell_stresses else self.displacements
        parts = np.clip(((s - s.min()) / max(np.ptp(s), 1e-12) * EXTENSIONS).astype(int), 0, EXTENSIONS - 1)
        groups = (np.flatnonzero(parts == part) for part in np.unique(parts))
        return [self._moment(k) for k in sorted(int(inside[np.argmax(weight[inside])]) for inside in groups)]

    def moment_of_peak(self) -> Moment:
        """Return the stored moment nearest to the time of the largest stress in the summary.

        That time itself may not be stored, as fields may be kept at fewer times than stresses.  If the summary has no
        such time, the moment with the largest stress in the fields is returned, or with the largest displacement if the
        fields have no stresses.
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
        `moment`.
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
        """Entry ``stress_peak.reduced`` of the summary: time and place of the largest stress; empty without it."""
        return dict(self.result.summary.get("stress_peak", {}).get("reduced") or {})


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

    It is the largest of the stresses that are stored for the faces of a cell.
    """
    return np.maximum.reduce(list(fields.von_mises.values()))
