"""Figures of any study: what its runs found over what was varied, and over the seconds that they take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil, floor, log10
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from pmr.report.figures.canvas import WIDE, log_axis, sheet
from pmr.report.numbers import Unit, plain, power_of_ten, unit_for
from pmr.report.studies.names import TIME, key_words, quantity_of, run_name, runs_with, unit_of, value_of
from pmr.studies.engine.task import number
from pmr.studies.results import RunRecord

#: Colours of several curves of one kind (Okabe and Ito), and markers that tell them apart without colour.
SERIES = (("#0072b2", "o"), ("#d55e00", "s"), ("#00664b", "^"), ("#cc79a7", "D"), ("#000000", "v"))
MOST_CURVES = 15  # that are named
LOGARITHMIC = 5.0  # times as large as the least: from there on errors are drawn by their powers of ten


def log_x(ax: Axes, low: float, high: float) -> None:
    """Logarithmic x-axis, labelled 1, 2, 5, 10 or, over more than three decades, by powers of ten."""
    decades = range(floor(log10(low)), ceil(log10(high)) + 1)
    many = log10(high / low) > 3.0
    ticks = [step * 10.0**decade for decade in decades for step in ((1.0,) if many else (1.0, 2.0, 5.0))]
    ticks = [tick for tick in ticks if 0.999 * low <= tick <= 1.001 * high]
    ax.set_xscale("log")
    ax.set_xlim(low, high)
    labels = [power_of_ten(round(log10(tick))) if many else plain(tick) for tick in ticks]
    ax.set_xticks(ticks, labels)
    ax.xaxis.set_minor_locator(NullLocator())


def dots(number: int, size: float = 2.6) -> dict[str, Any]:
    """Keywords for `Axes.plot` of the curve with this number; beyond the colours, dashes and filled markers go on."""
    colour, marker = SERIES[number % len(SERIES)]
    cycle = number // len(SERIES) % 3
    return {
        "color": colour,
        "linewidth": 0.9,
        "linestyle": ("-", "--", ":")[cycle],
        "marker": marker,
        "markersize": size,
        "markerfacecolor": ("white", colour, "#c9d1d9")[cycle],
        "markeredgewidth": 0.7,
    }


def over_parameter(done: Sequence[RunRecord], over: str, names: Sequence[str]) -> Figure:
    """A panel for each of the figures `names`, over a parameter; runs that differ in nothing else make a curve."""
    rows, columns = -(-len(names) // 2), min(len(names), 2)
    gaps = {"wspace": 0.28, "hspace": 0.42}
    figure, axes = sheet(WIDE, 0.7 + 1.75 * rows, rows, columns, _room(done, over), gridspec_kw=gaps)
    unit = unit_of(over)
    for name, ax in zip(names, axes.flat, strict=False):
        for look, group in _curves(done, over):
            x, y = _points(group, name, {run.key: number(run.parameters[over]) for run in group})
            ax.plot(x, y, **look)
        _value_axis(ax, name)
        ax.set_xlabel(f"{key_words(over).capitalize()} {f'in {unit}' if unit else '(–)'}")
        ax.margins(x=0.04)
    for ax in axes.flat[len(names) :]:
        ax.set_visible(False)
    _legend(figure, done, over)
    return figure


def over_seconds(done: Sequence[RunRecord], over: str, error: str) -> Figure:
    """An error over the seconds of a simulation."""
    figure, axes = sheet(WIDE, 2.5, margins=_room(done, over))
    ax, times = axes[0, 0], {run.key: 1e3 * run.seconds[TIME] for run in done}
    for look, group in _curves(done, over):
        x, y = _points(group, error, times)
        ax.plot(x, y, **look | {"linestyle": "none"})
    log_x(ax, 0.8 * min(times.values()), 1.25 * max(times.values()))
    _value_axis(ax, error)
    ax.set_xlabel("Time of one simulation in ms")
    _legend(figure, done, over)
    return figure


def _curves(done: Sequence[RunRecord], over: str) -> list[tuple[dict[str, Any], list[RunRecord]]]:
    """Runs that differ in nothing but the parameter `over`, and how they are drawn."""
    groups: dict[str, list[RunRecord]] = {}
    for run in done:
        groups.setdefault(run_name(run, over) if len(run.parameters) > 1 else "", []).append(run)
    return [(dots(k, 3.0) | {"label": name}, group) for k, (name, group) in enumerate(groups.items())]


def _points(group: Sequence[RunRecord], name: str, places: Mapping[str, float]) -> tuple[list[float], list[float]]:
    """Values of a figure in the unit of its axis, in the order of their places."""
    points = sorted((places[run.key], value_of(run, name) / quantity_of(name).size) for run in runs_with(group, name))
    return [x for x, _ in points], [y for _, y in points]


def _value_axis(ax: Axes, name: str) -> None:
    """Errors on a logarithmic axis, sizes on one that shows how far they differ."""
    what, values = quantity_of(name), np.concatenate([curve.get_ydata() for curve in ax.lines])
    largest, positive = float(np.abs(values).max()), values[values > 0.0]
    unit = unit_for(largest, what.unit) if what.unit != "%" else Unit(1.0, "%")
    for curve in ax.lines:
        curve.set_ydata(np.asarray(curve.get_ydata()) / unit.size)
    spread = float(positive.max() / positive.min()) if len(positive) else 1.0
    if (name.startswith("errors") or name == "max_error") and spread > LOGARITHMIC:
        log_axis(ax, float(positive.min()) / unit.size, float(positive.max()) / unit.size)
    else:
        ax.set_ylim(0.0, 1.15 * largest / unit.size or 1.0)
    ax.set_ylabel(f"{what.label.capitalize()} in {unit.name}")


def _room(done: Sequence[RunRecord], over: str) -> dict[str, float]:
    """Room of the legend above the axes, in inches."""
    return {"top": 0.16 + 0.15 * min(-(-len(_curves(done, over)) // 3), MOST_CURVES // 3)}


def _legend(figure: Figure, done: Sequence[RunRecord], over: str) -> None:
    """Curves by what distinguishes them, three in a row; a single one needs no name."""
    looks = [look for look, _ in _curves(done, over)][:MOST_CURVES]
    if len(looks) > 1:
        handles = [Line2D([], [], **look) for look in looks]
        figure.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.07, 1.0), ncols=3, borderaxespad=0.25)
