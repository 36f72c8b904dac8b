"""Key numbers and sentences of a run, and its extremes: tables, rows of largest values, clauses on where and when."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from pmr.files.arrays import Array, Summary
from pmr.report import trust
from pmr.report.blocks import Grid, KeyNumber
from pmr.report.columns import largest_by_unit
from pmr.report.numbers import (
    MINUS,
    NOTHING,
    SPACE,
    Unit,
    format_input,
    format_percent,
    format_quantity,
    format_time,
    prose,
    significant,
    unit_for,
)
from pmr.report.subject import (
    crossing,
    is_alone,
    moving_part,
    reduced_size,
    scope_words,
)
from pmr.report.subject import reach as reach_of
from pmr.results import RunResult
from pmr.results.field_stress import PeakSummary
from pmr.results.quantities import QUANTITIES
from pmr.results.response import Extreme, Extremes

#: Largest number of further points with the largest stress that are named; if there are more, only their number is
#: stated.
MOST_PLACES = 2


def key_numbers(result: RunResult) -> Iterator[KeyNumber]:
    """Yield the key numbers of a run: its error, the time of the simulation, and the number of coordinates.

    If errors of several sources can be added up, the error is the largest of these sums.  If not, it is the error along
    the beam or its estimate.  Numbers that are not known are left out.
    """
    totals = trust.summed_errors(result.summary)
    if totals.by_key:
        key = max(totals.by_key, key=lambda name: totals.by_key[name])
        note, probed = f"in {QUANTITIES[key].label}, {totals.sources_clause(key)}", "probe" in totals.by_key
        what = f"largest sum of errors, without stresses{' away from probes' if probed else ''}"
        yield KeyNumber(format_percent(totals.by_key[key], 2), what, note)
    else:
        yield from _error_key_numbers(result)
    yield from _simulation_time(result)
    coordinates, reduced = result.summary.get("coordinates", {}), reduced_size(result)
    full = coordinates.get("full")
    fewer = "" if full is None else format_percent(1.0 - reduced / full, 2 if reduced > 0.005 * full else 4)
    arrow = f"{reduced}" if full is None else f"{format_input(full)}{SPACE}→{SPACE}{reduced}"
    yield KeyNumber(arrow, "coordinates", f"{fewer} fewer" if fewer else "")


def _error_key_numbers(result: RunResult) -> Iterator[KeyNumber]:
    """Yield the error along the beam; its estimate if the error is not known, or nothing if neither is known."""
    errors = result.summary.get("errors", {}).get("reduced_vs_full", {})
    estimated = result.summary.get("estimate", {}).get("beam")
    without = "" if estimated is None else f"estimated without the full model {format_percent(estimated)}"
    if "beam" in errors:
        tip = f"at the tip {format_percent(errors['tip'])}" if "tip" in errors else ""
        yield KeyNumber(
            format_percent(errors["beam"]), f"RMS error {scope_words(result)}", "; ".join(filter(None, (tip, without)))
        )
    elif estimated is not None:
        yield KeyNumber(format_percent(estimated), f"estimated error {scope_words(result)}", "without the full model")


def _simulation_time(result: RunResult) -> Iterator[KeyNumber]:
    """Yield how many times faster the reduced model was simulated than the full model; else its simulation time.

    The ratio is only yielded if one simulator computed both models.  Nothing is yielded if the time of the reduced
    model is not known.  The note has the times of both models, and compares the time of the reduced model with the
    simulated time.
    """
    reduced, full = (
        result.responses[name].seconds if name in result.responses else 0.0 for name in ("reduced", "full")
    )
    if reduced <= 0.0:
        return
    end, names, took = result.scene.time.end, result.summary.get("simulators", {}), format_quantity(reduced, "s")
    paced = f"{significant(end / reduced, 2)} times faster" if end > reduced else "slower"
    motion = f"for {format_input(end, 's')} of motion, {paced} than real time"
    motion += f"; full model {format_quantity(full, 's', 2)}" if full > 0.0 else ""
    if full > 0.0 and names.get("reduced") == names.get("full"):
        yield KeyNumber(f"{significant(full / reduced, 2)}{SPACE}×", "as fast as the full model", f"{took} {motion}")
    else:
        yield KeyNumber(took, "one simulation", motion)


def peak_clause(peak: PeakSummary) -> str:
    """Clause on a largest von Mises stress: its time, point, face and section, and other points with this stress."""
    of = peak_part_name(peak)
    of = f", {of}" if of else ""
    return f"at {peak['t']:.2f}{SPACE}s and {_format_point(peak['position'])}{of}" + _other_points_clause(
        peak.get("shared", ())
    )


def peak_part_name(peak: PeakSummary) -> str:
    """Name the face or corner, the region and the section of a largest stress; empty if the peak states none."""
    face = peak.get("face", "")
    on = f"{face} {'corner' if ' ' in face else 'face'}" if face else ""
    return " of ".join(filter(None, (on, peak.get("region"), peak.get("section"))))


def _other_points_clause(places: Sequence[Sequence[float]]) -> str:
    """Words that name the other points, `places`, at which the stress is equally large; empty without such points."""
    if len(places) > MOST_PLACES:
        return f"; {len(places)} other places have the same stress"
    return f"; the stress is the same at {' and '.join(map(_format_point, places))}" if places else ""


def _format_point(position: Sequence[float]) -> str:
    """Format the `position` (x, y, z) of a point in m, rounded to 0.01 m."""
    # adding 0.0 removes the sign of a negative zero
    x, y, z = (f"{round(value, 2) + 0.0:.2f}".replace("-", MINUS) for value in position)
    return f"({x}, {y}, {z}){SPACE}m"


def frame_sentences(result: RunResult) -> str:
    """Sentences on the axes of a boom in a frame and on effects of second order; empty if the scene has no frame."""
    motion = result.summary.get("frame")
    if motion is None:
        return ""
    return prose("frame", motion=motion, buckling=result.summary.get("buckling", {"factor": None}))


def energy_sentence(result: RunResult) -> str:
    """Sentence on the energy that drives, loads and damping add to a boom in space; empty if the scene has no frame."""
    energies = result.summary.get("energy")
    return "" if energies is None else prose("energy", energies=energies)


class LargestValue(NamedTuple):
    """Row of the table of largest values.

    The first line of `text` is the value, beside its limit if it has one.  A second line, in small type, begins with
    place and time and says what holds for the value.  `share` is the share of the allowed value, None if there is none.

    `place` is the part of the boom that the value belongs to, as `pmr.results.quantities.Quantity` names it.  An empty
    place puts the row after the rows of the whole boom.  `key` is the key of the quantity, empty if there is none.
    """

    name: str
    text: str
    share: float | None = None
    place: str = ""
    share_with_errors: float | None = None  # share together with the known errors, None if there are none
    key: str = ""
    share_with_play: float | None = None  # share in the run with another play of pads, None if it is not known

    @property
    def largest_share(self) -> float:
        """Larger one of the shares with the run's own play of pads and with another; 0 for a row without a limit."""
        return max(self.share or 0.0, self.share_with_play or 0.0)


LargestValues = Iterator[LargestValue]


def largest_value(key: str, text: str, share: float | None = None, name: str = "", end: str = "") -> LargestValue:
    """Return the row of the quantity with this `key`, which states the part that the row belongs to.

    The row is called `name` or, if that is empty, as the quantity is reported.  Its text is `text`, followed by `end`.
    `share` is the share of the allowed value, None if there is none.
    """
    quantity = QUANTITIES[key]
    return LargestValue(name or quantity.reported, text + end, share, quantity.place, key=key)


class Measured(NamedTuple):
    """Extremes of what a run measured, with its name on pages and its unit without prefix."""

    name: str
    unit: str
    extremes: Extremes

    @classmethod
    def from_summary(cls, name: str, key: str, summary: Summary) -> Measured:
        """Return the extremes in `summary`, an entry of a run's summary, with their `name` on pages.

        Their unit is that of the quantity `key`.
        """
        return cls(name, QUANTITIES[key].unit, Extremes.from_summary(summary))


def extremes_of(result: RunResult, values: Array) -> Extremes:
    """Return the extremes of `values` (T,), a history of the reduced model, with their times and places.

    A place is the reach of a boom, or the path coordinate of a body alone, in m.
    """
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

    Values of one unit have one prefix.  A value is printed as 0 if its magnitude is at most `floor`.  It is also
    printed as 0 if it is at most `NOTHING` times the largest value with its unit: in this table, and among all forces
    and moments of the run.

    `where` are words for the places, by default `then_words`; `remark` is a sentence after the caption.  A value
    without a name is called slider.
    """
    placed, rows, small = where is not None or bool(moving_part(result)), [], False
    largest = largest_by_unit(result) if measured else {}
    for name, base, extremes in measured:
        most = max(of.extremes.size for of in measured if of.unit == base)
        nothing = NOTHING * max(most, largest.get(base, 0.0))
        cells = _extreme_cells(extremes, unit_for(most, base), max(nothing, floor), placed)
        small |= any(floor < abs(of.value) <= nothing for of in (extremes.lowest, extremes.highest))
        rows.append((name or "slider", *cells))
    places = then_words(result) if where is None else where
    share = format_percent(NOTHING, 1)
    if small:
        remark += f" A value is 0 here if it is below {share} of the largest one with its unit, in this table and among"
        remark += " the forces and moments of the run."
    return Grid(f"{caption}, with their times{places}.{remark}", ("", "least", "largest"), tuple(rows))


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
    """Clause that names the position that is stated beside an extreme; empty if nothing slides.

    For a body alone it is the position of mouth or slider, for a boom its length.  Where a mass on a wheel crosses
    another section, it is the place of this mass.
    """
    part = moving_part(result)
    if not part:
        return ""
    if mover := crossing(result):
        return f", and the place of {mover} then"
    return f", and {'the boom length' if part == 'boom' else f'the position of the {part} along the body'} then"


def peak_place_clause(result: RunResult, peak: PeakSummary) -> str:
    """Clause with the point and the time of a largest stress, and with the boom's angles at that time."""
    where = [peak_part_name(peak), f"{two_decimals(peak['position'][0])}{SPACE}m from the tail"]
    return f"{', '.join(filter(None, where))}, at {format_time(peak['t'])}{angles_clause(result, peak['t'])}"


def wall_place_clause(result: RunResult, walls: Summary) -> str:
    """Clause with place and time of the largest stress in walls (`pmr.results.quantities.wall_stress`)."""
    peak = PeakSummary(t=walls["t"], position=walls["position"], section=walls["section"])
    peak["region"] = f"{walls['region']} wall" if walls["region"] else "walls"
    return peak_place_clause(result, peak)


def extreme_clause(result: RunResult, extreme: Extreme) -> str:
    """Clause with the time of an extreme value, and with the reach (or path coordinate) and the angles at that time."""
    where = ", ".join(filter(None, (f"at {format_time(extreme.t)}", position_text(result, extreme.s))))
    return f"{where}{angles_clause(result, extreme.t)}"


def angles_clause(result: RunResult, t: float) -> str:
    """Clause at the end of a sentence: luffing and slewing angle in degrees of a boom in a frame at `t` in s.

    The clause begins with a comma (", raised 30°, slewed 10°").  An angle that the frame does not set is left out;
    without a frame the clause is empty.
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
        return f"{two_decimals(reach_of(result) - position)}{SPACE}m beyond the mouth"
    return f"s = {two_decimals(position)}{SPACE}m" if moving_part(result) else ""


def two_decimals(value: float) -> str:
    """Format the number `value`, rounded to two decimals."""
    return format_input(round(value, 2))


def value_at(result: RunResult, extreme: Extreme, unit: str, *words: str) -> str:
    """Text of an extreme value in `unit` (without prefix) and some `words`; a second line has its time and place."""
    return f"{', '.join((format_quantity(extreme.value, unit), *words))}\n{extreme_clause(result, extreme)}"
