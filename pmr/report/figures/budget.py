"""What reduction, step and mesh take of a tolerance, and how far the model itself is off."""

from __future__ import annotations

from typing import Any

from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pmr.report.figures.canvas import INK, WIDE, key, sheet
from pmr.results import RunResult

COLOURS = {"reduction": "#d55e00", "step": "#56b4e9", "mesh": "#00664b", "model": "#cc79a7"}
NAMES = {
    "beam": "along the body",
    "tip": "tip",
    "pad_force": "forces",
    "cylinder_force": "cylinders",
    "velocity": "velocities",
    "probe": "probes",
}


def budget(result: RunResult) -> Figure:
    """A bar for each part and kind of output in %, and the tolerance."""
    summary = result.summary
    kinds, errors = summary["accuracy"]["outputs"], summary["budget"]
    parts = [name for name in COLOURS if any((errors.get(name) or {}).get(kind) is not None for kind in kinds)]
    height = 0.16 * len(kinds) * (len(parts) + 1)
    figure, axes = sheet(WIDE, 0.7 + height, margins={"left": 1.0, "top": 0.3, "bottom": 0.4})
    ax, pitch, ticks = axes[0, 0], len(parts) + 1, []
    for row, kind in enumerate(kinds):
        for number, name in enumerate(parts):
            share = 100.0 * (errors[name].get(kind) or 0.0)
            ax.barh(-row * pitch - number, share, height=0.85, color=COLOURS[name], linewidth=0.0)
        ticks.append(-row * pitch - (len(parts) - 1) / 2.0)
    handles: list[Artist] = [Patch(color=COLOURS[name], label=name) for name in parts]
    tolerance = summary["accuracy"]["tolerance"]
    ax.set_yticks(ticks, [NAMES[kind] for kind in kinds])
    ax.grid(False, axis="y")
    ax.set_xlim(left=0.0, right=max(105.0 * (tolerance or 0.0), ax.get_xlim()[1]))
    ax.set_xlabel("Part of the error in %")
    if tolerance is not None:
        look: dict[str, Any] = {"color": INK, "linewidth": 0.9, "linestyle": (0, (4, 2))}
        ax.axvline(100.0 * tolerance, **look)
        handles.append(Line2D([], [], label="tolerance", **look))
    key(figure, handles)
    return figure
