"""Figures of an observer: estimates with their bands beside what was measured and what is true, and innovations."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pmr.files.arrays import Array
from pmr.report.columns import spread_indices
from pmr.report.figures.canvas import HALF, INK, LIMIT, MUTED, SERIES, add_legend, bins_of, make_sheet
from pmr.report.figures.histories import BAND
from pmr.report.numbers import unit_for

#: Standard deviations on each side of an estimate between which 90 % of the true values should lie.
WIDTH = 1.6449


def band_figure(t: Array, mean: Array, deviation: Array, measured: Array, truth: Array, unit: str) -> Figure:
    """Draw an estimate, its `mean` and `deviation` (T,) in `unit` at t (T,) in s, with its band.

    `measured` and `truth` (T,) are NaN where there is none.
    """
    figure, axes = make_sheet(HALF, 1.9)
    ax, pen = axes[0, 0], unit_for(float(np.nanmax(np.abs(mean))), unit)
    shown = spread_indices(len(t), 2 * bins_of(ax))
    low, high = ((mean + sign * WIDTH * deviation)[shown] / pen.size for sign in (-1.0, 1.0))
    handles = [Patch(color=BAND, label="90 %"), Line2D([], [], color=INK, label="estimate")]
    at, look = np.flatnonzero(np.isfinite(measured)), dict[str, Any]()
    if len(at):
        at = at[spread_indices(len(at), 2 * bins_of(ax))]
        look = {"color": MUTED, "linestyle": "none", "marker": ".", "markersize": 1.2}
        ax.plot(t[at], measured[at] / pen.size, **look, zorder=0.9)
        handles.append(Line2D([], [], **look | {"markersize": 4.0}, label="measured"))
    ax.fill_between(t[shown], low, high, color=BAND, linewidth=0.0, zorder=1.0)
    ax.plot(t[shown], mean[shown] / pen.size, color=INK, linewidth=0.8)
    if np.isfinite(truth).any():
        look = {"color": SERIES[0][0], "linewidth": 0.8, "linestyle": (0, (3, 2))}
        ax.plot(t[shown], truth[shown] / pen.size, **look)
        handles.append(Line2D([], [], **look, label="true"))
    ax.set_xlim(t[0], t[-1])
    ax.set_xlabel("Time in s")
    ax.set_ylabel(f"in {pen.name}" if unit else "")
    add_legend(figure, handles)
    return figure


def innovation_figure(t: Array, innovations: Array) -> Figure:
    """Draw a sensor's innovations (T,) over their standard deviations at t (T,) in s, and lines around 90 % of them."""
    figure, axes = make_sheet(HALF, 1.6)
    ax, at = axes[0, 0], np.flatnonzero(np.isfinite(innovations))
    at = at[spread_indices(len(at), 4 * bins_of(ax))]
    ax.plot(t[at], innovations[at], color=INK, linestyle="none", marker=".", markersize=1.2)
    for level in (-WIDTH, WIDTH):
        ax.axhline(level, color=LIMIT, linewidth=0.8, linestyle=(0, (4, 2)))
    ax.set_xlim(t[0], t[-1])
    ax.set_xlabel("Time in s")
    ax.set_ylabel("Innovation")
    add_legend(figure, [Line2D([], [], color=LIMIT, linewidth=0.8, linestyle=(0, (4, 2)), label="90 %")])
    return figure
