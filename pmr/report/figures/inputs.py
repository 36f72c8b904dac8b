"""Figures of what goes in: the slider's path and the loads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pmr.report import subject
from pmr.report.decimation import extremes
from pmr.report.figures.canvas import HALF, bins_of, key, sheet
from pmr.report.figures.timeline import Timeline
from pmr.report.numbers import signed, unit_for
from pmr.report.subject import length, moving, offsets
from pmr.results import RunResult

Array = NDArray[np.float64]
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#000000")


def position(result: RunResult) -> Figure:
    """Positions over time of what moves along the body, on a scale as long as that."""
    time, ahead = Timeline(result), offsets(result)
    figure, axes = sheet(HALF, 1.7)
    ax = axes[0, 0]
    _plot(ax, time.t, [result.along + offset for offset in ahead])
    time.frame(ax, f"{moving(result).capitalize()} position in m")
    ax.set_ylim(0.0, length(result))
    names = [f"s {signed(offset)} m" if offset else "s" for offset in ahead]
    key(figure, [*_legend(names), *time.shade()])
    return figure


def loads(result: RunResult) -> Figure:
    """Loads over time: forces in N and, in a panel of their own, moments in N m."""
    time, acting = Timeline(result), subject.loads(result)
    units = sorted({load.unit for load in acting})
    figure, axes = sheet(HALF, 0.8 + 0.9 * len(units), rows=len(units), sharex=True)
    names: list[str] = []
    for row, base in enumerate(units):
        ax = axes[row, 0]
        chosen = [i for i, load in enumerate(acting) if load.unit == base]
        unit = unit_for(float(np.abs(result.loads.values[:, chosen]).max()), base)
        _plot(ax, time.t, [result.loads.values[:, i] / unit.size for i in chosen], first=len(names))
        quantity = "Force" if base == "N" else "Moment"
        time.frame(ax, f"{quantity} in {unit.name}", last=row == len(units) - 1)
        ax.axhline(0.0, linewidth=0.0)  # a constant load is seen beside zero
        ax.margins(y=0.1)
        names += [acting[i].name for i in chosen]
    key(figure, [*_legend(names), *time.shade()])
    return figure


def _plot(ax: Axes, t: Array, signals: Sequence[Array], first: int = 0) -> None:
    for i, signal in enumerate(signals, start=first):
        shown = extremes(signal, bins_of(ax))
        ax.plot(t[shown], signal[shown], color=_COLOURS[i % len(_COLOURS)], linewidth=0.7)


def _legend(names: Sequence[str]) -> list[Any]:
    """Entries of plain lines; a single one is named by its axis."""
    if len(names) < 2:
        return []
    return [Line2D([], [], label=name, color=_COLOURS[i % len(_COLOURS)]) for i, name in enumerate(names)]
