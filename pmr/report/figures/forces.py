"""Figures over time of what the body carries: forces of pads and sliders, the largest stress."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pmr.report.columns import Force
from pmr.report.decimation import extremes, onto
from pmr.report.figures.canvas import HALF, INK, SECTIONS, WIDE, bins_of, key, sheet
from pmr.report.figures.histories import curves
from pmr.report.figures.timeline import Array, Timeline
from pmr.report.numbers import unit_for
from pmr.report.subject import stress_times
from pmr.results import BodyResult, RunResult
from pmr.results.outputs import Output

MOST_FORCES = 8  # panels of one figure


def forces(result: RunResult, group: Sequence[Force]) -> Figure:
    """Forces, at most `MOST_FORCES`, one panel each on one scale: one face is seen against the other."""
    time, shown = Timeline(result), group
    signals = [time.signals(force.of) for force in shown]
    largest = max((float(np.abs(s).max()) for panel in signals for s in panel.values()), default=0.0)
    unit, columns = unit_for(largest, "N"), min(len(shown), 2)
    rows = -(-len(shown) // columns)
    gaps = {"hspace": 0.3, "wspace": 0.09}
    tall, margins = 0.85 if columns > 1 else 1.39, {"top": 0.42}  # below the key each panel has its name
    figure, axes = sheet(
        WIDE, 0.66 + tall * rows, rows, columns, margins=margins, sharex=True, sharey=True, gridspec_kw=gaps
    )
    for k, (force, panel) in enumerate(zip(shown, signals, strict=True)):
        ax, last = axes.flat[k], k >= len(shown) - columns
        time.trace(ax, panel, unit.size, weight=0.6 if columns > 1 else 1.0)
        time.frame(ax, "" if k % columns else f"Force in {unit.name}", last=last)
        ax.tick_params(labelbottom=last)
        ax.set_title(force.name, loc="left", pad=2.0)
    for ax in axes.flat[len(shown) :]:
        ax.set_visible(False)
    key(figure, time.legend(list(signals[0])))
    return figure


def pivot(result: RunResult, outputs: Sequence[Output]) -> Figure:
    """Draw the forces, or moments, of the boom on its machine in one panel."""
    time, response = Timeline(result), result.responses["reduced"]
    signals = [response.other(output.name) for output in outputs]
    unit = unit_for(max(float(np.abs(signal).max()) for signal in signals), outputs[0].unit)
    figure, axes = sheet(HALF, 1.9)
    lines = list(zip(signals, [output.name.rpartition(" ")[2] for output in outputs], SECTIONS[1:], strict=False))
    for signal, _, colour in lines:
        shown = extremes(signal, bins_of(axes[0, 0]))
        axes[0, 0].plot(time.t[shown], signal[shown] / unit.size, color=colour, linewidth=0.8)
    time.frame(axes[0, 0], f"{'Moment' if outputs[0].unit == 'N m' else 'Force'} in {unit.name}")
    axes[0, 0].axhline(0.0, linewidth=0.0)
    shade = time.shade() if len(lines) < 4 else ()  # there is no room for a fifth name
    key(figure, [*(Line2D([], [], color=colour, label=name) for _, name, colour in lines), *shade])
    return figure


def stresses(result: RunResult, body: BodyResult) -> dict[str, Array]:
    """The largest stress over time (T,) Pa by model, in the order in which they are drawn."""
    names, t = [name for name in ("full", "reduced") if name in body.peak_stress], stress_times(result, body)
    return {name: onto(result.responses["reduced"].t, t, body.peak_stress[name]) for name in names}


def stress(result: RunResult, body: BodyResult) -> Figure:
    """Largest von Mises stress over time; below it the difference, beside it the time about the largest of all."""
    time, signals = Timeline(result), stresses(result, body)
    peak = int(np.argmax(signals["reduced"]))
    figure = curves(time, signals, "Stress", "Pa", time.window(peak))
    unit = unit_for(max(float(s.max()) for s in signals.values()), "Pa")
    for ax in figure.axes[: 2 if time.window(peak) else 1]:
        ax.plot(time.t[peak], signals["reduced"][peak] / unit.size, "o", markersize=4.0, color=INK, zorder=5.0)
        ax.set_ylim(bottom=0.0)
    return figure
