"""Selected combinations of snapshots and modes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pmr.report.blocks import Block, Chapter, Grid, KeyNumber, drawing
from pmr.report.figures.canvas import SHADE, WIDE, key, log_axis, sheet
from pmr.report.numbers import percent, plain
from pmr.report.studies.curves import dots
from pmr.report.studies.finished import FinishedStudy
from pmr.report.studies.names import listed
from pmr.report.studies.statements import EXPLAINED, NAMES, combination, treatments
from pmr.studies.engine.task import number
from pmr.studies.results import RunRecord

COLUMNS = ("round_off", "dropped")
ROWS = {"beam": "e_NRMS of the beam (–)", "strain": "Strain energy error in J"}
STATED = 20


def content(study: FinishedStudy, prefix: str) -> Chapter:
    """Errors over the number of coordinates, and singular values."""
    names, ways = combinations(study), treatments(study, "first")
    sides = (
        "on the left with the pin's rows as the singular value decomposition leaves them, on the right without. "
        if len(ways) > 1
        else "of each section. "
    )
    errors_caption = (
        "Normalised RMS error of the transverse displacement along the beam (top) and absolute error of the strain "
        f"energy summed over all steps (bottom), over the number of coordinates; {sides}Curves end where the snapshots "
        f"span no more dimensions. Shaded: {STATED - 4} to {STATED} coordinates, the budget of the next study."
    )
    sigma_caption = "Singular values of the snapshots of each combination, over the first of them."
    at_budget = {name: _at(study, name, STATED) for name in names}
    grid = Grid(
        caption=f"Error along the beam with {STATED} coordinates (or all that there are).",
        head=("combination", *ways.values()),
        rows=tuple(
            (combination(name), *(_percent(run, treatment) for treatment in ways)) for name, run in at_budget.items()
        ),
    )
    first = Grid(
        caption="Number of coordinates from which on the error is below its maximum.",
        head=("combination", *ways.values()),
        rows=tuple((combination(name), *(_first(study, name, treatment) for treatment in ways)) for name in names),
    )
    shown = next(iter(ways))
    return Chapter(
        anchor=prefix,
        title=study.title,
        headline=_headline(at_budget, ways),
        key_numbers=[
            KeyNumber(
                percent(study.figure(f"{name}.{shown}.beam")),
                f"{combination(name)}, all{', rows left in' if len(ways) > 1 else ''}",
            )
            for name in names
        ],
        paragraphs=[EXPLAINED] if len(ways) > 1 else [],
        blocks=[
            Block(
                "Errors over the number of coordinates",
                ((drawing(f"{prefix}-errors", errors, errors_caption, study),),),
                grids=(grid, first),
            ),
            Block("Singular values", ((drawing(f"{prefix}-sigma", singular_values, sigma_caption, study),),)),
        ],
    )


def _headline(at_budget: Mapping[str, RunRecord], ways: Mapping[str, str]) -> str:
    said = {t: listed([f"{combination(name)} {_percent(run, t)}" for name, run in at_budget.items()]) for t in ways}
    if len(ways) == 1:
        return f"With {STATED} coordinates of each section: {said['dropped']}."
    both = f"{said['round_off']} with the pin's rows left in, {said['dropped']} with them dropped"
    return f"With {STATED} coordinates: {both}."


def _first(study: FinishedStudy, name: str, treatment: str) -> str:
    """The number of coordinates with which the error leaves its maximum."""
    found = study.figures[f"{name}.{treatment}.first"]
    return "–" if found is None else plain(number(found))


def combinations(study: FinishedStudy) -> list[str]:
    """Names of the combinations, such as 5x6."""
    return [f"{n}x{m}" for n, m in study.asked["combinations"]]


def errors(study: FinishedStudy) -> Figure:
    """Both errors, a row each; treatments side by side."""
    gaps, ways = {"wspace": 0.05, "hspace": 0.12}, treatments(study, "first")
    columns = [name for name in COLUMNS if name in ways]
    figure, axes = sheet(
        WIDE, 4.4, rows=2, columns=len(columns), margins={"top": 0.5}, sharex=True, sharey="row", gridspec_kw=gaps
    )
    names = combinations(study)
    for row, (measure, label) in enumerate(ROWS.items()):
        every = []
        for column, treatment in enumerate(columns):
            ax = axes[row, column]
            ax.axvspan(STATED - 4.5, STATED + 0.5, color=SHADE, linewidth=0.0, zorder=0.0)
            for i, name in enumerate(names):
                shown = [
                    (number(run.parameters["coordinates"]), run.figures[f"{treatment}.{measure}"])
                    for run in _runs(study, name)
                ]
                shown = [(r, number(error)) for r, error in shown if error]
                ax.plot(*np.array(shown).T, **dots(i, 1.8))
                every += [number(error) for _, error in shown]
            if row == 0 and len(columns) > 1:
                ax.set_title(f"pin's {NAMES[treatment]}", loc="left", pad=4.0)
            elif row == 1:
                ax.set_xlabel("Number of coordinates (–)")
        log_axis(axes[row, 0], min(every), max(every))
        axes[row, 0].set_ylabel(label)
    axes[0, 0].set_xlim(0.0, max(number(run.parameters.get("coordinates") or 0) for run in study.results.runs) + 1.0)
    key(figure, [Line2D([], [], label=combination(name), **dots(i)) for i, name in enumerate(names)])
    return figure


def singular_values(study: FinishedStudy) -> Figure:
    """Singular values over the first one, of all combinations."""
    figure, axes = sheet(WIDE, 2.4)
    ax = axes[0, 0]
    names, least = combinations(study), 1.0
    for i, name in enumerate(names):
        sigma = study.results.arrays(name)["singular_values"]
        relative = sigma / sigma[0]
        shown = relative > 0.0
        ax.plot(np.arange(1, len(sigma) + 1)[shown], relative[shown], **dots(i, 2.0))
        least = min(least, float(relative[shown].min()))
    log_axis(ax, least, 1.0)
    ax.set_xlim(0.0, None)
    ax.set_xlabel("Number k (–)")
    ax.set_ylabel("Singular value σ(k) / σ(1) (–)")
    key(figure, [Line2D([], [], label=combination(name), **dots(i)) for i, name in enumerate(names)])
    return figure


def _runs(study: FinishedStudy, name: str) -> list[RunRecord]:
    snapshots, modes = map(int, name.split("x"))
    return [run for run in study.runs(snapshots=snapshots, modes=modes) if run.parameters.get("coordinates")]


def _at(study: FinishedStudy, name: str, coordinates: int) -> RunRecord:
    return [run for run in _runs(study, name) if number(run.parameters["coordinates"]) <= coordinates][-1]


def _percent(run: RunRecord, treatment: str) -> str:
    error = run.figures[f"{treatment}.beam"]
    return "–" if error is None else percent(number(error))
