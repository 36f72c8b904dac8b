"""Sentences, numbers and the terminal's table of a load chart: what it carries, and for which case that holds."""

from __future__ import annotations

import numpy as np

from pmr.files.arrays import Array, Summary
from pmr.report.blocks import Grid
from pmr.report.figures.load_chart import NOT_PERMITTED
from pmr.report.numbers import SPACE, format_input
from pmr.report.studies.finished import FinishedStudy
from pmr.studies.duty import LoadCase
from pmr.studies.limits import STABILITY_WORDS
from pmr.studies.study import StudyResults

#: Sentence of a chart without limits of pads or of the stress field.
NO_WALLS = (
    " These loads are not those that are allowed: walls and pads are not looked at, and walls may yield at pads under "
    "smaller loads. A run states the stress of walls at pads."
)
#: Sign in tables where the boom is not permitted even empty.
NO_LOAD = "—"
#: Largest step in kg to which loads are rounded down in tables; smaller ones keep three digits of the largest load.
STEP = 10.0


def load_step(largest: float) -> float:
    """Return the step in kg to which loads are rounded down in a table whose largest load is `largest` in kg."""
    return STEP if largest <= 0.0 else min(float(10.0 ** (np.floor(np.log10(largest)) - 2.0)), STEP)


def round_down(load: float, step: float) -> float:
    """Round a load in kg down to a multiple of `step` in kg."""
    return float(np.floor(load / step + 1e-9) * step)


def format_load(load: float | np.floating) -> str:
    """Format a load in kg with four significant digits, rounded down, never with a power of ten."""
    digit = 10.0 ** (np.floor(np.log10(load)) - 3.0) if load > 0.0 else 1.0
    return f"{format_input(float(f'{round_down(float(load), float(digit)):.4g}'))}{SPACE}kg"


def ceiling(study: FinishedStudy) -> str:
    """Words for a load that no limit allows at most: the search ends before one is reached."""
    return f"more than {format_load(study.study_file['up_to'])} (search ends there)"


def case_sentence(asked: Summary) -> str:
    """Sentence on the cases in service of a study file: factors of load and weights, wind, other loads and stops."""
    cases = [case for case in map(LoadCase.model_validate, asked["cases"]) if case.in_service]
    plain = all(case.weight == case.machine == case.load == 1.0 and case.hoisting_class is None for case in cases)
    calm = not any(case.wind or any(case.loads.values()) for case in cases)
    if plain and calm:
        swings = "motion: stops on pages of limits alone" if asked.get("stops") else "no motion"
        return f"Static, factors of load and weight 1.0, no wind, {swings}: not a rated capacity."
    texts = []
    for case in cases:
        factor = case.load * case.hoisting_factor(asked["classes"])
        acting = [
            f"{name} {force:.4g}{SPACE}N" for name, force in case.acting_amounts(asked["classes"])["loads"].items()
        ]
        loads = ", ".join(acting) or "no wind"
        factors = f"factor of load {factor:.4g}, of the boom's weight {case.weight:.4g}"
        factors += "" if case.machine == 1.0 else f", of the machine's {case.machine:.4g}"
        texts.append(f"{case.name} ({factors}, {loads})")
    return f"Static, for {'; '.join(texts)}."


def slewing_clause(angles: Array) -> str:
    """Clause on the slewing `angles` in degrees of a chart, of which the smallest load counts."""
    several = "the least over" if len(angles) > 1 else "at"
    return f"{several} slewing by {', '.join(f'{angle:.4g}°' for angle in angles)}"


def headline(study: FinishedStudy, least_loads: Array, slewing: Array) -> str:
    """Sentences on the case and on the range of `least_loads` (E, A) in kg, which are NaN where no limit is reached.

    `slewing` are the slewing angles in degrees.
    """
    case = case_sentence(study.study_file)
    if not np.isfinite(least_loads).any():
        hint = (
            ""
            if study.study_file["limits"]
            else f" Only {STABILITY_WORDS} was evaluated: [[limits]] of the study adds others."
        )
        most = format_input(study.study_file["up_to"], "kg")
        return f"No limit is reached up to {most} at any of {least_loads.size} points.{hint} {case}"
    limits = [f"{limit['name']} (factor {limit['factor']:g})" for limit in study.study_file["limits"]]
    walls = "" if {"pad", "field"} & {str(limit["of"]) for limit in study.study_file["limits"]} else NO_WALLS
    by = f"by these limits alone: {', '.join([*limits, STABILITY_WORDS])}; {slewing_clause(slewing)}.{walls}"
    empty, permitted = int((least_loads <= 0.0).sum()), least_loads[least_loads > 0.0]
    never = f"At {empty} of {least_loads.size} points the boom is {NOT_PERMITTED}. " if empty else ""
    if not len(permitted):
        return f"{case} {never}This is so {by}" if not np.isnan(least_loads).any() else f"{case} {never}"
    high = ceiling(study) if np.isnan(least_loads).any() else format_load(permitted.max())
    carries = f"{'Elsewhere it' if empty else 'It'} carries {format_load(permitted.min())} to {high}"
    return f"{case} {never}{carries}, depending on extension and angle, {by}"


def terminal_grid(results: StudyResults, rows: int) -> Grid:
    """Build the terminal's table of a chart: for each of at most `rows` extensions the radii and the allowed loads."""
    done = [run for run in results.runs if run.status == "done"]
    names = list(dict.fromkeys(name for run in done for name in run.parameters))
    lines, empty = [], False
    for run in done[:rows]:
        arrays = results.arrays(run.key)
        place, load = arrays["place"], np.nan_to_num(arrays["load"], nan=np.inf).min(axis=1)
        empty = empty or bool((load == 0.0).any())
        cells = [_load_cell(float(load[at])) for at in (load.argmin(), load.argmax())]
        lines.append(
            (
                *(f"{float(run.parameters[name] or 0.0):.3g}" for name in names),
                f"{np.linalg.norm(place[0]):.3g}",
                f"{place[:, 0].min():.3g}–{place[:, 0].max():.3g}",
                *cells,
            )
        )
    more = f"{len(done) - rows} more extensions, and all" if len(done) > rows else "All"
    sign = f"{NO_LOAD} is {NOT_PERMITTED}. " if empty else ""
    caption = f"{sign}{more} points are in chart.csv, loads over radius in duty.csv, pages to print in report.pdf."
    heads = (*(f"{name.removeprefix('extension.')} out [m]" for name in names), "boom length [m]", "radius [m]")
    return Grid(caption, (*heads, "least load [kg]", "most load [kg]"), tuple(lines))


def _load_cell(load: float) -> str:
    """Format a load in kg for the terminal; `NO_LOAD` for 0, and words where no limit is reached."""
    if np.isinf(load):
        return "no limit reached"
    return NO_LOAD if load == 0.0 else f"{load:.0f}"
