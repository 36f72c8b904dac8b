"""Chapter about accuracy against time: least errors over simulation time, and the sizes that meet a tolerance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pmr.report.blocks import Block, Chapter, Grid, KeyNumber
from pmr.report.figures.canvas import WIDE, curve_style, drawing, log_axis, log_x, make_sheet
from pmr.report.numbers import format_input, format_percent, format_quantity
from pmr.report.studies.finished import FinishedStudy
from pmr.studies.kinds.trade import TOLERANCES, trade_points
from pmr.studies.results import RunRecord
from pmr.studies.tasks import cell_number

NAMES = {
    "pod": "POD, slider at nodes",
    "visited": "POD, places visited",
    "modes": "free modes",
    "flexibility": "residual flexibility",
    "trajectory": "POD of the full motion",
}
COLUMNS = 2


def build_chapter(study: FinishedStudy, prefix: str) -> Chapter:
    """Build the chapter about errors and times of reduction methods; `prefix` is put before every identifier."""
    fronts_caption = (
        "Error along the body against the full model with a far shorter step, over the time of one simulation: of each "
        "method the models and steps that none of its others beats in both."
    )
    energy = "Error along the body, and the largest error of the energy while the slider moves, by coordinates."
    return Chapter(
        anchor=prefix,
        title=study.title,
        headline="How much time an error costs, by method, number of coordinates and step.",
        key_numbers=[KeyNumber(format_input(len(study.scenes)), "scenes")],
        paragraphs=[
            "Coordinates and steps each have their part of the error. What holds a tolerance here holds it with all "
            "shorter steps too, so that no two parts cancel by chance.",
            "Times are those of the compiled loops, that of a step times the number of steps; offline times are "
            "those of the processor, without the assembly.",
        ],
        blocks=[
            Block(
                "Error over time",
                ((drawing(f"{prefix}-fronts", front_figure, fronts_caption, study),),),
                grids=(_offline_grid(study),),
            ),
            Block("What holds a tolerance", grids=tuple(_tolerance_grid(study, scene) for scene in study.scenes)),
            Block(energy, grids=tuple(_energy_grid(study, scene) for scene in study.scenes[:2])),
        ],
    )


def front_figure(study: FinishedStudy) -> Figure:
    """Draw the front of error over time for each method, in a panel for each scene."""
    scenes = study.scenes
    rows, gaps = -(-len(scenes) // COLUMNS), {"wspace": 0.05, "hspace": 0.3}
    grid = {"sharex": True, "sharey": True, "gridspec_kw": gaps}
    figure, axes = make_sheet(WIDE, 0.9 + 1.6 * rows, rows, COLUMNS, {"top": 0.7}, **grid)
    every = [point for ax, scene in zip(axes.flat, scenes, strict=False) for point in _draw_panel(ax, study, scene)]
    for ax in axes.flat[len(scenes) :]:
        ax.set_visible(False)
    seconds, errors = np.array(every).T
    log_axis(axes[0, 0], float(errors.min()), 1.0)
    log_x(axes[0, 0], 0.8 * float(seconds.min()), 1.25 * float(seconds.max()))
    for ax in axes[:, 0]:
        ax.set_ylabel("e_NRMS (–)")
    for ax in axes[-1]:
        ax.set_xlabel("Time of one simulation in ms")
    handles = [Line2D([], [], label=label, **curve_style(i, 2.2)) for i, label in enumerate(NAMES.values())]
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.07, 1.0), ncols=4, borderaxespad=0.25)
    return figure


def error_front(times_and_errors: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Points (seconds, error) for which no other point has less time and less error, in increasing order of time."""
    best: list[tuple[float, float]] = []
    for seconds, error in sorted(times_and_errors):
        if not best or error < best[-1][1]:
            best.append((seconds, error))
    return best


def _draw_panel(ax: Axes, study: FinishedStudy, scene: str) -> list[tuple[float, float]]:
    """Draw the front of each method for a scene, and return the points (ms, error) of all fronts."""
    every = []
    for i, method in enumerate(NAMES):
        for run in study.runs(scene=scene, method=method):
            if shown := error_front(_times_and_errors(run)):
                ax.plot(*np.array(shown).T, **curve_style(i, 2.2))
                every += shown
    ax.set_title(scene.replace("_", " "), loc="left", pad=3.0)
    return every


def _times_and_errors(run: RunRecord) -> list[tuple[float, float]]:
    """Simulation time in ms and error of each model and time step of a method.

    All steps are taken to need equal time, whatever their length.
    """
    steps = run.figures.get("steps")
    return [
        (1e3 * run.seconds[f"step.{r}"] * cell_number(steps) / h, error)
        for r, h, error in trade_points(run.figures)
        if f"step.{r}" in run.seconds and steps is not None and 0.0 < error < 1.0
    ]


def _tolerance_grid(study: FinishedStudy, scene: str) -> Grid:
    """Build the table of the number of coordinates and the step by which each method meets a tolerance in a scene."""
    rows = []
    for method, name in NAMES.items():
        cells = [study.figures.get(f"{scene}.{method}.{tolerance:g}") for tolerance in TOLERANCES]
        if study.runs(scene=scene, method=method):
            rows.append((name, *("–" if cell is None else str(cell).replace(" x ", " × ") for cell in cells)))
    caption = f"{scene.replace('_', ' ')}: coordinates × step (as a multiple of the scene's) that hold a tolerance."
    return Grid(caption, ("method", *(format_percent(tolerance) for tolerance in TOLERANCES)), tuple(rows))


def _offline_grid(study: FinishedStudy) -> Grid:
    """Build the table of the offline time that the largest model of each method takes, by scene."""
    methods = [method for method in NAMES if study.runs(method=method)]
    rows = []
    for scene in study.scenes:
        runs_by_method = [study.runs(scene=scene, method=method) for method in methods]
        rows.append((scene.replace("_", " "), *(_format_seconds(runs) for runs in runs_by_method)))
    return Grid("Offline time of the largest model.", ("scene", *(NAMES[method] for method in methods)), tuple(rows))


def _format_seconds(runs: Sequence[RunRecord]) -> str:
    """Format the offline processor time of the first run; a dash if this run has no models."""
    if not runs or not any(name.startswith("step.") for name in runs[0].seconds):
        return "–"
    return format_quantity(runs[0].seconds["offline"], "s")


def _energy_grid(study: FinishedStudy, scene: str) -> Grid:
    """Build the table of the errors along the body and of the energy, by method and number of coordinates."""
    sizes = [int(r) for r in study.study_file["coordinates"]]
    rows = []
    for method, name in NAMES.items():
        for run in study.runs(scene=scene, method=method):
            pairs = [(run.figures.get(f"reduction.{r}"), run.figures.get(f"energy.{r}")) for r in sizes]
            cells = (
                "–"
                if a is None or b is None
                else f"{format_percent(cell_number(a), 2)}, {format_percent(cell_number(b), 2)}"
                for a, b in pairs
            )
            rows.append((name, *cells))
    return Grid(f"{scene.replace('_', ' ')}.", ("method", *(f"{r}" for r in sizes)), tuple(rows))
