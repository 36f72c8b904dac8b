"""The error map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from pmr.report.blocks import Block, Chapter, Grid, KeyNumber, drawing
from pmr.report.figures.canvas import HALF, INK, MUTED, WIDE, sheet
from pmr.report.numbers import percent, plain
from pmr.report.studies.finished import FinishedStudy
from pmr.report.studies.statements import EXPLAINED, combination, treatments
from pmr.studies.engine.task import number
from pmr.studies.results import RunRecord

COLOURS = colormaps["viridis_r"]
MOST = 1.0  # the largest error possible
LABELLED = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)


def content(study: FinishedStudy, prefix: str) -> Chapter:
    """The maps, and the combinations that are marked in them."""
    figures, asked, names = study.figures, study.asked, treatments(study, "singular")
    first, *others = names
    curve = f", the curve is {plain(asked['curve'])} snapshots in all" if asked["curve"] else ""
    what = (
        f"Normalised RMS error of the transverse displacement along the beam, averaged over up to {asked['averaged']} "
        f"numbers of coordinates, {asked['budget']} at most. Black squares: the {asked['marked']} lowest errors{curve}"
    )
    left_in = "; the pin's rows left in, as published" if others else ""
    captions = {
        first: f"{what}{left_in}. White: not investigated; crosses: a model that can't be simulated.",
        "last": "The same with the pin's rows holding the last two coordinates.",
    }
    captions.setdefault("dropped", "The same with the pin's rows dropped.")
    wide = drawing(f"{prefix}-{first.replace('_', '-')}", error_map, captions[first], study, first, WIDE)
    halves = tuple(drawing(f"{prefix}-{name}", error_map, captions[name], study, name, HALF) for name in others)
    return Chapter(
        anchor=prefix,
        title=study.title,
        headline=_headline(study, names),
        key_numbers=[
            KeyNumber(
                f"{combination(str(figures[f'{name}.best']))}: {percent(study.figure(f'{name}.error'))}",
                f"best, {label}" if others else "best",
            )
            for name, label in names.items()
        ],
        paragraphs=_paragraphs(study, names),
        blocks=[
            Block("Error map", ((wide,), halves) if halves else ((wide,),)),
            Block("The best combinations", grids=(_marked(study, names),)),
        ],
    )


def _headline(study: FinishedStudy, names: Mapping[str, str]) -> str:
    best = {name: combination(str(study.figures[f"{name}.best"])) for name in names}
    error = {name: percent(study.figure(f"{name}.error")) for name in names}
    if len(names) == 1:
        return f"{best['dropped']} is best, at {error['dropped']}."
    return (
        f"{best['round_off']} is best with the pin's rows left in, at {error['round_off']}; with them dropped it is "
        f"{best['dropped']}, at {error['dropped']}."
    )


def _paragraphs(study: FinishedStudy, names: Mapping[str, str]) -> list[str]:
    asked, pools = study.asked, {name: plain(study.figure(f"{name}.pool")) for name in names}
    simulated = (
        f"{plain(study.figure('combinations'))} combinations are simulated, each with up to {asked['averaged']} "
        "numbers of coordinates"
    )
    best = f"The pools of the {asked['marked']} best combinations hold"
    if len(names) == 1:
        return [
            f"{simulated} of each section. Snapshots are modes of the whole boom, held at extensions on its way.",
            f"{best} {pools['dropped']} snapshots (median).",
        ]
    return [
        f"{simulated} and in three ways. {EXPLAINED}",
        f"{best} {pools['round_off']} snapshots with the rows left in, {pools['last']} with two coordinates held and "
        f"{pools['dropped']} with the rows dropped (median).",
        *_singular(study.figure("round_off.singular")),
    ]


def error_map(study: FinishedStudy, treatment: str, width: float) -> Figure:
    """Tiles over snapshots and modes, logarithmic colours."""
    asked = study.asked
    n, m = int(asked["most_snapshots"]), int(asked["most_modes"])
    margins = {"left": 0.6, "right": 0.62, "top": 0.1, "bottom": 0.38}
    figure, axes = sheet(width, 0.48 + (width - 1.22) * (0.62 if width > HALF else 0.75), margins=margins)
    ax = axes[0, 0]
    ax.grid(visible=False)
    known = {_tile(run): run.figures[f"{treatment}.error"] for run in study.results.runs if run.status == "done"}
    errors = {tile: number(error) for tile, error in known.items() if error is not None}
    norm = LogNorm(min(errors.values()), MOST)
    for tile, error in errors.items():
        _rectangle(ax, tile, color=COLOURS(norm(error)), linewidth=0.3)  # the line closes the seam
    for tile in known.keys() - errors.keys():
        ax.plot(*tile, marker="x", color=MUTED, markersize=2.0 if width > HALF else 1.2, markeredgewidth=0.5)
    for key in str(study.figures.get(f"{treatment}.marked", "")).split():
        _rectangle(
            ax, [int(part) for part in key.split("x")], facecolor="none", edgecolor="black", linewidth=0.9, zorder=3.0
        )
    if asked["curve"]:
        x = np.linspace(asked["curve"] / (m + 0.5), n + 0.5, 100)
        ax.plot(x, asked["curve"] / x, color=INK, linewidth=0.8, linestyle=(0, (4, 2)))
    ax.set_xlim(0.5, n + 0.5)
    ax.set_ylim(0.5, m + 0.5)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(integer=True, steps=[1, 2, 5, 10], min_n_ticks=3))
    ax.set_xlabel("Number of snapshots")
    ax.set_ylabel("Modes at each snapshot")
    _colour_key(figure, ax, norm)
    return figure


def _rectangle(ax: Axes, tile: Sequence[int], **look: Any) -> None:
    ax.add_patch(Rectangle((tile[0] - 0.5, tile[1] - 0.5), 1.0, 1.0, **look))


def _colour_key(figure: Figure, ax: Axes, norm: LogNorm) -> None:
    """A strip of colours beside the map, labelled in per cent."""
    box, inch = ax.get_position(), 1.0 / figure.get_figwidth()
    strip = figure.add_axes((box.x1 + 0.1 * inch, box.y0, 0.1 * inch, box.height))
    edges = np.linspace(0.0, 1.0, 41)
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        colour = COLOURS((low + high) / 2.0)
        strip.add_patch(Rectangle((0.0, low), 1.0, high - low, color=colour, linewidth=0.3))
    ticks = [error for error in LABELLED if 0.0 <= float(norm(error)) <= 1.0]
    strip.set_yticks([float(norm(error)) for error in ticks], [f"{100.0 * error:g} %" for error in ticks])
    strip.yaxis.tick_right()
    strip.set_xticks([])
    strip.set_ylim(0.0, 1.0)
    strip.grid(visible=False)
    for spine in strip.spines.values():
        spine.set_visible(False)


def _marked(study: FinishedStudy, names: Mapping[str, str]) -> Grid:
    """The marked combinations of each treatment, best first."""
    by_key: Mapping[str, RunRecord] = {run.key: run for run in study.results.runs}
    columns = {name: str(study.figures[f"{name}.marked"]).split() for name in names}
    most = max(map(len, columns.values()))

    def cell(name: str, place: int) -> str:
        if place >= len(columns[name]):
            return "–"
        found = columns[name][place]
        return f"{combination(found)}  {percent(number(by_key[found].figures[f'{name}.error']))}"

    rows = tuple((str(place + 1), *(cell(name, place) for name in names)) for place in range(most))
    return Grid("Snapshots, modes and mean error of the marked combinations.", ("place", *names.values()), rows)


def _singular(count: float) -> list[str]:
    if not count:
        return []
    return [
        f"{plain(count)} combinations can't be simulated with the rows left in, most of them with a single slider "
        "position: all their vectors vanish there, and when the slider passes it, its row is zero. The compiled "
        "simulator says so; round-off may carry other solvers across."
    ]


def _tile(run: RunRecord) -> tuple[int, int]:
    return int(number(run.parameters["snapshots"])), int(number(run.parameters["modes"]))
