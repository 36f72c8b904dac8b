"""Loads that a chart allows between its points: its duty table, and the postures of its scene's run.

A duty table has the allowed load over radius and boom length, as manuals print it: at each round radius, and at the
least and the greatest one.  It is interpolated between the luffing angles of the chart; outside the radii that a boom
length reaches there is no load.  In the postures of a run, the smallest load is interpolated likewise.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from pmr.errors import letters
from pmr.errors.environment import import_package
from pmr.files.arrays import Array
from pmr.scene import Scene
from pmr.studies.charting import governing_limit
from pmr.studies.study import csv_text

#: Words in place of a limit where none is reached up to the largest load that is tried.
NOT_LIMITED = "not limited by what is looked at"
#: Distances in m between the radii of a table, times a power of ten, and the largest number of radii.
STEPS, MOST_RADII = (1.0, 2.0, 5.0), 30
#: Largest difference in rad between angles that count as the same; also a share of a radius.
SAME_ANGLE = 1e-6
#: Number of times of a run that are looked at, and largest difference in m between extensions that count as equal.
TIMES, SAME_EXTENSION = 1001, 1e-3


@dataclass(frozen=True)
class ChartLoads:
    """Loads (..., l) in kg at which l limits are reached at the points of a chart, with their errors (..., l) in kg.

    A load is NaN where no load up to `up_to` in kg reaches the limit; an error that is NaN counts as 0.
    """

    load: Array
    error: Array
    up_to: float

    @cached_property
    def least(self) -> Array:
        """Smallest load of all limits (...,) in kg; infinite where no limit is reached."""
        return np.asarray(np.nan_to_num(self.load, nan=np.inf).min(axis=-1))

    @cached_property
    def which(self) -> NDArray[np.int64]:
        """Number of the limit with the smallest load (...,); -1 where no limit is reached."""
        return governing_limit(self.load)

    @cached_property
    def lower(self) -> Array:
        """Loads (..., l) in kg less their errors; a limit that is not reached has the load `up_to`."""
        return np.asarray(np.nan_to_num(self.load, nan=self.up_to) - np.nan_to_num(self.error))

    @cached_property
    def lower_bound(self) -> Array:
        """Load (...,) in kg that all limits allow at least, less the errors; 0 where this is negative."""
        return np.maximum(self.lower.min(axis=-1), 0.0)

    @cached_property
    def which_lower(self) -> NDArray[np.int64]:
        """Number of the limit with the smallest load less its error (...,); -1 where this is `up_to`."""
        return np.where(self.lower.min(axis=-1) < self.up_to, self.lower.argmin(axis=-1), -1)

    @cached_property
    def bar(self) -> Array:
        """Error (...,) in kg of the limit `which_lower`; NaN where there is none, and where its error is not known."""
        error = np.take_along_axis(self.error, np.maximum(self.which_lower, 0)[..., None], -1)[..., 0]
        return np.where(self.which_lower >= 0, error, np.nan)

    @cached_property
    def may_govern(self) -> NDArray[np.bool_]:
        """Whether each limit may govern within the errors (..., l); false at points where only one limit may.

        Every limit that is reached has a largest possible load at a point: its load plus its error.  A limit may govern
        if its load minus its error is at most the smallest of these.  A limit that is not reached counts with the load
        `up_to`; it may govern only if it has an error.
        """
        not_reached = np.isnan(self.load)
        low = np.where(not_reached & (self.lower >= self.up_to), np.inf, self.lower)
        high = np.where(not_reached, np.inf, self.load + np.nan_to_num(self.error)).min(axis=-1, keepdims=True)
        may = (low <= high) & np.isfinite(low)
        return np.asarray(may & (may.sum(axis=-1, keepdims=True) > 1))


class LeastLoads(NamedTuple):
    """Smallest loads of all slewing angles, for E boom lengths in increasing order, A luffing angles and l limits."""

    load: Array  # (E, A, l) kg, NaN where a limit is not reached
    error: Array  # (E, A, l) kg
    place: Array  # (E, A, 2) m, radius and height of the tip from the pivot
    luffing: Array  # (A,) rad
    order: NDArray[np.int64]  # (E,), number of the row of the chart that has each boom length

    @classmethod
    def from_rows(cls, rows: Sequence[Mapping[str, Array]], turns: int) -> LeastLoads:
        """Return the smallest loads of all `turns` slewing angles, from the arrays of all rows of a chart.

        The arrays of a row, by name, are those of `pmr.studies.charting.allow_row`.  Their first axis has the points of
        the row, all slewing angles of a luffing angle in succession.
        """
        load, error, place = (
            np.array([row[name].reshape(-1, turns, row[name].shape[1]) for row in rows])
            for name in ("load", "error", "place")
        )
        at = np.where(np.isnan(load), np.inf, load).argmin(axis=2)[:, :, None]
        load, error = (np.take_along_axis(values, at, 2)[:, :, 0] for values in (load, error))
        place = place[:, :, 0]
        order = np.argsort(np.linalg.norm(place[:, 0], axis=1), kind="stable")
        return cls(load[order], error[order], place[order], rows[0]["luffing"].reshape(-1, turns)[:, 0], order)

    def at_radii(self, radii: Array, lower: Array, e: int, up_to: float) -> Array:
        """Return loads, lower bounds and differences (3, R, l) in kg of l limits at R `radii`, for one boom length.

        `e` is the number of the boom length, and the `radii` (R,) in m are those of the tip.  All three results are NaN
        at radii that the tip does not reach.

        - Loads are interpolated between luffing angles with curves.  A limit that is not reached counts as reached at
          `up_to` in kg.
        - A difference is the magnitude of the difference between interpolation with curves and with straight lines.
        - Lower bounds are interpolated from `lower` (E, A, l) in kg, the bounds for E boom lengths at A luffing angles.
          The difference is subtracted from them; they are at least 0.

        The tip may have a radius at two angles, above and below the horizontal.  Then the smaller load and bound count,
        and the larger difference.
        """
        luffing, order = np.unique(self.luffing, return_index=True)
        place, load = self.place[e, order, 0], np.nan_to_num(self.load[e, order], nan=up_to)
        angles = _angles_at_radii(radii, place, luffing)
        of_load, straight, bound = (
            interpolate_loads(angles, luffing, values, up_to, smooth=smooth)
            for values, smooth in ((load, True), (load, False), (lower[e, order], True))
        )
        apart = np.abs(of_load - straight)
        return np.array([np.fmin(*of_load), np.fmin(*np.maximum(bound - apart, 0.0)), np.fmax(*apart)])


@dataclass(frozen=True)
class DutyTable:
    """Allowed loads at R radii for E boom lengths; NaN outside the radii that a boom length reaches.

    Where no limit is reached, the load is `up_to`, the largest one that was tried: the allowed load is larger.
    """

    radii: Array  # (R,) m
    lengths: Array  # (E,) m, distances of the undeformed tip from the pivot
    load: Array  # (R, E) kg
    lower: Array  # (R, E) kg: the load less its error bars
    which: NDArray[np.int64]  # (R, E), number of the limit that governs; -1 where no limit is reached
    which_lower: NDArray[np.int64]  # (R, E), number of the limit with the smallest lower bound; -1 if that is `up_to`
    up_to: float  # kg
    extensions: tuple[Mapping[str, Any], ...] = ()  # (E,) mappings of extensions in m by parameter of the study's runs
    interpolation: float = 0.0  # largest share of a load by which straight lines differ from the curves between angles

    @property
    def column_names(self) -> list[str]:
        """Boom lengths as text, with the extensions of each section where several columns have the same length."""
        return [f"{length:.4g} m{apart}" for length, apart in zip(self.lengths, self.differences, strict=True)]

    @property
    def differences(self) -> list[str]:
        """Text behind each boom length that tells equal lengths apart: extensions in brackets, such as `` (fly 3)``.

        The text is empty for a length that no other column has.
        """
        lengths = [f"{length:.4g}" for length in self.lengths]
        return [
            f" ({extensions_text(self.extensions[e])})" if self.extensions and lengths.count(length) > 1 else ""
            for e, length in enumerate(lengths)
        ]

    def load_text(self, load: float, digits: str = ".0f") -> str:
        """Return a load in kg as text in the format `digits`; ``>`` and `up_to` for a load of `up_to` or more."""
        return f">{self.up_to:{digits}}" if load >= self.up_to else f"{load:{digits}}"

    @classmethod
    def from_loads(cls, least: LeastLoads, up_to: float, rows: Sequence[Mapping[str, Any]] = ()) -> DutyTable:
        """Return the duty table from the loads `least` of a chart; `up_to` is the largest load in kg that was tried.

        `rows` are the parameters of the rows of the chart, the extensions in m; they tell boom lengths apart that are
        equal.
        """
        radii = _round_radii(least.place[:, :, 0])
        lower = np.maximum(ChartLoads(least.load, least.error, up_to).lower, 0.0)
        columns = np.array([least.at_radii(radii, lower, e, up_to) for e in range(len(least.load))])
        load, bound, apart = np.moveaxis(columns, 0, 2)  # (R, E, l) each
        limited, which = load.min(axis=2), load.argmin(axis=2)
        between = (limited > 0.0) & (limited < up_to)
        share = np.take_along_axis(apart, which[..., None], 2)[between, 0] / limited[between]
        lengths, smallest = np.linalg.norm(least.place[:, 0], axis=1), bound.min(axis=2)
        which = np.where(limited < up_to, which, -1)
        which_lower = np.where(smallest < up_to, bound.argmin(axis=2), -1)
        extensions = tuple(rows[row] for row in least.order if rows)
        return cls(radii, lengths, limited, smallest, which, which_lower, up_to, extensions, share.max(initial=0.0))

    def csv(self, names: Sequence[str]) -> str:
        """Return the table as text in CSV; `names` are the names of the limits.

        Each boom length has four columns: the load, its lower bound, and the names of the limits that govern the two.
        Cells are empty at radii that the boom does not reach.
        """
        heads = ["radius [m]"]
        for name in self.column_names:
            heads += [f"{name}: {of}" for of in ("load [kg]", "lower bound [kg]", "governed by", "lower bound by")]
        rows = []
        for r, radius in enumerate(self.radii):
            row = [f"{radius:.9g}"]
            for e in range(len(self.lengths)):
                reached = np.isfinite(self.load[r, e])
                numbers = (int(of[r, e]) for of in (self.which, self.which_lower))
                by = (names[number] if number >= 0 else NOT_LIMITED for number in numbers)
                cells = (*(self.load_text(of[r, e], ".9g") for of in (self.load, self.lower)), *by)
                row += cells if reached else ("",) * len(cells)
            rows.append(row)
        return csv_text(heads, rows)

    def workbook(self, title: str, names: Sequence[str]) -> bytes:
        """Return the table as an XLSX file with the given title, and sheets of loads, lower bounds and limits.

        A cell holds the load as a number, and shows the letter of its limit after it; where no limit is reached it
        holds ``>`` and the largest load that was tried, as text.  `names` are those of the limits.  Raises InputError
        if openpyxl is not installed.
        """
        book = import_package("openpyxl").Workbook()
        book.properties.title = title
        tables = (("Loads in kg", self.load, self.which), ("Lower bounds in kg", self.lower, self.which_lower))
        for title_of_sheet, values, which in tables:
            sheet = book.active if values is self.load else book.create_sheet()
            sheet.title = title_of_sheet
            lengths = zip(self.lengths, self.column_names, strict=True)
            heads = (name if "(" in name else round(float(length), 3) for length, name in lengths)
            sheet.append(["radius in m, boom length in m →", *heads])
            for radius, row in zip(self.radii, values, strict=True):
                loads = (None if np.isnan(cell) else float(cell) for cell in row)
                cells = (self.load_text(cell) if cell is not None and cell >= self.up_to else cell for cell in loads)
                sheet.append([float(radius), *cells])
            for r, row in enumerate(which, start=2):
                for e, number in enumerate(row, start=2):
                    sheet.cell(r, e).number_format = f'0" {letters(int(number))}"' if number >= 0 else "0"
            sheet.freeze_panes, sheet.column_dimensions["A"].width = "B2", 32
        legend = book.create_sheet("Limits")
        legend.append(["letter", "limit"])
        for number, name in enumerate(names):
            legend.append([letters(number), name])
        file = io.BytesIO()
        book.save(file)
        return file.getvalue()


def extensions_text(parameters: Mapping[str, Any]) -> str:
    """Return the extensions in m of a row of a chart as text with their names, such as "fly 3.2 + middle 0".

    `parameters` are the extensions of the row's run, by names such as ``extension.fly``; None stands for 0.  The text
    is empty without extensions.
    """
    return " + ".join(f"{name.removeprefix('extension.')} {float(out or 0.0):.4g}" for name, out in parameters.items())


def _angles_at_radii(radii: Array, place: Array, luffing: Array) -> Array:
    """Return the two luffing angles (2, R) in rad at which the tip has each of the `radii` (R,) in m.

    `place` (A,) are the tip's radii in m at A increasing angles `luffing`.  An angle outside the range of `luffing` is
    NaN.  If the tip has a radius at one angle only, the other angle is NaN, too; both are NaN if it never has the
    radius.
    """
    angles = np.full((2, len(radii)), np.nan)
    if len(luffing) == 1:
        angles[0, np.isclose(radii, place[0], rtol=1e-9)] = luffing[0]
        return angles
    # the tip turns about the pivot: its radius is across cos(angle) + up sin(angle)
    across, up = np.linalg.lstsq(np.column_stack([np.cos(luffing), np.sin(luffing)]), place, rcond=None)[0]
    length = np.hypot(across, up)
    turned = np.where(radii <= length * (1.0 + SAME_ANGLE), np.arccos(np.clip(radii / length, -1.0, 1.0)), np.nan)
    angles[:] = np.arctan2(up, across) + np.array([[1.0], [-1.0]]) * turned
    outside = (angles < luffing[0] - SAME_ANGLE) | (angles > luffing[-1] + SAME_ANGLE)
    return np.where(outside, np.nan, np.clip(angles, luffing[0], luffing[-1]))


def interpolate_loads(angles: Array, luffing: Array, load: Array, up_to: float, smooth: bool = True) -> Array:
    """Loads (..., l) in kg that l limits allow at luffing angles `angles` (...) in rad; NaN where an angle is NaN.

    They are interpolated between the loads `load` (A, l) in kg at A increasing angles `luffing` (A,) in rad.  A single
    angle gives its load everywhere.  What is interpolated is the inverse of the load, because a moment that a limit
    allows is the load times a radius.  The interpolation is by monotone cubic curves, or by straight lines if not
    `smooth`.

    If one of two neighbouring angles allows no load, no load is allowed between them, because the angle at which the
    boom is permitted again is not known.  `up_to` in kg is the largest load that was tried.  It only sets a small
    offset that keeps the inverse of a load of 0 finite; it is no upper limit.
    """
    if len(luffing) == 1:
        return np.where(np.isnan(angles)[..., None], np.nan, load[0])
    offset = 1e-3 * up_to  # keeps the inverse of a load of 0 finite
    inverse = 1.0 / (load + offset)
    if smooth:
        curves = PchipInterpolator(luffing, inverse)(angles)
    else:
        curves = np.stack([np.interp(angles, luffing, values) for values in inverse.T], axis=-1)
    between = 1.0 / curves - offset
    interval = np.clip(np.searchsorted(luffing, angles) - 1, 0, len(luffing) - 2)
    low, high = load[interval], load[interval + 1]
    # no round-off where both ends have the same load, and none at the angles themselves
    between = np.where((low == high) | (np.minimum(low, high) <= 0.0), np.minimum(low, high), between)
    for end, values in ((interval, low), (interval + 1, high)):
        between = np.where(np.isclose(angles, luffing[end], rtol=0.0, atol=SAME_ANGLE)[..., None], values, between)
    return np.where(np.isnan(angles)[..., None], np.nan, between)


def _round_radii(radius: Array) -> Array:
    """Return ascending radii (R,) in m for a table: the least and the greatest `radius`, and round ones between them.

    `radius` (E, A) in m has the radii with E boom lengths at A luffing angles.  All of them are returned, each once, if
    A is 1 or if they are nearly equal.
    """
    low, high = float(radius.min()), float(radius.max())
    if radius.shape[1] == 1 or high - low < 1e-6 * abs(high):
        return np.unique(radius)
    decade = 10.0 ** np.floor(np.log10((high - low) / MOST_RADII))
    step = next(s for s in (decade * STEPS[0], decade * STEPS[1], decade * STEPS[2], 10.0 * decade)
                if (high - low) / s <= MOST_RADII)  # fmt: skip
    between = step * np.arange(np.floor(low / step + 1e-9) + 1.0, np.ceil(high / step - 1e-9))
    return np.concatenate([[low], between, [high]])


class LeastAllowed(NamedTuple):
    """Posture of a run in which a chart allows least, and the load and limit of the chart there."""

    load: float  # kg, less its error
    limit: int  # number of the limit that allows this load; -1 if no limit is reached
    t: float  # s
    luffing: float  # rad
    length: float  # m, boom length


def payload_of(scene: Scene) -> float:
    """Return the sum in kg of the masses that are payloads."""
    return sum(mass.mass for part in scene.sections for mass in part.masses if mass.payload)


def least_allowed(
    scene: Scene, least: LeastLoads, rows: Sequence[Mapping[str, Any]], up_to: float
) -> LeastAllowed | None:
    """Return the posture of a scene's run in which its chart allows least; None if the chart has none of its postures.

    `least` are the loads of the chart, the smallest of all slewing angles.  `rows` are the extensions in m of the
    chart's rows, by parameter such as ``extension.fly``.  Postures of the run are taken at `TIMES` even times from 0 to
    its end.  The chart has a posture if the luffing angle is in the range of the chart, and the extensions are between
    those of two rows.

    The allowed load is the load less its error.  Between luffing angles it is interpolated as in the duty table, and
    between two boom lengths in its inverse.  If one of the two lengths allows nothing, nothing is allowed.  `up_to` in
    kg is the largest load that was tried; the allowed load is at most this.
    """
    assert scene.frame is not None and scene.frame.luffing is not None
    t, ordered = np.linspace(0.0, scene.time.end, TIMES), [rows[row] for row in least.order]
    names = [name.removeprefix("extension.") for name in ordered[0]]
    of_rows = np.array([[float(row[f"extension.{name}"]) for name in names] for row in ordered])  # (E, n)
    of_run = np.array([scene.extension(scene.names.index(name)).value(t) for name in names]).reshape(-1, TIMES)
    luffing = np.asarray(scene.frame.angles.luffing.value(t))
    number = np.interp(of_run.sum(axis=0), of_rows.sum(axis=1), np.arange(len(ordered)))  # row at each time
    drawn_out = np.array([np.interp(number, np.arange(len(ordered)), column) for column in of_rows.T])
    inside = np.all(np.abs(drawn_out.reshape(-1, TIMES) - of_run) < SAME_EXTENSION, axis=0)
    angles, order = np.unique(least.luffing, return_index=True)
    inside &= (luffing > angles[0] - SAME_ANGLE) & (luffing < angles[-1] + SAME_ANGLE)
    if not inside.any():
        return None
    t, number, luffing = t[inside], number[inside], np.clip(luffing[inside], angles[0], angles[-1])
    first = np.minimum(number.astype(int), max(len(ordered) - 2, 0))
    second, share = np.minimum(first + 1, len(ordered) - 1), (number - first)[:, None]
    of_chart = np.maximum(ChartLoads(least.load, least.error, up_to).lower, 0.0)[:, order]
    loads = np.stack([interpolate_loads(luffing, angles, of_row, up_to) for of_row in of_chart])  # (E, T, l)
    low, high = (loads[rows_at, np.arange(len(t))] for rows_at in (first, second))
    some = np.minimum(low, high) > 0.0
    low, high = np.where(some, low, 1.0), np.where(some, high, 1.0)
    between = np.where(some, 1.0 / ((1.0 - share) / low + share / high), 0.0)
    k = int(between.min(axis=1).argmin())
    limit, load = int(between[k].argmin()), float(between[k].min())
    lengths = np.linalg.norm(least.place[:, 0], axis=1)
    length = float(np.interp(number[k], np.arange(len(ordered)), lengths))
    return LeastAllowed(load, limit if load < (1.0 - 1e-9) * up_to else -1, float(t[k]), float(luffing[k]), length)
