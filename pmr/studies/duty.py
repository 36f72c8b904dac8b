"""Duty tables of a load chart: the allowed load over radius and boom length, as the manuals of machines print it.

A duty table holds no load that the chart did not compute: between two neighbouring luffing angles the smaller of their
loads counts, and outside the radii that a boom length reaches there is none.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.errors.environment import import_package
from pmr.errors.text import letters
from pmr.files.arrays import Array
from pmr.studies.charting import governing_limit, lower_bounds
from pmr.studies.results import csv_text

#: Distances in m between the radii of a table, times a power of ten, and the largest number of radii.
STEPS, MOST_RADII = (1.0, 2.0, 5.0), 30


class LeastLoads(NamedTuple):
    """Smallest loads over all slewing angles, for E boom lengths in increasing order, A luffing angles and l limits."""

    load: Array  # (E, A, l) kg, NaN where a limit is not reached
    error: Array  # (E, A, l) kg
    place: Array  # (E, A, 2) m, radius and height of the tip from the pivot
    luffing: Array  # (A,) rad
    order: NDArray[np.int64]  # (E,), number of the row of extensions that each boom length is

    @classmethod
    def from_rows(cls, rows: Sequence[Mapping[str, Array]], turns: int) -> LeastLoads:
        """Return the smallest loads from the arrays of all rows of a chart, whose points have `turns` slewing angles.

        The arrays are those of `pmr.studies.charting.allow_row`.
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


@dataclass(frozen=True)
class DutyTable:
    """Allowed loads at R radii for E boom lengths; NaN outside the radii that a boom length reaches.

    Where no limit is reached, the load is the largest one that was tried.
    """

    radii: Array  # (R,) m
    lengths: Array  # (E,) m, distances of the undeformed tip from the pivot
    load: Array  # (R, E) kg
    lower: Array  # (R, E) kg: the load less its error bars
    which: NDArray[np.int64]  # (R, E), number of the limit that governs; -1 where no limit is reached

    @classmethod
    def from_loads(cls, least: LeastLoads, up_to: float) -> DutyTable:
        """Return the duty table of a chart; `up_to` is the largest load in kg that was tried."""
        E, A, limits = least.load.shape
        flat, error = least.load.reshape(-1, limits), least.error.reshape(-1, limits)
        which = governing_limit(flat).reshape(E, A)
        load = np.nan_to_num(flat, nan=up_to).min(axis=1).reshape(E, A)
        lower = np.maximum(lower_bounds(flat, error, up_to).min(axis=1), 0.0).reshape(E, A)
        radius, radii = least.place[:, :, 0], _round_radii(least.place[:, :, 0])
        nearest = np.full((len(radii), E), -1)  # number of the angle whose load counts
        for e in range(E):
            for first, last in [(k, k + 1) for k in range(A - 1)] or [(0, 0)]:
                ends = np.sort(radius[e, [first, last]])
                slack = 1e-9 * float(np.abs(radius).max())
                inside = (radii >= ends[0] - slack) & (radii <= ends[1] + slack)
                for k in (first, last):
                    at = nearest[:, e]
                    taken = inside & ((at < 0) | (load[e, k] < load[e, at]))
                    other = last if k == first else first
                    is_end = (np.abs(radii - radius[e, other]) <= slack) & (first != last)
                    nearest[taken & ~is_end, e] = k
        outside, rows = nearest < 0, np.arange(E)
        allowed, bound = (np.where(outside, np.nan, array[rows, nearest]) for array in (load, lower))
        lengths = np.linalg.norm(least.place[:, 0], axis=1)
        return cls(radii, lengths, allowed, bound, np.where(outside, -1, which[rows, nearest]))

    def csv(self, names: Sequence[str]) -> str:
        """Return the table as text in CSV; `names` are the names of the limits."""
        heads = ["radius [m]"]
        for length in self.lengths:
            heads += [f"{length:.4g} m: {column}" for column in ("load [kg]", "lower bound [kg]", "governed by")]
        rows = []
        for r, radius in enumerate(self.radii):
            row = [f"{radius:.9g}"]
            for e in range(len(self.lengths)):
                reached = np.isfinite(self.load[r, e])
                by = names[self.which[r, e]] if self.which[r, e] >= 0 else "none"
                cells = (f"{self.load[r, e]:.9g}", f"{self.lower[r, e]:.9g}", by)
                row += cells if reached else ("", "", "")
            rows.append(row)
        return csv_text(heads, rows)

    def workbook(self, title: str, names: Sequence[str]) -> bytes:
        """Return the table as an XLSX file with the given title, and sheets of loads, lower bounds and limits.

        A cell holds the load as a number, and shows the letter of its limit behind it.  `names` are those of the
        limits.  Raises InputError if openpyxl is not installed.
        """
        book = import_package("openpyxl").Workbook()
        book.properties.title = title
        for sheet, values in ((book.active, self.load), (book.create_sheet(), self.lower)):
            sheet.title = "Loads in kg" if values is self.load else "Lower bounds in kg"
            sheet.append(["radius in m, boom length in m →", *(round(float(length), 3) for length in self.lengths)])
            for radius, row in zip(self.radii, values, strict=True):
                sheet.append([float(radius), *(float(cell) if np.isfinite(cell) else None for cell in row)])
            for r, row in enumerate(self.which, start=2):
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


def _round_radii(radius: Array) -> Array:
    """Return round radii (R,) in m within the range of `radius` (E, A) in m, or all radii where angles are single."""
    low, high = float(radius.min()), float(radius.max())
    if radius.shape[1] == 1 or high - low < 1e-6 * abs(high):
        return np.unique(radius)
    decade = 10.0 ** np.floor(np.log10((high - low) / MOST_RADII))
    step = next(s for s in (decade * STEPS[0], decade * STEPS[1], decade * STEPS[2], 10.0 * decade)
                if (high - low) / s <= MOST_RADII)  # fmt: skip
    return np.asarray(step * np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1.0))
