"""Computational speed."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pmr.report.blocks import Block, Chapter, Grid, KeyNumber, drawing
from pmr.report.figures.canvas import INK, MUTED, WIDE, key, sheet
from pmr.report.numbers import SPACE, percent, plain, quantity, significant
from pmr.report.studies.curves import log_x
from pmr.report.studies.finished import FinishedStudy
from pmr.report.studies.names import case_name
from pmr.studies.engine.task import number
from pmr.studies.results import RunRecord

LABELS = {
    "ancf": "ANCF cable",
    "full-callbacks-modified": "full, callbacks, Jacobian reused",
    "full-callbacks": "full, callbacks",
    "full-updates": "full, updates",
    "full-march": "full, compiled",
    "reduced-callbacks-modified": "reduced, callbacks, Jacobian reused",
    "reduced-callbacks": "reduced, callbacks",
    "reduced-updates": "reduced, updates",
    "reduced-march": "reduced, compiled",
}
#: The paper's approaches, in the two ways in which they may be solved.
PUBLISHED = (
    "ancf", "full-callbacks", "full-callbacks-modified", "reduced-callbacks", "reduced-callbacks-modified",
)  # fmt: skip
PAPER, OURS = "#d55e00", "#0072b2"
#: Of booms, before the number of elastic modes of each section.
OF_SECTIONS = {"reduced-march": "compiled", "reduced-exudyn": "Exudyn"}
RATIOS = {
    "callbacks_over_march.reduced": "compiled against callbacks, reduced",
    "modified_over_march.reduced": "compiled against callbacks with a Jacobian that is reused, reduced",
    "full_over_reduced": "reduced against full, compiled",
}


_OF_BEAMS = (
    "Callbacks are the paper's way: dense matrices, and Python called for rows, their Jacobian and loads in every "
    "iteration. Rows and loads are looked up there, not evaluated, which favours it. Whether the paper takes a new "
    "Jacobian in each iteration or reuses it as long as Newton's method converges (modified Newton) it does not say; "
    "both are timed. Updates set rows and loads once a step. The compiled simulator takes the modes of the beam's "
    "matrices as coordinates, once, and steps from there."
)


def label(approach: str) -> str:
    """An approach in words; of a boom's models with the number of modes."""
    of_sections, _, modes = approach.rpartition("-")
    if of_sections in OF_SECTIONS:
        return f"reduced, {modes} modes, {OF_SECTIONS[of_sections]}"
    return LABELS[approach]


def _fewest(study: FinishedStudy, scene: str, ratio: str) -> Any:
    """A ratio with the fewest modes of a boom's sections; None of a beam."""
    of_sizes = {
        int(name.rpartition(".")[2]): value
        for name, value in study.figures.items()
        if name.startswith(f"{scene}.{ratio}.") and name.rpartition(".")[2].isdigit()
    }
    return of_sizes[min(of_sizes)] if of_sizes else None


def content(study: FinishedStudy, prefix: str) -> Chapter:
    """Times of every approach, and their ratios."""
    span = study.figure("span")  # simulated time, s
    done = [run for run in study.results.runs if run.status == "done"]
    shares = {str(run.parameters["approach"]): number(run.figures["share"]) for run in done}
    parts = [f"{label(name)}: {percent(share)}" for name, share in shares.items() if share < 1.0]
    extrapolated = f" Extrapolated from stretches spread over the time span: {', '.join(parts)} of it." if parts else ""
    caption = (
        f"Solver time for {plain(span)}{SPACE}s of motion, {study.asked['repeats']} repeats and their median. Orange: "
        "the paper's three approaches in Exudyn; blue: other ways to the same trajectories. Dashed: real "
        f"time.{extrapolated}"
    )
    scenes = study.scenes
    reduced = [value for name, value in study.figures.items() if ".seconds.reduced-march" in name]
    fastest = max(map(number, reduced))
    beams = [name for name in scenes if f"{name}.seconds.ancf" in study.figures]
    return Chapter(
        anchor=prefix,
        title=study.title,
        headline=f"The compiled simulator needs {quantity(fastest, 's', 2)} for {plain(span)}{SPACE}s of the "
        "reduced model.",
        key_numbers=[
            KeyNumber(f"{significant(number(value), 2)}{SPACE}×", f"{RATIOS[ratio]}, {case_name(name)}")
            for name in scenes
            for ratio in RATIOS
            for value in [study.figures.get(f"{name}.{ratio}", _fewest(study, name, ratio))]
            if value is not None
        ],
        paragraphs=[
            *[_OF_BEAMS] * bool(beams),
            *["Of booms the number behind an approach is that of elastic modes of each section."] * (beams != scenes),
            "Nothing else runs beside a measurement; loading and compiling are not measured.",
        ],
        blocks=[
            Block(
                "Solver time",
                ((drawing(f"{prefix}-seconds", seconds, caption, study),),),
                grids=tuple(_grid(study, name) for name in scenes),
            )
        ],
    )


def seconds(study: FinishedStudy) -> Figure:
    """Repeats and medians on a logarithmic axis, one panel a scene."""
    scenes = study.scenes
    margins, names = {"left": 1.75, "top": 0.45}, _approaches(study)
    figure, axes = sheet(WIDE, 3.1, columns=len(scenes), margins=margins, sharey=True, gridspec_kw={"wspace": 0.08})
    everything = [value for run in study.results.runs for value in repeats(run)]
    places = {name: len(names) - 1 - i for i, name in enumerate(names)}
    for ax, scene in zip(axes[0], scenes, strict=True):
        for run in _timed(study, scene):
            name = str(run.parameters["approach"])
            found, colour = repeats(run), PAPER if name in PUBLISHED else OURS
            middle = float(np.median(found))
            ax.plot(
                found,
                [places[name]] * len(found),
                linestyle="none",
                marker="o",
                markersize=2.6,
                color=colour,
                alpha=0.6,
            )
            ax.plot([middle] * 2, [places[name] - 0.28, places[name] + 0.28], color=colour, linewidth=1.6)
        ax.axvline(study.figure("span"), color=INK, linewidth=0.8, linestyle=(0, (4, 2)))
        log_x(ax, min(everything) / 2.0, 2.0 * max([*everything, study.figure("span")]))
        ax.set_yticks(list(places.values()), [label(name) for name in places])
        ax.set_ylim(-0.6, len(names) - 0.4)
        ax.set_xlabel("Solver time in s")
        ax.set_title(case_name(scene), loc="left", pad=4.0)
    dot: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 3.0}
    key(
        figure,
        [
            Line2D([], [], label="the paper's way", color=PAPER, **dot),
            Line2D([], [], label="other ways, same trajectory", color=OURS, **dot),
            Line2D([], [], label="median", color=MUTED, linewidth=1.6),
            Line2D([], [], label="real time", color=INK, linewidth=0.8, linestyle=(0, (4, 2))),
        ],
    )
    return figure


def _timed(study: FinishedStudy, scene: str) -> list[RunRecord]:
    return [run for run in study.runs(scene=scene) if run.status == "done"]


def _approaches(study: FinishedStudy) -> list[str]:
    """All that were timed, those of beams first."""
    found = dict.fromkeys(str(run.parameters["approach"]) for run in study.results.runs)
    return [*(name for name in LABELS if name in found), *(name for name in found if name not in LABELS)]


def repeats(run: RunRecord) -> list[float]:
    """Measured times in s."""
    return [value for name, value in run.seconds.items() if name.startswith("repeat")]


def _grid(study: FinishedStudy, scene: str) -> Grid:
    runs, rows = _timed(study, scene), []
    median = {
        name: study.figure(f"{scene}.seconds.{name}") for name in (str(run.parameters["approach"]) for run in runs)
    }
    least = {str(run.parameters["approach"]): min(repeats(run)) for run in runs}
    for run in runs:
        name = str(run.parameters["approach"])
        ratio = significant(study.figure("span") / median[name], 2)
        size = plain(number(run.figures["coordinates"]))
        rows.append((label(name), size, quantity(median[name], "s"), quantity(least[name], "s"), f"{ratio}{SPACE}×"))
    caption = f"{case_name(scene).capitalize()}: solver time for the whole time span."
    return Grid(caption, ("approach", "coordinates", "median", "least", "against real time"), tuple(rows))
