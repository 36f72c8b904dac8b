"""Axes that several figures of studies share."""

from __future__ import annotations

from math import ceil, floor, log10
from typing import Any

from matplotlib.axes import Axes
from matplotlib.ticker import NullLocator

from pmr.report.numbers import plain, power_of_ten

#: Colours of several curves of one kind (Okabe and Ito), and markers that tell them apart without colour.
SERIES = (("#0072b2", "o"), ("#d55e00", "s"), ("#00664b", "^"), ("#cc79a7", "D"), ("#000000", "v"))


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
    again = number // len(SERIES) % 3
    return {
        "color": colour,
        "linewidth": 0.9,
        "linestyle": ("-", "--", ":")[again],
        "marker": marker,
        "markersize": size,
        "markerfacecolor": ("white", colour, "#c9d1d9")[again],
        "markeredgewidth": 0.7,
    }
