"""Figures along the beams of a boom: envelopes over time of the forces and moments of their sections."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from pmr.report.figures.canvas import WIDE, key, of_sections, sheet
from pmr.report.numbers import unit_for
from pmr.results import RunResult


def envelopes(result: RunResult, quantities: Sequence[str]) -> Figure:
    """The reduced model's, one panel each: from the smallest to the largest value along each beam."""
    envelopes_by_body = {
        name: body.envelopes["reduced"] for name, body in result.bodies.items() if "reduced" in body.envelopes
    }
    columns = min(len(quantities), 2)
    rows = -(-len(quantities) // columns)
    gaps = {"hspace": 0.45, "wspace": 0.28}
    figure, axes = sheet(WIDE, 0.66 + 1.25 * rows, rows, columns, margins={"top": 0.42}, sharex=True, gridspec_kw=gaps)
    colours = {name: colour for name, colour in of_sections(result.bodies).items() if name in envelopes_by_body}
    for k, quantity in enumerate(quantities):
        ax = axes.flat[k]
        shown = {name: envelope for name, envelope in envelopes_by_body.items() if quantity in envelope.names}
        numbers = {name: envelope.names.index(quantity) for name, envelope in shown.items()}
        largest = max(
            np.abs([envelope.least[numbers[n]], envelope.most[numbers[n]]]).max() for n, envelope in shown.items()
        )
        unit = unit_for(float(largest), next(envelope.units[numbers[n]] for n, envelope in shown.items()))
        for name, envelope in shown.items():
            of = numbers[name]
            band = envelope.least[of] / unit.size, envelope.most[of] / unit.size
            ax.fill_between(envelope.x, *band, color=colours[name], alpha=0.45, linewidth=0.8)
        ax.axhline(0.0, linewidth=0.4, color="0.5")
        ax.set_title(f"{quantity.capitalize()} in {unit.name}", loc="left", pad=2.0)
        if k >= len(quantities) - columns:
            ax.set_xlabel("From the tail in m")
            ax.tick_params(labelbottom=True)
    for ax in axes.flat[len(quantities) :]:
        ax.set_visible(False)
    key(figure, [Patch(color=colour, alpha=0.45, label=name) for name, colour in colours.items() if name])
    return figure
