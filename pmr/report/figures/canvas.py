"""Paper, pens and colours: one style for all figures."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import ceil, floor, log10
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, NullLocator

from pmr.report.figures.panel import Panel
from pmr.report.numbers import plain, power_of_ten

WIDE = 6.7  # in, the text width of an A4 page
HALF = 3.25  # in, two beside each other
BINS_PER_INCH = 80.0  # peaks kept: one interval for about the width of a line

MOST_DECADES = 18  # of a logarithmic axis
STEPS = (1, 2, 5, 10)  # between ticks
INK, MUTED, SHADE, LIMIT = "#1c2733", "#5b6875", "#e8ecf0", "#b23b00"
#: Of sections from the base out (Okabe and Ito), the first one again after the last.
SECTIONS = (INK, "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
RAMP = ("#e3ebf0", "#a9cbdf", "#edb84c", "#d55e00", "#7a1b0c")  # from no stress to the largest

_STYLE: Mapping[str, Any] = {
    "font.family": ["DejaVu Sans"],
    "font.size": 7.5,
    "text.parse_math": False,  # what a user writes between two $ is no formula
    "axes.labelsize": 7.5,
    "axes.titlesize": 7.5,
    "xtick.labelsize": 7.0,
    "ytick.labelsize": 7.0,
    "legend.fontsize": 7.0,
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": "#9aa5b1",
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.xmargin": 0.0,
    "axes.titley": 1.0,  # given, so that nothing is measured for it
    "axes.unicode_minus": True,
    "grid.color": "#d9dfe5",
    "grid.linewidth": 0.4,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.bottom": False,  # the grid leads to the labels
    "ytick.left": False,
    "lines.linewidth": 1.0,
    "lines.solid_joinstyle": "round",
    "lines.dash_joinstyle": "round",
    "path.simplify": True,
    "path.simplify_threshold": 0.15,
    "legend.frameon": False,
    "figure.facecolor": "none",
    "savefig.facecolor": "none",
}
ROW, ENTRY, LETTER = 0.14, 0.42, 0.062  # in, of a legend: a row, and the line and a letter of an entry
SHADES = 60  # of the ramp as drawn


@dataclass(frozen=True)
class Pen:
    """How one simulator is drawn: colour (Okabe and Ito), width in pt and dash; legible in grey too."""

    label: str
    colour: str
    width: float
    dash: tuple[float, ...] = ()

    def line(self, weight: float = 1.0) -> dict[str, Any]:
        """Keywords for `Axes.plot`; `weight` thins the line where curves are dense."""
        pattern: Any = (0, tuple(length / self.width for length in self.dash)) if self.dash else "-"
        return {"color": self.colour, "linewidth": weight * self.width, "linestyle": pattern}


PENS: Mapping[str, Pen] = {
    "full": Pen("full", "#56b4e9", 2.4),
    "ancf": Pen("ANCF", "#00664b", 0.7),
    "reduced": Pen("reduced", "#d55e00", 1.0, (4.0, 2.5)),
}


def of_sections(names: Iterable[str]) -> dict[str, str]:
    """The colour of each section of a boom, named from the base out: the same one in all figures."""
    return {name: SECTIONS[k % len(SECTIONS)] for k, name in enumerate(names)}


@contextmanager
def style() -> Iterator[None]:
    """Draw in the style of the report; what was set before is set again afterwards."""
    with mpl.rc_context(dict(_STYLE)):
        yield


def sheet(
    width: float,
    height: float,
    rows: int = 1,
    columns: int = 1,
    margins: Mapping[str, float] | None = None,
    **grid: Any,
) -> tuple[Figure, Any]:
    """An empty figure with a grid of axes, (rows, columns).

    Margins (left, right, top, bottom) are in inches, so that axes of different figures line up and nothing
    has to be measured.  What follows goes to `Figure.subplots`.
    """
    inches = {"left": 0.6, "right": 0.16, "top": 0.28, "bottom": 0.38, **(margins or {})}
    figure = Figure(figsize=(width, height))
    gridspec = {
        "left": inches["left"] / width,
        "right": 1.0 - inches["right"] / width,
        "top": 1.0 - inches["top"] / height,
        "bottom": inches["bottom"] / height,
    }
    gridspec.update(grid.pop("gridspec_kw", {}))
    axes = figure.subplots(rows, columns, squeeze=False, gridspec_kw=gridspec, subplot_kw={"axes_class": Panel}, **grid)
    for ax in axes.flat:
        ax.yaxis.set_major_locator(MaxNLocator(5, steps=STEPS))
        ax.xaxis.set_major_locator(MaxNLocator(8 if width > HALF else 6, steps=STEPS))
        _place_labels(ax)
    return figure, axes


def _place_labels(ax: Axes) -> None:
    """Axis labels at fixed distances: they line up everywhere, and nothing has to be measured."""
    extent, inch = ax.get_window_extent(), mpl.rcParams["figure.dpi"]
    ax.yaxis.set_label_coords(-0.42 * inch / extent.width, 0.5)
    ax.xaxis.set_label_coords(0.5, -0.25 * inch / extent.height)


def key_rows(names: Sequence[str], width: float) -> int:
    """Rows that legend entries of these names take above axes in a figure so wide, in: `ROW` more of its top each."""
    entries = sum(ENTRY + LETTER * len(name) for name in names)
    return max(1, min(ceil(entries / (width - 0.6)), len(names)))


def key(figure: Figure, handles: list[Any], rows: int = 1) -> None:
    """Legend entries above the axes, where no curve runs."""
    if handles:
        left_edge, roomy = figure.axes[0].get_position().x0, figure.get_figwidth() > HALF
        names = [handle.get_label() for handle in handles]
        legend = figure.legend(
            handles=handles,
            labels=[str(number) for number, _ in enumerate(names)],
            loc="upper left",
            bbox_to_anchor=(left_edge - 0.01, 1.0),
            ncols=ceil(len(handles) / rows),
            borderaxespad=0.25,
            columnspacing=1.2 if roomy else 0.9,
            handletextpad=0.6 if roomy else 0.4,
            handlelength=2.2 if roomy else 1.9,
        )
        for text, name in zip(legend.get_texts(), names, strict=True):
            text.set_text(name)  # as a label one that begins with _ would be left out


def log_axis(ax: Axes, low: float, high: float) -> None:
    """Logarithmic y-axis over the whole decades that hold `low` to `high`, at most `MOST_DECADES` of them.

    Powers of ten are labelled by text that needs no math mode.
    """
    top = ceil(log10(high) - 1e-9)
    bottom = max(min(floor(log10(low)), top - 1), top - MOST_DECADES)
    decades = range(top, bottom - 1, -ceil((top - bottom) / 5))
    ax.set_yscale("log")
    ax.set_ylim(10.0 ** (bottom - 0.15), 10.0 ** (top + 0.15))
    ax.set_yticks([10.0**decade for decade in decades], [power_of_ten(decade) for decade in decades])
    ax.yaxis.set_minor_locator(NullLocator())


def octave_axis(ax: Axes, low: float, high: float) -> bool:
    """Logarithmic y-axis labelled 1, 2, 5, 10 for values that span one to four decades; else left linear, and False."""
    if not 10.0 < high / max(low, 1e-300) < 1e4:
        return False
    decades = range(floor(log10(low)), ceil(log10(high)) + 1)
    ticks = [step * 10.0**decade for decade in decades for step in (1.0, 2.0, 5.0)]
    ticks = [tick for tick in ticks if 0.9 * low <= tick <= 1.1 * high]
    ax.set_yscale("log")
    ax.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.yaxis.set_minor_locator(NullLocator())
    return True


def bins_of(ax: Axes) -> int:
    """Intervals in which a signal over the width of `ax` keeps its peaks."""
    inches = ax.get_window_extent().width / mpl.rcParams["figure.dpi"]
    return max(40, int(BINS_PER_INCH * inches))


def ramp(largest: float) -> Figure:
    """Colours from no stress to `largest`, in MPa, and beyond."""
    colours = LinearSegmentedColormap.from_list("stress", RAMP)
    figure, axes = sheet(HALF, 0.55, margins={"left": 0.1, "right": 0.3, "top": 0.08, "bottom": 0.36})
    ax = axes[0, 0]
    for k in range(SHADES):
        ax.axvspan(k / SHADES, (k + 1.2) / SHADES, color=colours(k / (SHADES - 1.0)), linewidth=0.0)
    ticks = np.linspace(0.0, 1.0, 5)
    names = [plain(float(f"{tick * largest:.3g}")) for tick in ticks]
    ax.set_xticks(ticks, [*names[:-1], f"≥ {names[-1]}"])
    ax.set_yticks([])
    ax.set_xlim(0.0, 1.0)
    ax.grid(False)
    ax.spines[:].set_visible(False)
    ax.set_xlabel("Von Mises stress in MPa")
    return figure
