"""Block of a run's report about its hoist: height and swing of the hook, and the force of the rope."""

from __future__ import annotations

from functools import partial

import numpy as np

from pmr.files.arrays import Array
from pmr.report.blocks import Block, Grid
from pmr.report.figures.histories import drawn_history
from pmr.report.forces import abscissa_words, extreme_cells
from pmr.report.numbers import format_input, format_quantity, significant, unit_for
from pmr.results import Response, RunResult
from pmr.results.response import Extremes
from pmr.scene.hoist import KEYS

#: Label of the axis, name in the table, caption and unit of each output.
SHOWN = {
    "height": ("Hook height", "height of the hook", "Height of the hook", "m"),
    "swing_along": (
        "Swing along",
        "swing along the boom",
        "Swing of the hook in the boom's plane, outwards positive",
        "°",
    ),
    "swing_across": ("Swing across", "swing across the boom", "Swing of the hook across that plane", "°"),
    "force": ("Rope force", "force of the rope", "Force of the rope", "N"),
}


def _history(key: str, response: Response) -> Array:
    """Output of a hoist (T,) as it is shown: angles in degrees."""
    values = response.other(KEYS[key])
    return np.rad2deg(values) if SHOWN[key][3] == "°" else values


def hoist_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block about the hoist, with histories and a table of extremes; None if the run has none.

    Quantities that do not change have no history.  `prefix` begins the identifiers of the figures.
    """
    figures = result.summary.get("hoist")
    if figures is None:
        return None
    rows = [
        (drawn_history(f"{prefix}-hoist-{number}", result, partial(_history, key), caption, label, unit),)
        for number, (key, (label, _, caption, unit)) in enumerate(SHOWN.items())
        if figures[key]["max"] > figures[key]["min"]
    ]
    cells, response = list[tuple[str, ...]](), result.responses["reduced"]
    for key, (_, name, _, base) in SHOWN.items():
        extremes = Extremes.from_history(_history(key, response), response.t, result.abscissa_at(response.t))
        unit = unit_for(extremes.size, base)
        cells.append((f"{name} in {unit.name}", *extreme_cells(extremes, unit)))
    grid = Grid(f"The hoist; when that is, and {abscissa_words(result)} then.", ("", "least", "largest"), tuple(cells))
    weight, times = format_quantity(figures["weight_force"], "N"), significant(figures["factor"])
    text = f"The rope's largest force is {times} times that of the weight, {weight}."
    for span in figures.get("slack", ()):
        start, end = (format_input(round(span[key], 3), "s") for key in ("start", "end"))
        text += f" It is slack from {start} to {end}, then it pulls with up to {format_quantity(span['snatch'], 'N')}."
    return Block(heading="Hoist", text=text, rows=tuple(rows), grids=(grid,))
