"""How far off the tip may be over time by the estimate, and how far off it is."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from pmr.report.decimation import ceiling
from pmr.report.figures.canvas import WIDE, bins_of, key, sheet
from pmr.report.figures.timeline import Array, Quantity, Timeline
from pmr.report.numbers import unit_for
from pmr.results import RunResult

COLOUR = "#f2d6c2"


def band(result: RunResult, what: Quantity, wide: Array) -> Figure:
    """Of a displacement of the tip the band (T,) in m; in it the difference to the full model, where there is one."""
    time = Timeline(result)
    off = time.differences(time.signals(what))
    figure, axes = sheet(WIDE, 1.7)
    ax = axes[0, 0]
    shown = ceiling(wide, bins_of(ax))
    unit = unit_for(float(max(wide.max(), *(np.abs(one).max() for one in off.values()), 0.0)), "m")
    edge = wide[shown] / unit.size
    ax.fill_between(time.t[shown], -edge, edge, color=COLOUR, linewidth=0.0, zorder=1.0)
    time.trace(ax, {"reduced": off["reduced"]} if "reduced" in off else {}, unit.size)
    time.frame(ax, f"Difference in {unit.name}")
    names = ["reduced"] if "reduced" in off else []
    key(figure, [*time.legend(names), Patch(color=COLOUR, label="estimated band")])
    return figure
