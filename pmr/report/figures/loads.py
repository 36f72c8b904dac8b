"""Figures of paths, loads, forces, stresses and forces along beams."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os.path import commonprefix
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pmr.files.arrays import Array
from pmr.report.columns import extreme_indices, interpolate
from pmr.report.figures.canvas import (
    HALF,
    INK,
    ROW,
    SECTIONS,
    WIDE,
    add_legend,
    bins_of,
    legend_rows,
    make_sheet,
    section_colours,
)
from pmr.report.figures.histories import Timeline, history_figure, largest_of
from pmr.report.numbers import unit_for
from pmr.report.subject import field_times
from pmr.results import BodyResult, RunResult
from pmr.results.quantities import UNIT_QUANTITIES, unit_text
from pmr.results.response import Output

#: Largest number of lines that are drawn thicker the earlier they come, so that lines show that lie on each other.
MOST_THICK = 4


def line_figure(
    result: RunResult, lines: Mapping[str, Array], base: str, quantity: str, colours: Sequence[str] = SECTIONS[1:]
) -> Figure:
    """Draw `lines` (T,) of the reduced model over time in one panel, with their names in the legend.

    `base` is their unit without prefix, and `quantity` the name on the axis.  A line without a name has no entry.
    """
    time, unit, names = Timeline(result), unit_for(largest_of(lines), base), [name for name in lines if name]
    shade = time.shade_legend()
    rows = legend_rows([*names, *(str(entry.get_label()) for entry in shade)], HALF)
    more = ROW * (rows - 1)
    figure, axes = make_sheet(HALF, 1.9 + more, margins={"top": 0.28 + more})
    ax, handles = axes[0, 0], list[Line2D]()
    for k, (name, line) in enumerate(lines.items()):
        width = 0.8 if len(lines) > MOST_THICK else 0.7 + 0.3 * (len(lines) - 1 - k)
        look: dict[str, Any] = {"color": colours[k % len(colours)], "linewidth": width}
        shown = extreme_indices(line, bins_of(ax))
        ax.plot(time.t[shown], line[shown] / unit.size, **look)
        handles += [Line2D([], [], label=name, **look)] if name else []
    time.frame(ax, f"{quantity} in {unit_text(unit.name)}" if unit.name else quantity)
    ax.axhline(0.0, linewidth=0.0)  # the axis of a constant line includes zero
    add_legend(figure, [*handles, *shade], rows)
    return figure


def output_figure(result: RunResult, outputs: Sequence[Output]) -> Figure:
    """Draw outputs of one unit over time in one panel; names are without the words that all of them begin with."""
    words, response = [output.name.split(" ") for output in outputs], result.responses["reduced"]
    shared, unit = len(commonprefix(words)), outputs[0].unit
    lines = {" ".join(of[shared:]): response.other(output.name) for of, output in zip(words, outputs, strict=True)}
    return line_figure(result, lines, unit, UNIT_QUANTITIES[unit].capitalize())


def stress_histories(result: RunResult, body: BodyResult) -> dict[str, Array]:
    """Largest stress (T,) of a body in Pa over time, by model, in the order in which the models are drawn."""
    names, t = [name for name in ("full", "reduced") if name in body.peak_stress], field_times(result, body)
    return {name: interpolate(result.responses["reduced"].t, t, body.peak_stress[name]) for name in names}


def stress_figure(result: RunResult, body: BodyResult) -> Figure:
    """Draw the largest von Mises stress of a body over time, and its difference to the reference model.

    A dot is at the peak.
    """
    time, signals = Timeline(result), stress_histories(result, body)
    peak = int(np.argmax(signals["reduced"]))
    figure, unit = history_figure(time, signals, "Stress", "Pa"), unit_for(largest_of(signals), "Pa")
    ax = figure.axes[0]
    ax.plot(time.t[peak], signals["reduced"][peak] / unit.size, "o", markersize=4.0, color=INK, zorder=5.0)
    ax.set_ylim(bottom=0.0)
    return figure


def envelope_figure(result: RunResult, quantities: Sequence[str]) -> Figure:
    """Draw the range over time of forces or moments along the beams, by the reduced model, one panel a quantity.

    `quantities` are the names of these forces and moments.
    """
    envelopes_by_body = {
        name: body.envelopes["reduced"] for name, body in result.bodies.items() if "reduced" in body.envelopes
    }
    columns = min(len(quantities), 2)
    rows = -(-len(quantities) // columns)
    gaps = {"hspace": 0.45, "wspace": 0.28}
    figure, axes = make_sheet(
        WIDE, 0.66 + 1.25 * rows, rows, columns, margins={"top": 0.42}, sharex=True, gridspec_kw=gaps
    )
    colours = {name: colour for name, colour in section_colours(result.bodies).items() if name in envelopes_by_body}
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
    add_legend(figure, [Patch(color=colour, alpha=0.45, label=name) for name, colour in colours.items() if name])
    return figure
