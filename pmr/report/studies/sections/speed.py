"""Computational speed."""

from __future__ import annotations

from collections.abc import Mapping
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


def content(study: FinishedStudy, prefix: str) -> Chapter:
    """Times of every approach, and their ratios."""
    span = study.figure("span")  # simulated time, s
    shares = {str(run.parameters["approach"]): number(run.figures["share"]) for run in study.results.runs}
    parts = [f"{LABELS[name]}: {percent(share)}" for name, share in shares.items() if share < 1.0]
    extrapolated = f" Extrapolated from stretches spread over the time span: {', '.join(parts)} of it." if parts else ""
    caption = (
        f"Solver time for {plain(span)}{SPACE}s of motion, {study.asked['repeats']} repeats and their median. Orange: "
        "the paper's three approaches in Exudyn; blue: other ways to the same trajectories. Dashed: real "
        f"time.{extrapolated}"
    )
    scenes = study.scenes
    fastest = max(study.figure(f"{name}.seconds.reduced-march") for name in scenes)
    return Chapter(
        anchor=prefix,
        title=study.title,
        headline=f"The compiled simulator needs {quantity(fastest, 's', 2)} for {plain(span)}{SPACE}s of the reduced "
        "beam.",
        key_numbers=[
            KeyNumber(
                f"{significant(study.figure(f'{name}.{ratio}.reduced'), 2)}{SPACE}×",
                f"compiled against callbacks{how}, reduced, {case_name(name)}",
            )
            for name in scenes
            for ratio, how in (("callbacks_over_march", ""), ("modified_over_march", " with a Jacobian that is reused"))
        ],
        paragraphs=[
            "Callbacks are the paper's way: dense matrices, and Python called for rows, their Jacobian and loads in "
            "every iteration. Rows and loads are looked up there, not evaluated, which favours it. Whether the paper "
            "takes a new Jacobian in each iteration or reuses it as long as Newton's method converges (modified "
            "Newton) it does not say; both are timed. Updates set rows and loads once a step. The compiled simulator "
            "takes the modes of the beam's matrices as coordinates, once, and steps from there. Nothing else runs "
            "beside a measurement; loading and compiling are not measured.",
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
    margins = {"left": 1.75, "top": 0.45}
    figure, axes = sheet(WIDE, 3.1, columns=len(scenes), margins=margins, sharey=True, gridspec_kw={"wspace": 0.08})
    everything = [value for run in study.results.runs for value in repeats(run)]
    places = {name: len(LABELS) - 1 - i for i, name in enumerate(LABELS)}
    for ax, scene in zip(axes[0], scenes, strict=True):
        for run in study.runs(scene=scene):
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
        ax.set_yticks(list(places.values()), [LABELS[name] for name in places])
        ax.set_ylim(-0.6, len(LABELS) - 0.4)
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


def repeats(run: RunRecord) -> list[float]:
    """Measured times in s."""
    return [value for name, value in run.seconds.items() if name.startswith("repeat")]


def _grid(study: FinishedStudy, scene: str) -> Grid:
    median: Mapping[str, float] = {name: study.figure(f"{scene}.seconds.{name}") for name in LABELS}
    least, rows = {str(run.parameters["approach"]): min(repeats(run)) for run in study.runs(scene=scene)}, []
    for run in study.runs(scene=scene):
        name = str(run.parameters["approach"])
        ratio = significant(study.figure("span") / median[name], 2)
        size = plain(number(run.figures["coordinates"]))
        rows.append((LABELS[name], size, quantity(median[name], "s"), quantity(least[name], "s"), f"{ratio}{SPACE}×"))
    caption = f"{case_name(scene).capitalize()}: solver time for the whole time span."
    return Grid(caption, ("approach", "coordinates", "median", "least", "against real time"), tuple(rows))
