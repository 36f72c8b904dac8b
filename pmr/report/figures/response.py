"""Figure of the tip's response in frequency, place by place along the path."""

from __future__ import annotations

from math import floor, log10
from typing import Any

from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from pmr.report.figures.canvas import HALF, key, log_axis, sheet
from pmr.results import FrequencyResponse

#: From one end of the path to the other.
COLOURS = ("#440154", "#3b528b", "#21918c", "#5ec962", "#c9b30e")


def gain(found: FrequencyResponse, load: int) -> Figure:
    """Gain over frequency for a load, a curve for each place of the sliders."""
    figure, axes = sheet(HALF, 2.15)
    ax, values = axes[0, 0], found.gain[:, :, load]
    handles = []
    for k, s in enumerate(found.s):
        look: dict[str, Any] = {"color": COLOURS[k % len(COLOURS)], "linewidth": 0.9}
        ax.plot(found.f, values[k], **look)
        handles.append(Line2D([], [], label=f"{s:.3g}", **look))
    ax.set_xscale("log")
    decades = [10.0**k for k in range(floor(log10(found.f[0])) + 1, floor(log10(found.f[-1])) + 1)]
    ax.set_xticks(decades, [f"{decade:g}" for decade in decades])
    ax.xaxis.set_minor_locator(NullLocator())
    positive = values[values > 0.0]
    log_axis(ax, max(float(positive.min()), 1e-6 * float(positive.max())), float(positive.max()))
    ax.set_xlabel("Frequency in Hz")
    ax.set_ylabel(f"Gain in {found.units[load]}")
    key(figure, handles)
    return figure
