"""Key numbers and sentences of a run's chapter."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from pmr.report import trust
from pmr.report.blocks import (
    KeyNumber,
)
from pmr.report.numbers import (
    MINUS,
    SPACE,
    format_input,
    format_percent,
    format_quantity,
    prose,
    significant,
)
from pmr.report.subject import (
    reduced_size,
    scope_words,
    wall_stress_words,
)
from pmr.results import RunResult
from pmr.results.field_stress import PeakSummary
from pmr.results.quantities import QUANTITIES, stress_name, wall_stress
from pmr.scene.model_traits import model_traits

#: Largest number of further points with the largest stress that are named; if there are more, only their number is
#: stated.
MOST_PLACES = 2


def key_numbers(result: RunResult) -> Iterator[KeyNumber]:
    """Yield the key numbers of a run: coordinates, errors, largest stress and speed.

    Numbers that are not known are left out.
    """
    summary, coordinates = result.summary, result.summary.get("coordinates", {})
    reduced, full = reduced_size(result), coordinates.get("full")
    fewer = "" if full is None else format_percent(1.0 - reduced / full, 2 if reduced > 0.005 * full else 4)
    arrow = f"{reduced}" if full is None else f"{format_input(full)}{SPACE}→{SPACE}{reduced}"
    yield KeyNumber(arrow, "coordinates", f"{fewer} fewer" if fewer else "")
    totals = trust.summed_errors(summary)
    if totals.by_label:
        yield _total_error(totals)
    else:
        yield from _error_key_numbers(result)
    yield from _model_key_number(result)
    peak = summary.get("max_von_mises", {})
    if "reduced" in peak:
        full = f"full model {format_quantity(peak['full'], 'Pa')}" if "full" in peak else ""
        stress_text, name = format_quantity(peak["reduced"], "Pa"), stress_name(result.scene)
        if (walls := wall_stress(summary)) is not None:
            note = f"{wall_stress_words(walls)}; of the beams {stress_text}"
            yield KeyNumber(format_quantity(walls["value"], "Pa"), QUANTITIES["wall_stress"].reported, note)
        else:
            yield KeyNumber(stress_text, name, full)
    if damages := summary.get("fatigue"):
        worst = damages[0]
        yield KeyNumber(significant(worst["damage"]), QUANTITIES["damage"].reported, f"of one run, {worst['name']}")
    yield from _simulation_time(result)


def _total_error(totals: trust.SummedErrors) -> KeyNumber:
    """Key number of the largest error after errors of all sources are added up."""
    label = max(totals.by_label, key=lambda name: totals.by_label[name])
    note = f"in {label}, {totals.sources_clause(label)}"
    return KeyNumber(format_percent(totals.by_label[label], 2), "largest error that is known, stress apart", note)


def _error_key_numbers(result: RunResult) -> Iterator[KeyNumber]:
    """Yield the error along the beam, or its estimate."""
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
    """Yield the ratio of the full model's simulation time to the reduced model's, if one simulator computed both.

    If different simulators did, or the full model was not simulated, yield the simulation time of the reduced model.
    The note has both times, and compares the time of the reduced model with the simulated time.
    """
    reduced, full = (
        result.responses[name].seconds if name in result.responses else 0.0 for name in ("reduced", "full")
    )
    if reduced <= 0.0:
        return
    end, names, took = result.scene.time.end, result.summary.get("simulators", {}), format_quantity(reduced, "s", 2)
    paced = f"{significant(end / reduced, 2)} times faster" if end > reduced else "slower"
    motion = f"for {format_input(end, 's')} of motion, {paced} than real time"
    motion += f"; full model {format_quantity(full, 's', 2)}" if full > 0.0 else ""
    if full > 0.0 and names.get("reduced") == names.get("full"):
        yield KeyNumber(f"{significant(full / reduced, 2)}{SPACE}×", "as fast as full", f"{took} {motion}")
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
        return f", and as large at {len(places)} other places"
    return f", and as large at {' and '.join(map(_format_point, places))}" if places else ""


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


def _model_key_number(result: RunResult) -> Iterator[KeyNumber]:
    """Yield the error of the structural model as a key number; yield nothing if this error is not known."""
    part = result.summary.get("budget", {}).get("model")
    if part is None or part["beside"] is None or part.get("beam") is None:
        return
    frequencies = format_percent(part["frequency"] or 0.0)
    more = f"{scope_words(result)}; lowest frequencies {frequencies}; beside {model_traits(part['beside']).words}"
    yield KeyNumber(format_percent(part["beam"]), "the model's own error", more)
