"""Extremes of what a run measured: tables, rows of the table of largest values, and clauses on where and when."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from pmr.files.arrays import Array, Summary
from pmr.report import sentences
from pmr.report.blocks import Grid
from pmr.report.numbers import NOTHING, SPACE, Unit, format_input, format_quantity, format_time, significant, unit_for
from pmr.report.subject import crossing, is_alone, moving_part
from pmr.report.subject import reach as reach_of
from pmr.results import RunResult
from pmr.results.field_stress import PeakSummary
from pmr.results.quantities import QUANTITIES
from pmr.results.response import Extreme, Extremes


class LargestValue(NamedTuple):
    """Row of the table of largest values.

    `share` is the share of the allowed value, None if there is none; `place` is the part of the boom that the value
    belongs to, as `pmr.results.quantities.Quantity` names it, or empty for the last rows of the table.
    """

    name: str
    text: str
    share: float | None = None
    place: str = ""


LargestValues = Iterator[LargestValue]


def largest_value(key: str, text: str, share: float | None = None, name: str = "", end: str = "") -> LargestValue:
    """Return the row of the quantity with this `key`, which states the part that the row belongs to.

    The row is called `name` or, if that is empty, as the quantity is reported.  Its text is `text`, followed by `end`.
    """
    quantity = QUANTITIES[key]
    return LargestValue(name or quantity.reported, text + end, share, quantity.place)


class Measured(NamedTuple):
    """Extremes of what a run measured, with its name on pages and its unit without prefix."""

    name: str
    unit: str
    extremes: Extremes

    @classmethod
    def from_summary(cls, name: str, key: str, summary: Summary) -> Measured:
        """Return the extremes in an entry `summary` of a run, called `name`, in the unit of the quantity `key`."""
        return cls(name, QUANTITIES[key].unit, Extremes.from_summary(summary))


def extremes_of(result: RunResult, values: Array) -> Extremes:
    """Return the extremes of a history (T,) of the reduced model."""
    t = result.responses["reduced"].t
    return Extremes.from_history(values, t, result.abscissa_at(t))


def extremes_grid(
    result: RunResult,
    caption: str,
    measured: Sequence[Measured],
    remark: str = "",
    floor: float = 0.0,
    where: str | None = None,
) -> Grid:
    """Build a table with the least and the largest value of all that was measured, with their times and places.

    Values of one unit have one prefix.  A value is printed as 0 if it is less than `NOTHING` times the largest one with
    its unit, or if its magnitude is at most `floor`.  `where` are words for the places, by default `then_words`;
    `remark` is a sentence after the caption.
    """
    placed, rows = where is not None or bool(moving_part(result)), []
    for name, base, extremes in measured:
        most = max(of.extremes.size for of in measured if of.unit == base)
        cells = _extreme_cells(extremes, unit_for(most, base), max(NOTHING * most, floor), placed)
        rows.append((name or "slider", *cells))
    places = then_words(result) if where is None else where
    return Grid(f"{caption}, when they occur{places}.{remark}", ("", "least", "largest"), tuple(rows))


def _extreme_cells(extremes: Extremes, unit: Unit, negligible: float, placed: bool) -> Iterator[str]:
    """Yield a cell for the least and one for the largest value in `unit`, each with its time and, if `placed`, place.

    A value whose magnitude does not exceed `negligible` is printed as ``0`` without time and place.  `negligible` is in
    the unit without prefix.
    """
    for extreme in (extremes.lowest, extremes.highest):
        place = f", {format_input(round(extreme.s, 2), 'm')}" if placed else ""
        value = unit.after(significant(extreme.value / unit.size))
        yield f"{value} at {format_time(extreme.t)}{place}" if abs(extreme.value) > negligible else "0"


def then_words(result: RunResult) -> str:
    """Clause on the coordinate at which extremes occur: the path coordinate s for a body alone, else the boom length.

    Where a mass on a wheel crosses another section, it is the place of the wheel.  The clause is empty if nothing
    slides.
    """
    if not moving_part(result):
        return ""
    if mover := crossing(result):
        return f", and the place of {mover} then"
    return f", and {'the path coordinate s' if is_alone(result) else 'the boom length'} then"


def peak_place_clause(result: RunResult, peak: PeakSummary) -> str:
    """Clause with the point and the time of a largest stress, and with the boom's angles at that time."""
    where = [sentences.peak_part_name(peak), f"{two_decimals(peak['position'][0])}{SPACE}m from the tail"]
    return f"{', '.join(filter(None, where))}, at {format_time(peak['t'])}{angles_clause(result, peak['t'])}"


def extreme_clause(result: RunResult, extreme: Extreme) -> str:
    """Clause with the time of an extreme value, and with the reach (or path coordinate) and the angles at that time."""
    where = ", ".join(filter(None, (f"at {format_time(extreme.t)}", position_text(result, extreme.s))))
    return f"{where}{angles_clause(result, extreme.t)}"


def angles_clause(result: RunResult, t: float) -> str:
    """Clause at the end of a sentence: luffing and slewing angle in degrees of a boom in a frame at `t` in s.

    It begins with a comma (", raised 30°, slewed 10°").  An angle that the frame does not set is left out; without a
    frame the clause is empty.
    """
    frame = result.frame
    if frame is None:
        return ""
    luffing, slewing = (float(np.rad2deg(angle.value(np.array([t]))[0])) for angle in frame.angles)
    angles = [] if frame.luffing is None else [f"raised {format_input(round(luffing, 1))}°"]
    angles += [] if frame.slewing is None else [f"slewed {format_input(round(slewing, 1))}°"]
    return "".join(f", {angle_text}" for angle_text in angles)


def position_text(result: RunResult, position: float) -> str:
    """Describe `position` in m: the length of a boom, the length of a section beyond its mouth, or s of the sliders.

    The text is empty for a body that does not slide.
    """
    if mover := crossing(result):
        return f"{mover} at {two_decimals(position)}{SPACE}m"
    if not is_alone(result):
        return f"boom length {two_decimals(position)}{SPACE}m"
    if moving_part(result) == "mouth":
        return f"{two_decimals(reach_of(result) - position)}{SPACE}m out"
    return f"s = {two_decimals(position)}{SPACE}m" if moving_part(result) else ""


def two_decimals(value: float) -> str:
    """Format the number `value`, rounded to two decimals."""
    return format_input(round(value, 2))


def value_at(result: RunResult, extreme: Extreme, unit: str, *words: str) -> str:
    """Text of an extreme value in `unit` (without prefix), followed by some `words` and by its time and place."""
    return ", ".join((format_quantity(extreme.value, unit), *words, extreme_clause(result, extreme)))
