"""Figures over time: histories beside a reference model, panels of several quantities, and error bands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os.path import commonprefix

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pmr.files.arrays import Array
from pmr.report import subject
from pmr.report.blocks import Drawing
from pmr.report.columns import ResponseFunction, extreme_indices, interpolate, is_round_off, tip_displacements
from pmr.report.figures import (
    HALF,
    INK,
    PENS,
    SECTIONS,
    SHADE,
    WIDE,
    add_legend,
    bins_of,
    drawing,
    make_axes,
    make_panels,
    make_sheet,
)
from pmr.report.numbers import format_percent, unit_for
from pmr.report.subject import direction_words, field_times
from pmr.results import BodyResult, RunResult
from pmr.results.quantities import UNIT_QUANTITIES
from pmr.results.response import Output

PAUSE = 2  # samples; a standstill of so many samples does not divide a motion
FLATTEST = 1e-3  # least range of an axis as a share of its largest value, so that labels of ticks stay short
BAND = "#f2d6c2"  # colour of an error band


@dataclass(frozen=True)
class Span:
    """An interval of time in s."""

    start: float
    end: float


def sliding_spans(t: Array, rate: Array) -> tuple[Span, ...]:
    """Intervals of time in which something moves, by its `rate` (T,) at the times `t` (T,) in s.

    Standstills of up to `PAUSE` samples, where one ramp ends and the next one begins, do not divide an interval.  The
    result is empty if nothing moves.
    """
    moving = np.flatnonzero(np.abs(rate) > 1e-9 * np.abs(rate).max(initial=0.0))
    if not len(moving):
        return ()
    breaks = np.flatnonzero(np.diff(moving) > PAUSE + 1)
    starts, ends = moving[np.r_[0, breaks + 1]], moving[np.r_[breaks, len(moving) - 1]] + 1
    last = len(t) - 1
    return tuple(Span(float(t[a]), float(t[min(b, last)])) for a, b in zip(starts, ends, strict=True))


class Timeline:
    """Time axis of a run: the times of the reduced model, to which the signals of the other models are interpolated.

    `phases` are the intervals in which something slides, luffs or slews.
    """

    def __init__(self, result: RunResult) -> None:
        self.result = result
        self.t = result.responses["reduced"].t
        angles = [angle.rate(self.t) for angle in subject.changing_angles(result).values()]
        rates = np.abs(np.column_stack([result.paths.rates, *angles]))
        fastest = rates.max(axis=0, initial=0.0)
        shares = rates / np.where(fastest > 0.0, fastest, 1.0)
        self.phases = sliding_spans(self.t, shares.max(axis=1, initial=0.0))
        #: Name of the model to which the others are compared: ``full`` or, if it was not simulated, ``ancf``; None if
        #: the reduced model was simulated alone.
        self.reference = next((name for name in ("full", "ancf") if name in result.responses), None)

    def signals(self, what: ResponseFunction) -> dict[str, Array]:
        """Signals (T,) by simulator; `what` reads the history from a response.

        Simulators without finite values at all times are left out.
        """
        responses = self.result.responses
        drawn = {name: responses[name] for name in PENS if name in responses}  # the thickest line is drawn first
        signals = {name: interpolate(self.t, response.t, what(response)) for name, response in drawn.items()}
        return {name: signal for name, signal in signals.items() if np.isfinite(signal).all()}

    def differences(self, signals: Mapping[str, Array]) -> dict[str, Array]:
        """Differences (T,) between signals and the signal of the reference model, by simulator.

        The result is empty if `signals` do not include the reference model.
        """
        base = self.reference
        if base is None or base not in signals:
            return {}
        return {name: signal - signals[base] for name, signal in signals.items() if name != base}

    def difference_clause(self, signals: Mapping[str, Array]) -> str:
        """Clause that says that the differences of `signals` (T,), by simulator, to the reference are drawn below.

        The clause is empty if there is no reference, or if all differences are 0.  It states the largest difference as
        a share of the largest value of the signals.
        """
        if not (apart := largest_of(self.differences(signals))):
            return ""
        other, share = "ANCF" if self.reference == "ancf" else "the full model", apart / largest_of(signals)
        return f". Below: the difference to {other}, at most {format_percent(share, 2)} of the largest value"

    def trace(self, ax: Axes, curves: Mapping[str, Array], size: float, weight: float = 1.0) -> None:
        """Draw `curves` (T,), by simulator, divided by the `size` of their unit.

        `weight` multiplies the widths of the lines.
        """
        for order, (name, curve) in enumerate(curves.items()):
            shown, pen = extreme_indices(curve, bins_of(ax)), PENS[name]
            zorder = 2.0 + order / 10.0
            ax.plot(self.t[shown], curve[shown] / size, label=pen.label, zorder=zorder, **pen.line(weight))

    def frame(self, ax: Axes, label: str, last: bool = True) -> None:
        """Set limits and labels of axes over time, and shade the phases in which something moves.

        `label` is the label of the vertical axis.  The time axis has its label only if `last` is true, which is meant
        for the lowest axes of a column.
        """
        what = "boom" if subject.changing_angles(self.result) else subject.moving_part(self.result)
        for phase in self.phases:
            ax.axvspan(phase.start, phase.end, color=SHADE, linewidth=0.0, zorder=0.0, label=f"{what} moves")
        ax.set_xlim(self.t[0], self.t[-1])
        ax.set(ylabel=label, xlabel="Time in s" if last else "")
        ax.tick_params(labelbottom=last)


def largest_of(*panels: Mapping[str, Array]) -> float:
    """Largest absolute value of all signals in all panels; 0 without signals."""
    return max((float(np.abs(signal).max(initial=0.0)) for panel in panels for signal in panel.values()), default=0.0)


def drawn_history(
    name: str,
    result: RunResult,
    quantity: ResponseFunction,
    description: str,
    label: str,
    base: str,
    error: Array | None = None,
) -> Drawing:
    """Draw a quantity over time for every simulator, its difference to the reference, and its estimated error.

    Parameters
    ----------
    name : str
        Identifier of the figure in the page.
    quantity : callable
        Reads the quantity (T,), in the unit `base` without prefix, from a response.
    description, label : str
        Beginning of the caption, and label of the axis.
    error : (T,) array, optional
        Estimated error in the unit `base`.
    """
    time = Timeline(result)
    signals = time.signals(quantity)
    difference = time.difference_clause(signals)
    band = (
        "" if error is None else ". The band is the estimated error" if difference else ". Below: the estimated error"
    )
    return drawing(name, history_figure, f"{description}{difference}{band}.", time, signals, label, base, error)


def _widen_limits(ax: Axes, panel: Mapping[str, Array], size: float) -> None:
    """Widen the limits of an axis whose signals hardly change, so that the labels of its ticks stay short.

    `panel` are the signals (T,), which are divided by `size` when they are drawn.
    """
    low, high = (float(end([end(signal) for signal in panel.values()])) for end in (np.min, np.max))
    least = FLATTEST * max(abs(low), abs(high))
    if 0.0 < high - low < least:
        ax.set_ylim((low + high - least) / 2.0 / size, (low + high + least) / 2.0 / size)


def history_figure(
    time: Timeline, signals: Mapping[str, Array], label: str, base: str, error: Array | None = None
) -> Figure:
    """Draw signals (T,) over time, and below them their differences to the reference of `time`.

    The lower panel is left out if all differences are 0 and there is no `error`.  `label` and `base` are the quantity
    and its unit without prefix.  An estimated `error` (T,) is drawn as a band about 0 together with the differences.
    """
    panels, differences = [(label, signals)], time.differences(signals)
    if largest_of(differences) > 0.0 or error is not None:
        panels.append(("Difference" if differences else "Error", differences))
    gaps = {"height_ratios": (1.15, 1.0)[: len(panels)], "hspace": 0.12}
    figure, axes = make_sheet(WIDE, 2.4 if len(panels) > 1 else 1.7, len(panels), gridspec_kw=gaps)
    for ax, (name, panel) in zip(axes[:, 0], panels, strict=True):
        band = error if panel is differences else None
        unit = unit_for(max(largest_of(panel), 0.0 if band is None else float(band.max())), base)
        time.trace(ax, panel, unit.size)
        time.frame(ax, unit.axis_label(name), last=ax is axes[-1, 0])
        if band is not None:
            shown = extreme_indices(band, bins_of(ax))
            edge, look = band[shown] / unit.size, {"color": BAND, "linewidth": 0.0, "zorder": 1.0}
            ax.fill_between(time.t[shown], -edge, edge, label="estimated error", **look)
        else:
            _widen_limits(ax, panel, unit.size)
    return add_legend(figure)


def panel_figure(result: RunResult, panels: Mapping[str, ResponseFunction], base: str, quantity: str) -> Figure:
    """Draw quantities of one unit over time, each in a panel with its name above it; all panels have the same scale.

    `base` is their unit without prefix, and `quantity` the name on the axes.
    """
    time = Timeline(result)
    signals = {name: time.signals(of) for name, of in panels.items()}
    unit, columns = unit_for(largest_of(*signals.values()), base), min(len(panels), 2)
    tall, weight = (0.72, 0.6) if columns > 1 else (1.2, 1.0)
    figure, axes = make_panels(len(panels), tall, 0.09, 0.3, sharex=True, sharey=True)
    for k, (ax, (name, panel)) in enumerate(zip(axes, signals.items(), strict=True)):
        time.trace(ax, panel, unit.size, weight)
        time.frame(ax, "" if k % columns else unit.axis_label(quantity), last=k >= len(panels) - columns)
        ax.set_title(name, loc="left", pad=2.0)
    return add_legend(figure)


#: Largest number of lines that are drawn thicker the earlier they come, so that lines show that lie on each other.
MOST_THICK = 4


def line_figure(
    result: RunResult, lines: Mapping[str, Array], base: str, quantity: str, colours: Sequence[str] = SECTIONS[1:]
) -> Figure:
    """Draw `lines` (T,) of the reduced model over time in one panel, with their names in the legend.

    `base` is their unit without prefix, and `quantity` the name on the axis.  The lines have the `colours` in turn.  A
    line whose name is empty has no entry in the legend.
    """
    time, unit = Timeline(result), unit_for(largest_of(lines), base)
    figure, ax = make_axes(HALF, 1.9, "", "")
    for k, (name, line) in enumerate(lines.items()):
        width = 0.8 if len(lines) > MOST_THICK else 0.7 + 0.3 * (len(lines) - 1 - k)
        shown = extreme_indices(line, bins_of(ax))
        ax.plot(time.t[shown], line[shown] / unit.size, color=colours[k % len(colours)], linewidth=width, label=name)
    time.frame(ax, unit.axis_label(quantity))
    ax.axhline(0.0, linewidth=0.0)  # the axis of a constant line includes zero
    return add_legend(figure)


def output_figure(result: RunResult, outputs: Sequence[Output]) -> Figure:
    """Draw one or more outputs of one unit over time in one panel.

    If all names of outputs begin with the same words, the legend leaves these words out.  Directions are in words.  A
    single output has no legend.
    """
    words, response = [output.name.split(" ") for output in outputs], result.responses["reduced"]
    shared, unit = len(commonprefix(words)), outputs[0].unit
    names = [subject.axis_words(" ".join(of[shared:])) for of in words]
    lines = {name: response.other(output.name) for name, output in zip(names, outputs, strict=True)}
    return line_figure(result, lines, "%" if unit == "1" else unit, UNIT_QUANTITIES[unit].capitalize())


def stress_histories(result: RunResult, body: BodyResult) -> dict[str, Array]:
    """Largest stress (T,) of a body in Pa at the times of the reduced model, by model, in the order of drawing."""
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


def tip_drawings(result: RunResult, prefix: str) -> list[Drawing]:
    """Draw the displacement of the tip in each direction across the axis, and its estimated error.

    Directions in which the displacement is round-off are left out.  `prefix` begins the identifiers of the figures.
    """
    drawings, of = list[Drawing](), subject.crossing(result) or "the tip"
    for number, (direction, what) in enumerate(tip_displacements(result).items()):
        if not is_round_off(result, what):
            label = f"{of.removeprefix('the ').capitalize()} {direction}"
            caption = f"Displacement of {of}, {direction_words(result, direction)}"
            error = None if result.tip_error is None else result.tip_error[:, number]
            anchor = f"{prefix}-tip-{direction}"
            drawings.append(drawn_history(anchor, result, what, caption, label, "m", error))
    return drawings
