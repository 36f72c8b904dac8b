"""Block of a run's report about its hoist: height and swing of the hook, and the force of the rope."""

from __future__ import annotations

from functools import partial

import numpy as np

from pmr.files.arrays import Array
from pmr.report.blocks import Block, Drawing
from pmr.report.figures.histories import drawn_history
from pmr.report.forces import abscissa_words, extremes_grid
from pmr.report.numbers import format_quantity, format_time, significant, unit_for
from pmr.results import Response, RunResult
from pmr.results.quantities import QUANTITIES
from pmr.results.response import Extremes
from pmr.scene.hoist import KEYS

#: Name of each output, what its caption adds, and its quantity.
SHOWN = {
    "height": ("height of the hook", "", "hook_height"),
    "swing_along": ("swing along the boom", ", in the boom's plane, outwards positive", "swing"),
    "swing_across": ("swing across the boom", ", across that plane", "swing"),
    "force": ("force of the rope", "", "hoist_force"),
}


def _history(key: str, response: Response) -> Array:
    """Output of a hoist (T,) as it is shown: angles in degrees."""
    values = response.other(KEYS[key])
    return np.rad2deg(values) if _unit(key) == "°" else values


def _unit(key: str) -> str:
    """Unit in which an output is shown."""
    unit = QUANTITIES[SHOWN[key][2]].unit
    return "°" if unit == "rad" else unit


def hoist_block(result: RunResult, prefix: str) -> Block | None:
    """Build the block about the hoist, with histories and a table of extremes; None if the run has none.

    Quantities that do not change have no history.  `prefix` begins the identifiers of the figures.
    """
    figures = result.summary.get("hoist")
    if figures is None:
        return None
    drawings, extremes, response = list[Drawing](), dict[str, Extremes](), result.responses["reduced"]
    for number, (key, (name, clause, _)) in enumerate(SHOWN.items()):
        label = name.capitalize()
        if figures[key]["max"] > figures[key]["min"]:
            drawn = f"{prefix}-hoist-{number}", result, partial(_history, key), f"{label}{clause}", label, _unit(key)
            drawings.append(drawn_history(*drawn))
        extremes[name] = Extremes.from_history(_history(key, response), response.t, result.abscissa_at(response.t))
    units = {name: unit_for(extremes[name].size, _unit(key)) for key, (name, *_) in SHOWN.items()}
    grid = extremes_grid(f"The hoist; when that is, and {abscissa_words(result)} then.", extremes, units)
    weight, times = format_quantity(figures["weight_force"], "N"), significant(figures["factor"])
    text = f"The rope's largest force is {times} times that of the weight, {weight}."
    for span in figures.get("slack", ()):
        start, end = (format_time(span[key]) for key in ("start", "end"))
        text += f" It is slack from {start} to {end}, then it pulls with up to {format_quantity(span['snatch'], 'N')}."
    return Block(heading="Hoist", text=text, drawings=drawings, grids=(grid,))
