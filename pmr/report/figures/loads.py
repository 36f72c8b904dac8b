"""Figures of paths, loads, forces, stresses and forces along beams."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from pmr.report import subject
from pmr.report.columns import Force, extreme_indices, interpolate
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
from pmr.report.figures.histories import Array, Timeline, history_figure, largest_of
from pmr.report.numbers import unit_for, with_sign
from pmr.report.subject import field_times, moving_part, reach, shown_force_name, slider_offsets
from pmr.results import BodyResult, RunResult
from pmr.results.quantities import UNIT_QUANTITIES, unit_text
from pmr.results.response import Output
from pmr.scene.built import force_name
from pmr.scene.keys import LUFFING_CYLINDER, qualified_name
from pmr.scene.mechanism import TIPPING_MARGIN
from pmr.scene.signals import SignalBase

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#000000")


def path_figure(result: RunResult) -> Figure:
    """Draw over time the extensions of a boom's sections, or for a body alone the positions of what moves along it."""
    time, ahead, sections = Timeline(result), slider_offsets(result), result.reach is not None
    figure, axes = make_sheet(HALF, 2.0 if sections else 1.7)
    ax = axes[0, 0]
    if sections:
        names, last = result.paths.names, len(result.paths.names) - 1
        widths = [1.0 + 1.2 * (last - k) for k in range(last + 1)]  # sections may extend together
        colours = [section_colours(result.scene.bodies)[name] for name in names]
        _plot(ax, time.t, result.paths.values.T, colours, widths)
        add_legend(figure, [*_legend(names, colours, minimum=1), *time.shade_legend()])
        time.frame(ax, "Extension in m")
        return figure
    _plot(ax, time.t, [result.abscissa + offset for offset in ahead])
    time.frame(ax, f"{moving_part(result).capitalize()} position in m")
    ax.set_ylim(0.0, reach(result))
    add_legend(
        figure, [*_legend([f"s {with_sign(offset)} m" if offset else "s" for offset in ahead]), *time.shade_legend()]
    )
    return figure


def angle_figure(result: RunResult, changing: Mapping[str, SignalBase]) -> Figure:
    """Draw the angles `changing`, which change during the run, over time in degrees."""
    time = Timeline(result)
    figure, axes = make_sheet(HALF, 1.7)
    _plot(axes[0, 0], time.t, [np.rad2deg(angle.value(time.t)) for angle in changing.values()])
    time.frame(axes[0, 0], "Angle in degrees")
    add_legend(figure, [*_legend(list(changing), minimum=1), *time.shade_legend()])
    return figure


def load_figure(result: RunResult) -> Figure:
    """Draw the loads that act over time: forces in one panel, moments in another, temperatures in a third."""
    time, acting = Timeline(result), subject.acting_loads(result)
    units = sorted({load.unit for load in acting})
    rows = (
        legend_rows([*(qualified_name(load.body, load.name) for load in acting), "boom moves"], HALF)
        if len(acting) > 1
        else 1
    )
    more = ROW * (rows - 1)
    tall = 0.8 + 0.9 * len(units) + more
    figure, axes = make_sheet(HALF, tall, rows=len(units), margins={"top": 0.28 + more}, sharex=True)
    names: list[str] = []
    for row, base in enumerate(units):
        ax, chosen = axes[row, 0], [load for load in acting if load.unit == base]
        unit = unit_for(max(float(np.abs(load.values).max()) for load in chosen), base)
        _plot(ax, time.t, [load.values / unit.size for load in chosen], _COLOURS[len(names) % len(_COLOURS) :])
        time.frame(ax, f"{UNIT_QUANTITIES[base].capitalize()} in {unit.name}", last=row == len(units) - 1)
        ax.axhline(0.0, linewidth=0.0)  # the axis of a constant load includes zero
        ax.margins(y=0.1)
        names += [qualified_name(load.body, load.name) for load in chosen]
    add_legend(figure, [*_legend(names), *time.shade_legend()], rows)
    return figure


def _plot(
    ax: Axes,
    t: Array,
    signals: Sequence[Array] | Array,
    colours: Sequence[str] = _COLOURS,
    widths: Sequence[float] = (0.7,),
) -> None:
    """Draw signals (T,) over the times `t` (T,) in s; colours and widths are used in turn."""
    for i, signal in enumerate(signals):
        shown = extreme_indices(signal, bins_of(ax))
        ax.plot(t[shown], signal[shown], color=colours[i % len(colours)], linewidth=widths[i % len(widths)])


def _legend(names: Sequence[str], colours: Sequence[str] = _COLOURS, minimum: int = 2) -> list[Any]:
    """Legend entries of lines in these colours, which are used again after the last one.

    It is empty for fewer than `minimum` names, as the label of the axis then names the line.
    """
    if len(names) < minimum:
        return []
    return [Line2D([], [], label=name, color=colours[i % len(colours)]) for i, name in enumerate(names)]


MOST_FORCES = 6  # largest number of panels in one figure


def force_figure(result: RunResult, group: Sequence[Force]) -> Figure:
    """Draw up to `MOST_FORCES` forces, or moments, over time, each in its own panel; all panels have the same scale."""
    time = Timeline(result)
    signals = [time.signals(force.history) for force in group]
    unit, columns = unit_for(largest_of(*signals), group[0].unit), min(len(group), 2)
    rows = -(-len(group) // columns)
    gaps, what = {"hspace": 0.3, "wspace": 0.09}, UNIT_QUANTITIES[group[0].unit].capitalize()
    tall, margins = 0.76 if columns > 1 else 1.39, {"top": 0.42}  # each panel has a title below the legend
    figure, axes = make_sheet(
        WIDE, 0.66 + tall * rows, rows, columns, margins=margins, sharex=True, sharey=True, gridspec_kw=gaps
    )
    for k, (force, panel) in enumerate(zip(group, signals, strict=True)):
        ax, last = axes.flat[k], k >= len(group) - columns
        time.trace(ax, panel, unit.size, weight=0.6 if columns > 1 else 1.0)
        time.frame(ax, "" if k % columns else f"{what} in {unit.name}", last=last)
        ax.tick_params(labelbottom=last)
        ax.set_title(force.name + force.remark, loc="left", pad=2.0)
    for ax in axes.flat[len(group) :]:
        ax.set_visible(False)
    add_legend(figure, time.legend(list(signals[0])))
    return figure


def pivot_figure(result: RunResult, outputs: Sequence[Output]) -> Figure:
    """Draw outputs of one unit over time, all in one panel: forces or moments on the machine, what a cylinder has."""
    names = [shown_force_name(output.name) for output in outputs]
    names = [name if name == LUFFING_CYLINDER else name.rpartition(" ")[2] for name in names]
    return _panel_of_outputs(result, outputs, names, UNIT_QUANTITIES[outputs[0].unit].capitalize())


def ground_figure(result: RunResult, outputs: Sequence[Output]) -> Figure:
    """Draw forces of outriggers, margins against tipping, or the use of the support polygon over time."""
    quantity = {"outrigger": "Force", "margin": "Margin", "tipping": "Use of the polygon"}[outputs[0].kind]
    names = [output.name.removeprefix(force_name("outrigger ")).removeprefix(TIPPING_MARGIN) for output in outputs]
    return _panel_of_outputs(result, outputs, names if len(outputs) > 1 else [], quantity)


def _panel_of_outputs(result: RunResult, outputs: Sequence[Output], names: Sequence[str], quantity: str) -> Figure:
    """Draw outputs of one unit over time in one panel, with their `names` in the legend and the `quantity` beside."""
    time, response = Timeline(result), result.responses["reduced"]
    signals = [response.other(output.name) for output in outputs]
    unit = unit_for(max(float(np.abs(signal).max()) for signal in signals), outputs[0].unit)
    rows = legend_rows(names, HALF) if len(names) > 3 else 1
    more = ROW * (rows - 1)
    figure, axes = make_sheet(HALF, 1.9 + more, margins={"top": 0.28 + more})
    colours = (*SECTIONS[1:], *_COLOURS)
    _plot(axes[0, 0], time.t, [signal / unit.size for signal in signals], colours, (0.8,))
    time.frame(axes[0, 0], f"{quantity} in {unit_text(unit.name)}" if outputs[0].unit != "1" else quantity)
    axes[0, 0].axhline(0.0, linewidth=0.0)
    shade = time.shade_legend() if len(names) < 4 else ()  # there is no room for a fifth name
    add_legend(figure, [*_legend(names, colours, minimum=1), *shade], rows)
    return figure


def stress_histories(result: RunResult, body: BodyResult) -> dict[str, Array]:
    """Largest stress (T,) of a body in Pa over time, by model, in the order in which the models are drawn."""
    names, t = [name for name in ("full", "reduced") if name in body.peak_stress], field_times(result, body)
    return {name: interpolate(result.responses["reduced"].t, t, body.peak_stress[name]) for name in names}


def stress_figure(result: RunResult, body: BodyResult) -> Figure:
    """Draw the largest von Mises stress of a body over time, and its difference to the reference model.

    On the right the time about the peak is enlarged.
    """
    time, signals = Timeline(result), stress_histories(result, body)
    peak = int(np.argmax(signals["reduced"]))
    figure = history_figure(time, signals, "Stress", "Pa", time.window(peak))
    unit = unit_for(largest_of(signals), "Pa")
    for ax in figure.axes[: 2 if time.window(peak) else 1]:
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
