"""Figures along the axis: the vectors of the basis, snapshots of the motion."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from pmr.report.columns import lines, tips
from pmr.report.decimation import onto
from pmr.report.figures.canvas import INK, MUTED, PENS, WIDE, key, sheet
from pmr.report.figures.timeline import in_order
from pmr.report.numbers import round_number, unit_for
from pmr.report.subject import fixtures, length, moving_part, offsets
from pmr.results import RunResult, Shapes

MOST_SHAPES = 25
COLUMNS = 5
CELL, GAP = 3.1, 1.1  # height of a small multiple in largest values, and its width in beam lengths
FLAT = 1e-6  # of the largest transverse amplitude: below, a vector moves the beam along its axis only
SNAPSHOTS = 6
#: Largest deflection of a boom as drawn, over its reach.
REACH = 0.05


def has_flat(shapes: Shapes) -> bool:
    """Whether any of the basis vectors that are drawn has no transverse part."""
    return bool(_flat(shapes)[:MOST_SHAPES].any())


def basis(result: RunResult, of: Shapes) -> Figure:
    """Transverse shape of each basis vector, scaled to a largest value of one, as small multiples.

    They share one pair of axes, since two dozen pairs take longer to draw than all other figures.
    """
    x, shapes = of.x, of.shapes
    count = min(shapes.shape[1], MOST_SHAPES)
    columns = min(COLUMNS, count)
    rows = -(-count // columns)
    figure, axes = sheet(WIDE, 0.45 + max(0.5 * rows, 1.2), margins={"top": 0.08})
    ax = axes[0, 0]
    end = length(result)
    amplitude, flat = np.abs(shapes).max(axis=0), _flat(of)
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
    ax.set_xlabel("x in m")
    ax.set_ylabel("Relative shape (–)")
    return figure


def snapshots(result: RunResult) -> Figure:
    """The deflected beams, once in each part of the time, where the reduced model's tip is farthest away."""
    reduced, beams = result.responses["reduced"], in_order(result)
    farthest, parts = np.abs(tips(result)["z"](reduced)), np.array_split(np.arange(len(reduced.t)), SNAPSHOTS)
    chosen = [int(part[np.argmax(farthest[part])]) for part in parts if len(part)]
    axis = lines(result, reduced)
    deflected = {
        name: [(of, onto(reduced.t, response.t, of.moved(response))[chosen]) for of in lines(result, response)]
        for name, response in beams.items()
    }
    unit = unit_for(max(float(np.abs(w).max()) for curves in deflected.values() for _, w in curves), "m")
    gaps = {"wspace": 0.05, "hspace": 0.4}
    figure, axes = sheet(
        WIDE, 2.8, SNAPSHOTS // 2, 2, margins={"top": 0.45}, sharex=True, sharey=True, gridspec_kw=gaps
    )
    for i, ax in enumerate(axes.flat[: len(chosen)]):
        for order, (name, deflected_lines) in enumerate(deflected.items()):
            for axis_line, (of, w) in zip(axis, deflected_lines, strict=True):
                at = axis_line.tail[chosen[i]] + of.x
                ax.plot(at, w[i] / unit.size, zorder=2.0 + order / 10.0, **PENS[name].line())
        _fixtures(ax, result, float(result.along[chosen[i]]))
        ax.set_title(f"t = {float(reduced.t[chosen[i]]):.4g} s", loc="left", pad=2.0)
    end = length(result)
    axes[0, 0].set_xlim(-0.03 * end, 1.02 * end)
    figure.supxlabel("x in m", fontsize=7.5, y=0.02)
    figure.supylabel(f"Transverse displacement in {unit.name}", fontsize=7.5, x=0.004)
    markers = {moving_part(result): ("s", MUTED)} if offsets(result) else {}
    markers |= {"support": ("^", INK)}
    key(
        figure,
        [Line2D([], [], label=PENS[name].label, **PENS[name].line()) for name in beams]
        + [
            Line2D([], [], linestyle="none", marker=marker, markersize=4.5, color=colour, label=label)
            for label, (marker, colour) in markers.items()
        ],
    )
    return figure


def _fixtures(ax: Axes, result: RunResult, s: float) -> None:
    """Sliders and supports, where they hold the beam."""
    for offset in offsets(result):
        ax.plot([s + offset], [0.0], marker="s", markersize=5.0, color=MUTED, zorder=1.9)
    for support in fixtures(result):
        ax.plot([support.at], [0.0], marker="^", markersize=5.0, color=INK, zorder=1.9)


def _flat(of: Shapes) -> NDArray[np.bool_]:
    amplitude = np.abs(of.shapes).max(axis=0)
    return np.asarray(amplitude <= FLAT * amplitude.max())


def exaggeration(result: RunResult) -> float:
    """How many times its size a boom's deflection is drawn: a round number."""
    response = result.responses["reduced"]
    largest = max(float(np.abs(line.moved(response)).max(initial=0.0)) for line in lines(result, response))
    return round_number(REACH * length(result) / largest) if largest > 0.0 else 1.0
