"""Figures of what goes in: paths and loads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pmr.report import subject
from pmr.report.decimation import extremes
from pmr.report.figures.canvas import HALF, ROW, bins_of, key, key_rows, of_sections, sheet
from pmr.report.figures.timeline import Timeline
from pmr.report.numbers import unit_for, with_sign
from pmr.report.subject import length, moving_part, offsets
from pmr.results import RunResult
from pmr.scene.names import named
from pmr.scene.signals import SignalBase

Array = NDArray[np.float64]
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#000000")


def position(result: RunResult) -> Figure:
    """Positions over time of what moves along a body, on a scale as long as that; extensions of a boom's sections."""
    time, ahead, sections = Timeline(result), offsets(result), result.reach is not None
    figure, axes = sheet(HALF, 2.0 if sections else 1.7)
    ax = axes[0, 0]
    if sections:
        names, last = result.paths.names, len(result.paths.names) - 1
        widths = [1.0 + 1.2 * (last - k) for k in range(last + 1)]  # sections may extend together
        colours = [of_sections(result.scene.bodies)[name] for name in names]
        _plot(ax, time.t, result.paths.values.T, colours, widths)
        key(figure, [*_legend(names, colours, least=1), *time.shade()])
        time.frame(ax, "Extension in m")
        return figure
    _plot(ax, time.t, [result.along + offset for offset in ahead])
    time.frame(ax, f"{moving_part(result).capitalize()} position in m")
    ax.set_ylim(0.0, length(result))
    key(figure, [*_legend([f"s {with_sign(offset)} m" if offset else "s" for offset in ahead]), *time.shade()])
    return figure


def angles(result: RunResult, changing: Mapping[str, SignalBase]) -> Figure:
    """Angles of the boom over time, in degrees."""
    time = Timeline(result)
    figure, axes = sheet(HALF, 1.7)
    _plot(axes[0, 0], time.t, [np.rad2deg(angle.value(time.t)) for angle in changing.values()])
    time.frame(axes[0, 0], "Angle in degrees")
    key(figure, [*_legend(list(changing), least=1), *time.shade()])
    return figure


def loads(result: RunResult) -> Figure:
    """Loads over time: forces in N and, in a panel of their own, moments in N m."""
    time, acting = Timeline(result), subject.loads_as_asked(result)
    units = sorted({load.unit for load in acting})
    rows = key_rows([*(named(load.body, load.name) for load in acting), "boom moves"], HALF) if len(acting) > 1 else 1
    more = ROW * (rows - 1)
    tall = 0.8 + 0.9 * len(units) + more
    figure, axes = sheet(HALF, tall, rows=len(units), margins={"top": 0.28 + more}, sharex=True)
    names: list[str] = []
    for row, base in enumerate(units):
        ax, chosen = axes[row, 0], [load for load in acting if load.unit == base]
        unit = unit_for(max(float(np.abs(load.values).max()) for load in chosen), base)
        _plot(ax, time.t, [load.values / unit.size for load in chosen], _COLOURS[len(names) % len(_COLOURS) :])
        quantity = "Force" if base == "N" else "Moment"
        time.frame(ax, f"{quantity} in {unit.name}", last=row == len(units) - 1)
        ax.axhline(0.0, linewidth=0.0)  # a constant load is seen beside zero
        ax.margins(y=0.1)
        names += [named(load.body, load.name) for load in chosen]
    key(figure, [*_legend(names), *time.shade()], rows)
    return figure


def _plot(
    ax: Axes,
    t: Array,
    signals: Sequence[Array] | Array,
    colours: Sequence[str] = _COLOURS,
    widths: Sequence[float] = (0.7,),
) -> None:
    for i, signal in enumerate(signals):
        shown = extremes(signal, bins_of(ax))
        ax.plot(t[shown], signal[shown], color=colours[i % len(colours)], linewidth=widths[i % len(widths)])


def _legend(names: Sequence[str], colours: Sequence[str] = _COLOURS, least: int = 2) -> list[Any]:
    """Entries of plain lines; fewer than `least` are named by their axis."""
    if len(names) < least:
        return []
    return [Line2D([], [], label=name, color=colours[i % len(colours)]) for i, name in enumerate(names)]
