"""Figures of the basis' singular values, the eigenfrequencies and the tip's response in frequency."""

from __future__ import annotations

from math import floor, log10
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator, NullLocator

from pmr.report.decimation import spread
from pmr.report.figures.canvas import HALF, INK, MUTED, PENS, RAMP, key, log_axis, octave_axis, sheet
from pmr.report.numbers import share_captured
from pmr.report.subject import length, moving_part
from pmr.results import FrequencyResponse, RunResult, Shapes

CLOSED_FORM_POINTS = 11
#: Lines of equal frequency on a map at most.
LEVELS = 9
#: Share of an axis next to its ends within which a contour has no label.
EDGE = 0.06
#: Of places from one end of the path to the other.
COLOURS = ("#440154", "#3b528b", "#21918c", "#5ec962", "#c9b30e")


def singular_values(result: RunResult, of: Shapes) -> Figure:
    """Singular values over the first of them; those of the basis are filled, kappa(r) is what they hold."""
    sigma, taken = of.singular_values, of.shapes.shape[1]
    figure, axes = sheet(HALF, 2.15)
    ax = axes[0, 0]
    number, relative = np.arange(1, len(sigma) + 1), sigma / sigma[0]
    positive = relative > 0.0
    for chosen, fill, label in (
        (positive & (number <= taken), PENS["reduced"].colour, f"taken, r = {taken}"),
        (positive & (number > taken), "white", "left out"),
    ):
        if chosen.any():
            look = _dots(PENS["reduced"].colour, fill, 3.2)
            ax.plot(number[chosen], relative[chosen], label=label, **look)
    if taken < len(sigma):
        ax.axvline(taken + 0.5, color=MUTED, linewidth=0.7, linestyle=(0, (3, 2)))
    log_axis(ax, float(relative[positive].min()), 1.0)
    ax.set_xlim(0.0, len(sigma) + 1.0)
    ax.set_xlabel("Number k (–)")
    ax.set_ylabel("Singular value σ(k) / σ(1) (–)")
    kappa = result.summary.get("basis", {}).get("kappa")
    if kappa is not None:
        ax.text(0.03, 0.06, share_captured(kappa, taken), transform=ax.transAxes)
    key(figure, ax.get_legend_handles_labels()[0])
    return figure


def frequencies(result: RunResult) -> Figure:
    """Lowest eigenfrequencies in Hz against the slider position; closed forms as far up as the models.

    Where a body slides out of a mouth, against what of it reaches beyond that.
    """
    lowest = result.frequencies
    # 0 Hz, of what is past its buckling load, has no place on a logarithmic axis
    curves = {name: np.where(f > 0.0, f, np.nan) for name, f in lowest.models.items() if name in PENS}
    top = np.max([np.nanmax(f, axis=1) for f in curves.values()], axis=0)[:, None]
    closed = lowest.models.get("closed_form", np.empty((len(lowest.along), 0)))
    closed = np.where(closed <= 1.01 * top, closed, np.nan)
    heads = {"slider": "Slider position s in m", "mouth": "Length beyond the mouth in m"}
    x = length(result) - lowest.along if moving_part(result) == "mouth" else lowest.along
    head = heads.get(moving_part(result), "Reach from the base's tail in m")
    if lowest.t is not None and len(x) > 1 and not np.ptp(x):  # it stays, and what stresses it changes
        x, head = lowest.t, "Time in s"
    single = {"marker": "o"} if len(x) == 1 else {}
    figure, axes = sheet(HALF, 2.15)
    ax = axes[0, 0]
    handles = []
    few = spread(len(x), CLOSED_FORM_POINTS)
    drawn = [(name, x, curves[name], PENS[name].line() | single) for name in PENS if name in curves]
    for label, at, f, look in (*drawn, ("closed form", x[few], closed[few], _dots(INK, "none", 2.6))):
        if np.isfinite(f).any():
            ax.plot(at, f, **look)
            handles.append(Line2D([], [], label=label, **look))
    octave_axis(ax, min(float(np.nanmin(f)) for f in curves.values()), float(top.max()))
    ax.set_xlabel(head)
    ax.set_ylabel("Eigenfrequency in Hz")
    key(figure, handles)
    return figure


def frequency_map(result: RunResult) -> Figure:
    """First natural frequency over the extensions of two joints, as lines of equal frequency, and the run's way."""
    over_joints = result.frequencies.over_joints
    assert over_joints is not None  # who asks for the figure has looked
    figure, axes = sheet(HALF, 2.6)
    ax = axes[0, 0]
    levels = MaxNLocator(LEVELS).tick_values(over_joints.lowest.min(), over_joints.lowest.max())
    ax.contourf(
        over_joints.first,
        over_joints.second,
        over_joints.lowest.T,
        levels,
        cmap=LinearSegmentedColormap.from_list("", RAMP[:3]),
    )
    columns = [result.paths.names.index(name) for name in over_joints.joints]
    ax.plot(*result.paths.values[:, columns].T, color="white", linewidth=2.5)
    lines = ax.contour(over_joints.first, over_joints.second, over_joints.lowest.T, levels, colors=INK, linewidths=0.5)
    low, high = (np.array([over_joints.first[k], over_joints.second[k]]) for k in (0, -1))
    for label in ax.clabel(lines, fmt=lambda value: f"{value:.3g}", inline=False):
        label.set_path_effects([withStroke(linewidth=2.0, foreground="white")])
        share = (np.array(label.get_position()) - low) / (high - low)
        label.set_visible(bool(share.min() >= EDGE and share.max() <= 1.0 - EDGE))  # at the edge half of it is cut off
    ax.set_xlabel(f"Extension of {over_joints.joints[0]} in m")
    ax.set_ylabel(f"Extension of {over_joints.joints[1]} in m")
    return figure


def _dots(edge: str, fill: str, size: float) -> dict[str, Any]:
    return {
        "linestyle": "none",
        "marker": "o",
        "markersize": size,
        "markerfacecolor": fill,
        "markeredgecolor": edge,
        "markeredgewidth": 0.6,
    }


def gain(response: FrequencyResponse, load: int) -> Figure:
    """Gain over frequency for a load, a curve for each place of the sliders."""
    figure, axes = sheet(HALF, 2.15)
    ax, values = axes[0, 0], response.gain[:, :, load]
    handles = []
    for k, s in enumerate(response.s):
        look: dict[str, Any] = {"color": COLOURS[k % len(COLOURS)], "linewidth": 0.9}
        ax.plot(response.f, values[k], **look)
        handles.append(Line2D([], [], label=f"{s:.3g}", **look))
    ax.set_xscale("log")
    decades = [10.0**k for k in range(floor(log10(response.f[0])) + 1, floor(log10(response.f[-1])) + 1)]
    ax.set_xticks(decades, [f"{decade:g}" for decade in decades])
    ax.xaxis.set_minor_locator(NullLocator())
    positive = values[values > 0.0]
    log_axis(ax, max(float(positive.min()), 1e-6 * float(positive.max())), float(positive.max()))
    ax.set_xlabel("Frequency in Hz")
    ax.set_ylabel(f"Gain in {response.units[load]}")
    key(figure, handles)
    return figure
