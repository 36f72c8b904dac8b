"""Figures of deflected beams, basis vectors, natural frequencies, gains, and the parts of an error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from pmr.report.columns import spread_indices
from pmr.report.figures import (
    HALF,
    INK,
    MUTED,
    PENS,
    WIDE,
    add_legend,
    log_axis,
    log_x,
    make_axes,
    make_panels,
    octave_axis,
    section_colours,
)
from pmr.report.numbers import format_input, prose, share_captured, unit_for
from pmr.report.player import RAMP
from pmr.report.subject import crossing, moving_part, reach
from pmr.results import FrequencyResponse, RunResult, Shapes

MOST_SHAPES = 25
COLUMNS = 5
CELL, GAP = 3.1, 1.1  # of a small panel: height over the largest value, and width over the beam's length
FLAT = 1e-6  # share of the largest transverse amplitude below which a vector moves the beam along its axis only


def basis_figure(result: RunResult, body_shapes: Shapes) -> Figure:
    """Draw the transverse shapes of the first `MOST_SHAPES` basis vectors, each divided by its largest value.

    A vector that moves the body along its axis only is a straight line.  All small panels share one pair of axes, since
    two dozen pairs take longer to draw than all other figures.
    """
    x, shapes = body_shapes.x, body_shapes.shapes
    count = min(shapes.shape[1], MOST_SHAPES)
    columns = min(COLUMNS, count)
    rows = -(-count // columns)
    figure, ax = make_axes(WIDE, 0.45 + max(0.5 * rows, 1.2), "x in m", "Relative shape (–)", top=0.08)
    end = reach(result)
    amplitude, flat = np.abs(shapes).max(axis=0), _is_axial(body_shapes)
    for k in range(count):
        x_offset, middle = (k % columns) * GAP * end, -CELL * (k // columns)
        ax.plot([x_offset, x_offset + end], [middle, middle], color="#c9d1d9", linewidth=0.5, zorder=1.0)
        shape = np.zeros_like(x) if flat[k] else shapes[:, k] / amplitude[k]
        ax.plot(x + x_offset, middle + shape, color=PENS["reduced"].colour)
        ax.text(x_offset, middle + 1.3, str(k + 1), color=MUTED, va="center")
    starts = np.arange(columns) * GAP * end
    ax.set_xticks(np.ravel([starts, starts + end], order="F"), ["0", f"{end:g}"] * columns)
    ax.set_yticks([side - CELL * row for row in range(rows) for side in (1.0, -1.0)], ["1", "−1"] * rows)
    ax.grid(False)
    ax.spines[["left", "bottom"]].set_visible(False)
    ax.set_xlim(0.0, starts[-1] + end)
    ax.set_ylim(-CELL * (rows - 1) - 1.1, 1.6)
    return figure


def _is_axial(shapes: Shapes) -> NDArray[np.bool_]:
    """Whether each of the r basis vectors moves the body along its axis only, as a mask (r,)."""
    amplitude = np.abs(shapes.shapes).max(axis=0)
    return np.asarray(amplitude <= FLAT * amplitude.max())


CLOSED_FORM_POINTS = 11
LEVEL = 1e-6  # relative difference up to which neighbouring frequencies count as equal
#: Largest number of lines of equal frequency on a map.
LEVELS = 9
#: Width of the strips at both ends of an axis in which a line of equal frequency gets no label, as a share of the axis.
EDGE = 0.06
#: Colours of the curves of gain, for positions of the sliders from one end of the path to the other.
COLOURS = ("#440154", "#3b528b", "#21918c", "#5ec962", "#c9b30e")


def singular_value_figure(result: RunResult, shapes: Shapes) -> Figure:
    """Draw singular values of the snapshots, divided by the first one, as circles over their numbers.

    Circles of the vectors in the basis are filled, and the others are empty.  If the summary has kappa, the share that
    the basis captures, it is written into the figure.
    """
    sigma, taken = shapes.singular_values, shapes.shapes.shape[1]
    figure, ax = make_axes(HALF, 2.15, "Number k (–)", "Singular value σ(k) / σ(1) (–)")
    number, relative = np.arange(1, len(sigma) + 1), sigma / sigma[0]
    positive = relative > 0.0
    for chosen, fill, label in (
        (positive & (number <= taken), PENS["reduced"].colour, f"taken, r = {taken}"),
        (positive & (number > taken), "white", "left out"),
    ):
        if chosen.any():
            look = _circle_style(PENS["reduced"].colour, fill, 3.2)
            ax.plot(number[chosen], relative[chosen], label=label, **look)
    if taken < len(sigma):
        ax.axvline(taken + 0.5, color=MUTED, linewidth=0.7, linestyle=(0, (3, 2)))
    log_axis(ax, float(relative[positive].min()), 1.0)
    ax.set_xlim(0.0, len(sigma) + 1.0)
    kappa = result.summary.get("basis", {}).get("kappa")
    if kappa is not None:
        ax.text(0.03, 0.06, share_captured(kappa, taken), transform=ax.transAxes)
    return add_legend(figure)


def frequency_figure(result: RunResult) -> Figure:
    """Draw the lowest natural frequencies in Hz over the slider position, the reach, or time if the reach is constant.

    For a body that slides out of a mouth, the abscissa is its length beyond the mouth.  Frequencies of a closed form
    that exceed the highest frequency of the models are left out, and so are frequencies of 0.
    """
    lowest = result.frequencies
    # a boom past its buckling load has 0 Hz, which a logarithmic axis can't show
    curves = {name: np.where(f > 0.0, f, np.nan) for name, f in lowest.models.items() if name in PENS}
    top = np.max([np.nanmax(f, axis=1) for f in curves.values()], axis=0)[:, None]
    closed = lowest.models.get("closed_form", np.empty((len(lowest.along), 0)))
    closed = np.where(closed <= 1.01 * top, closed, np.nan)
    heads = {"slider": "Slider position s in m", "mouth": "Length beyond the mouth in m", "": "s in m"}
    x = reach(result) - lowest.along if moving_part(result) == "mouth" else lowest.along
    head = heads.get(moving_part(result), "Boom length in m")
    head = f"Place of {mover} in m" if (mover := crossing(result)) else head
    if lowest.t is not None and len(x) > 1 and not np.ptp(x):  # the reach is constant, only forces change
        x, head = lowest.t, "Time in s"
    figure, ax = make_axes(HALF, 2.15, head, "Natural frequency in Hz")
    few, single = spread_indices(len(x), CLOSED_FORM_POINTS), {"marker": "o"} if len(x) == 1 else {}
    drawn = [(name, x, curves[name], PENS[name].line() | single) for name in PENS if name in curves]
    for label, at, f, look in (*drawn, ("closed form", x[few], closed[few], _circle_style(INK, "none", 2.6))):
        if np.isfinite(f).any():
            ax.plot(at, f, label=label, **look)
    if lowest.resting is not None and np.any(lowest.resting > 0.0):
        resting = np.where(lowest.resting > 0.0, lowest.resting, np.nan)
        ax.plot(x, resting, label="pads open at rest", **RESTING | single)
    for number, end in enumerate(drawn[0][2][int(np.argmax(x))], start=1):
        if np.isfinite(end):
            ax.annotate(str(number), (x.max(), end), (3.0, -2.5), textcoords="offset points", fontsize=7.0, color=INK)
    drawn_values = np.concatenate([line.get_ydata() for line in ax.lines])
    octave_axis(ax, float(np.nanmin(drawn_values)), float(top.max()))
    return add_legend(figure)


def frequency_map_figure(result: RunResult) -> Figure:
    """Draw lines of equal first natural frequency over the extensions of two joints, and the run's path on this map."""
    over_joints = result.frequencies.over_joints
    assert over_joints is not None  # the caller draws no map without it
    first, second, lowest = over_joints.first, over_joints.second, over_joints.lowest.T
    figure, ax = make_axes(HALF, 2.6, *(f"Extension of {name} in m" for name in over_joints.joints))
    levels = MaxNLocator(LEVELS).tick_values(lowest.min(), lowest.max())
    ax.contourf(first, second, lowest, levels, cmap=LinearSegmentedColormap.from_list("", RAMP[:3]))
    columns = [result.paths.names.index(name) for name in over_joints.joints]
    ax.plot(*result.paths.values[:, columns].T, color="white", linewidth=2.5)
    lines = ax.contour(first, second, lowest, levels, colors=INK, linewidths=0.5)
    low, high = (np.array([first[k], second[k]]) for k in (0, -1))
    for label in ax.clabel(lines, fmt=lambda value: f"{value:.3g}", inline=False):
        label.set_path_effects([withStroke(linewidth=2.0, foreground="white")])
        share = (np.array(label.get_position()) - low) / (high - low)
        label.set_visible(bool(share.min() >= EDGE and share.max() <= 1.0 - EDGE))  # others would be cut off
    return figure


#: Look of the line of frequencies without the pads that are open at rest.
RESTING: dict[str, Any] = {"color": INK, "linestyle": "--", "linewidth": 0.9}


def _circle_style(edge: str, fill: str, size: float) -> dict[str, Any]:
    """Keywords for ``Axes.plot`` of circles without a line, with the colours `edge` and `fill` and a `size` in pt."""
    return {
        "linestyle": "none",
        "marker": "o",
        "markersize": size,
        "markerfacecolor": fill,
        "markeredgecolor": edge,
        "markeredgewidth": 0.6,
    }


def gain_figure(response: FrequencyResponse, load: int) -> Figure:
    """Draw the gain over frequency for the load number `load`, with a curve for each position on the path.

    Gains below a millionth of the largest one are beyond the axis.
    """
    figure, ax = make_axes(HALF, 2.15, "Frequency in Hz", f"Gain in {response.units[load]}")
    values = response.gain[:, :, load]
    for k, s in enumerate(response.s):
        ax.plot(response.f, values[k], color=COLOURS[k % len(COLOURS)], linewidth=0.9, label=f"{s:.3g}")
    log_x(ax, float(response.f[0]), float(response.f[-1]))
    largest = float(values.max())
    log_axis(ax, max(float(values[values > 0.0].min()), 1e-6 * largest), largest)
    return add_legend(figure)


def basis_caption(shapes: Shapes) -> str:
    """Caption of the figure of basis vectors."""
    count, flat = shapes.shapes.shape[1], _is_axial(shapes)[:MOST_SHAPES].any()
    return prose("basis", count=count, shown=min(count, MOST_SHAPES), has_flat_lines=flat)


def frequencies_caption(result: RunResult) -> str:
    """Caption of the figure of natural frequencies."""
    lowest, omega = result.frequencies, result.frequencies.models["reduced"]
    return prose(
        "frequencies",
        is_stressed=lowest.t is not None,
        stays=len(lowest.along) > 1 and not np.ptp(lowest.along),
        part=moving_part(result),
        has_level_stretches=(np.abs(np.diff(omega, axis=0)) < LEVEL * omega[1:]).any(),
        resting=None if lowest.resting is None else np.nanmax(1.0 - lowest.resting / omega[:, 0], initial=0.0),
    )


def envelope_figure(result: RunResult, quantities: Sequence[str]) -> Figure:
    """Draw the range over time of forces or moments along the beams, by the reduced model, one panel a quantity.

    `quantities` are the names of these forces and moments.  Panels with the same unit have the same prefix.
    """
    envelopes_by_body = {
        name: body.envelopes["reduced"] for name, body in result.bodies.items() if "reduced" in body.envelopes
    }
    figure, axes = make_panels(len(quantities), 1.25, 0.28, 0.45, sharex=True)
    colours = section_colours(result.bodies)
    largest, bases = dict[str, float](), dict[str, str]()
    for envelope in envelopes_by_body.values():
        for quantity, base, *ends in zip(envelope.names, envelope.units, envelope.least, envelope.most, strict=True):
            bases[quantity] = base
            largest[base] = max(largest.get(base, 0.0), float(np.abs(ends).max()) if quantity in quantities else 0.0)
    for k, (quantity, ax) in enumerate(zip(quantities, axes, strict=True)):
        unit = unit_for(largest[bases[quantity]], bases[quantity])
        for name, envelope in envelopes_by_body.items():
            if quantity not in envelope.names:
                continue
            of = envelope.names.index(quantity)
            band = envelope.least[of] / unit.size, envelope.most[of] / unit.size
            ax.fill_between(envelope.x, *band, color=colours[name], alpha=0.45, linewidth=0.8, label=name)
        ax.axhline(0.0, linewidth=0.4, color="0.5")
        ax.set_title(unit.axis_label(quantity.capitalize()), loc="left", pad=2.0)
        if k >= len(quantities) - 2:
            ax.set_xlabel("From the tail in m")
            ax.tick_params(labelbottom=True)
    return add_legend(figure)


def colour_scale(largest: float, is_exceeded: bool) -> Figure:
    """Draw the colour scale of stresses from 0 to `largest` in MPa.

    If this is exceeded, the mark at its end says that larger stresses have its colour, too.
    """
    figure, ax = make_axes(HALF, 0.55, "", "", left=0.1, right=0.3, top=0.08, bottom=0.36)
    colours = ScalarMappable(Normalize(0.0, largest), LinearSegmentedColormap.from_list("stress", RAMP))
    ticks = np.linspace(0.0, largest, 5)
    bar = figure.colorbar(colours, ax, orientation="horizontal", ticks=ticks, label="Von Mises stress in MPa")
    names = [format_input(float(f"{tick:.3g}")) for tick in ticks]
    bar.set_ticklabels([*names[:-1], f"{'≥ ' * is_exceeded}{names[-1]}"])
    bar.ax.spines["outline"].set_visible(False)
    return figure
