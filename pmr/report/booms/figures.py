"""Figures of a boom of several sections."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MaxNLocator

from pmr.report.booms.lines import COLOURS, Array, lines, tip
from pmr.report.decimation import extremes
from pmr.report.figures.canvas import HALF, INK, MUTED, PENS, RAMP, WIDE, bins_of, key, octave_axis, sheet
from pmr.report.numbers import round_number, unit_for
from pmr.results import Response, RunResult

#: Extensions at which the boom is drawn; largest deflection as drawn, over its reach; forces in one figure.
DRAWN, REACH, MOST_FORCES = 4, 0.05, 12
#: Lines of equal frequency on a map at most.
LEVELS = 9


def exaggeration(result: RunResult) -> float:
    """How many times its size a deflection is drawn: a round number."""
    response = result.responses["reduced"]
    largest = max(float(np.abs(line.moved).max(initial=0.0)) for line in lines(result, response))
    return round_number(REACH * float(result.along.max()) / largest) if largest > 0.0 else 1.0


def boom(result: RunResult) -> Figure:
    """The deflected boom with all its sections, from its shortest to its longest; outer ones are drawn thicker."""
    goals = np.linspace(result.along.min(), result.along.max(), DRAWN if np.ptp(result.along) > 0.0 else 1)
    steps = [int(np.argmin(np.abs(result.along - goal))) for goal in goals]
    found, scale = lines(result, result.responses["reduced"]), exaggeration(result)
    figure, axes = sheet(WIDE, 0.7 + 0.75 * len(steps), rows=len(steps), sharex=True, sharey=True)
    for ax, step in zip(axes[:, 0], steps, strict=True):
        for k, line in enumerate(found):
            width = 1.2 + 1.3 * (len(found) - 1 - k)
            ax.plot(line.tail[step] + line.x, scale * line.moved[step], color=line.colour, linewidth=width)
        ax.axhline(0.0, color=MUTED, linewidth=0.4, zorder=0.0)
        ax.set_yticks([])
        ax.set_title(f"t = {result.responses['reduced'].t[step]:.3g} s", loc="right", pad=1.0)
    axes[-1, 0].set_xlabel("Along the boom in m")
    key(figure, [Line2D([], [], color=line.colour, linewidth=2.0, label=line.name) for line in found])
    return figure


def extensions(result: RunResult) -> Figure:
    """Extension of every section over time."""
    figure, axes = sheet(HALF, 2.0)
    ax, t = axes[0, 0], result.responses["reduced"].t
    for k, (name, values) in enumerate(zip(result.paths.names, result.paths.values.T, strict=True), start=1):
        shown = extremes(values, bins_of(ax))
        wide = 1.0 + 1.2 * (len(result.scene.names) - 1 - k)  # sections may extend together
        ax.plot(t[shown], values[shown], color=COLOURS[k % len(COLOURS)], label=name, linewidth=wide)
    ax.set_xlim(t[0], t[-1])
    ax.set_xlabel("Time in s")
    ax.set_ylabel("Extension in m")
    key(figure, ax.get_legend_handles_labels()[0])
    return figure


def frequencies(result: RunResult) -> Figure:
    """Lowest natural frequencies against how far the boom reaches."""
    found = result.frequencies
    figure, axes = sheet(HALF, 2.0)
    ax, handles = axes[0, 0], []
    for name in (name for name in PENS if name in found.models):
        ax.plot(found.along, found.models[name], marker="o" if len(found.along) == 1 else "", **PENS[name].line())
        handles.append(Line2D([], [], label=PENS[name].label, **PENS[name].line()))
    values = np.concatenate([one.ravel() for one in found.models.values()])
    octave_axis(ax, float(values.min()), float(values.max()))
    ax.set_xlabel("Reach from the base's tail in m")
    ax.set_ylabel("Natural frequency in Hz")
    key(figure, handles)
    return figure


def frequency_map(result: RunResult) -> Figure:
    """First natural frequency over the extensions of two joints, as lines of equal frequency, and the run's way."""
    found = result.frequencies.over_joints
    assert found is not None  # who asks for the figure has looked
    figure, axes = sheet(HALF, 2.6)
    ax = axes[0, 0]
    levels = MaxNLocator(LEVELS).tick_values(found.lowest.min(), found.lowest.max())
    ax.contourf(found.first, found.second, found.lowest.T, levels, cmap=LinearSegmentedColormap.from_list("", RAMP[:3]))
    columns = [result.scene.names.index(name) - 1 for name in found.joints]
    ax.plot(*result.paths.values[:, columns].T, color="white", linewidth=2.5)
    lines = ax.contour(found.first, found.second, found.lowest.T, levels, colors=INK, linewidths=0.5)
    for label in ax.clabel(lines, fmt=lambda value: f"{value:.3g}", inline=False):
        label.set_path_effects([withStroke(linewidth=2.0, foreground="white")])
    ax.set_xlabel(f"Extension of {found.joints[0]} in m")
    ax.set_ylabel(f"Extension of {found.joints[1]} in m")
    return figure


def tip_history(result: RunResult, direction: str) -> Figure:
    """Displacement of the last section's tip; below it the difference to the full model."""
    curves = {name: tip(result, result.responses[name], direction) for name in PENS if name in result.responses}
    signals = {name: curve for name, curve in curves.items() if curve is not None}
    panels: list[tuple[str, Mapping[str, Array]]] = [(f"Tip {direction}", signals)]
    if "full" in signals:
        panels.append(("Difference", {"reduced": signals["reduced"] - signals["full"]}))
    figure, axes = sheet(WIDE, 0.66 + 1.1 * len(panels), rows=len(panels), sharex=True)
    for ax, (label, shown) in zip(axes[:, 0], panels, strict=True):
        unit = unit_for(max(float(np.abs(signal).max()) for signal in shown.values()), "m")
        _trace(ax, result, shown, unit.size)
        ax.set_ylabel(f"{label} in {unit.name}")
    axes[-1, 0].set_xlabel("Time in s")
    key(figure, _legend(signals))
    return figure


def forces(result: RunResult, names: Sequence[str]) -> Figure:
    """Forces over time, one panel each on one scale."""
    shown = names[:MOST_FORCES]
    panels = [
        {model: response.force(name, 0) for model, response in _drawn(result).items() if name in response.force_names}
        for name in shown
    ]
    unit = unit_for(max(float(np.abs(curve).max()) for panel in panels for curve in panel.values()), "N")
    columns = min(len(shown), 2)
    rows = -(-len(shown) // columns)
    figure, axes = sheet(
        WIDE,
        0.7 + 0.9 * rows,
        rows,
        columns,
        margins={"top": 0.42},
        sharex=True,
        sharey=True,
        gridspec_kw={"hspace": 0.35, "wspace": 0.06},
    )
    for k, (name, panel) in enumerate(zip(shown, panels, strict=True)):
        ax = axes.flat[k]
        _trace(ax, result, panel, unit.size, 0.6)
        ax.set_title(name.removeprefix("force of "), loc="left", pad=2.0)
        ax.set_ylabel("" if k % columns else f"In {unit.name}")
        if k >= len(shown) - columns:
            ax.set_xlabel("Time in s")
            ax.tick_params(labelbottom=True)
    for ax in axes.flat[len(shown) :]:
        ax.set_visible(False)
    key(figure, _legend(panels[0]))
    return figure


def _drawn(result: RunResult) -> Mapping[str, Response]:
    return {name: result.responses[name] for name in PENS if name in result.responses}


def _trace(ax: Axes, result: RunResult, curves: Mapping[str, Array], size: float, weight: float = 1.0) -> None:
    t = result.responses["reduced"].t
    for order, (name, curve) in enumerate(curves.items()):
        kept = extremes(curve, bins_of(ax))
        ax.plot(t[kept], curve[kept] / size, zorder=2.0 + order / 10.0, **PENS[name].line(weight))
    ax.set_xlim(t[0], t[-1])


def _legend(curves: Mapping[str, object]) -> list[Line2D]:
    return [Line2D([], [], label=PENS[name].label, **PENS[name].line()) for name in curves]
