"""Figures over time with their captions: histories beside a reference model, energies, residuals and error bands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from pmr.files.arrays import Array
from pmr.report import subject
from pmr.report.blocks import Drawing
from pmr.report.columns import ResponseFunction, envelope_indices, extreme_indices, interpolate, invisible_difference
from pmr.report.figures.canvas import (
    HALF,
    INK,
    PENS,
    SHADE,
    STEPS,
    WIDE,
    add_legend,
    bins_of,
    drawing,
    log_axis,
    make_sheet,
)
from pmr.report.numbers import NOTHING, SPACE, format_length, format_percent, unit_for
from pmr.results import Response, RunResult

SHORT = 400  # samples; in a history with fewer samples no part is enlarged
PAUSE = 2  # samples; a standstill of so many samples does not divide a motion
FLATTEST = 1e-3  # least range of an axis as a share of its largest value, so that labels of ticks stay short
BAND = "#f2d6c2"  # colour of an error band


@dataclass(frozen=True)
class Span:
    """An interval of time in s."""

    start: float
    end: float


def responses_in_drawing_order(result: RunResult) -> Mapping[str, Response]:
    """Responses of a result by simulator, in the order in which they are drawn: the thickest line first."""
    return {name: result.responses[name] for name in PENS if name in result.responses}


def sliding_spans(t: Array, rate: Array) -> tuple[Span, ...]:
    """Intervals of time in which something moves, by its `rate` (T,) at the times `t` (T,) in s; may be none.

    Standstills of up to `PAUSE` samples, where one ramp ends and the next one begins, do not divide an interval.
    """
    moving = np.flatnonzero(np.abs(rate) > 1e-9 * np.abs(rate).max(initial=0.0))
    if not len(moving):
        return ()
    breaks = np.flatnonzero(np.diff(moving) > PAUSE + 1)
    starts, ends = moving[np.r_[0, breaks + 1]], moving[np.r_[breaks, len(moving) - 1]] + 1
    last = len(t) - 1
    return tuple(Span(float(t[a]), float(t[min(b, last)])) for a, b in zip(starts, ends, strict=True))


def _relative_rates(result: RunResult, t: Array) -> Array:
    """Largest relative rate (T,) of all changing paths and angles, at the times `t` (T,) in s.

    Each rate is divided by its own largest value, as rates of lengths and of angles have no common unit.
    """
    angles = [angle.rate(t) for angle in subject.changing_angles(result).values()]
    rates = np.abs(np.column_stack([result.paths.rates, *angles]))
    fastest = rates.max(axis=0, initial=0.0)
    return np.asarray((rates / np.where(fastest > 0.0, fastest, 1.0)).max(axis=1, initial=0.0))


class Timeline:
    """Time axis of a run: the times of the reduced model, to which the signals of the other models are interpolated.

    `phases` are the intervals in which something slides, luffs or slews.
    """

    def __init__(self, result: RunResult) -> None:
        self.result = result
        self.t = result.responses["reduced"].t
        self.whole = Span(float(self.t[0]), float(self.t[-1]))
        self.phases = sliding_spans(self.t, _relative_rates(result, self.t))
        #: Name of the model to which the others are compared: ``full`` or, if it was not simulated, ``ancf``; None if
        #: the reduced model was simulated alone.
        self.reference = next((name for name in ("full", "ancf") if name in result.responses), None)

    def signals(self, what: ResponseFunction) -> dict[str, Array]:
        """Signals (T,) by simulator; `what` reads the history from a response.

        Simulators without finite values at all times are left out.
        """
        signals = {
            name: interpolate(self.t, response.t, what(response))
            for name, response in responses_in_drawing_order(self.result).items()
        }
        return {name: signal for name, signal in signals.items() if np.isfinite(signal).all()}

    def differences(self, signals: Mapping[str, Array]) -> dict[str, Array]:
        """Differences (T,) between signals and the signal of the reference model, by simulator.

        They are empty if `signals` do not include the reference model.
        """
        base = self.reference
        if base is None or base not in signals:
            return {}
        return {name: signal - signals[base] for name, signal in signals.items() if name != base}

    def visible_differences(self, *panels: Mapping[str, Array], largest: float = 0.0) -> list[dict[str, Array]]:
        """Differences to the reference for each panel, by simulator; all are empty if they are too small to be seen.

        They are too small if they do not exceed the share `pmr.report.columns.invisible_difference` of the largest
        signal of all panels, or of `largest` if `largest` exceeds that signal.
        """
        differences = [self.differences(signals) for signals in panels]
        most = max(largest, largest_of(*panels))
        return (
            differences if largest_of(*differences) > invisible_difference(self.result) * most else [{} for _ in panels]
        )

    def detail(self, signals: Mapping[str, Array], largest: float = 0.0) -> Span | None:
        """Window of a twentieth of the time about the largest visible difference of the reduced model.

        If no difference is visible, the window is about the largest value of the reduced model.  It is None for a
        motion of fewer than `SHORT` samples.
        """
        signal = self.visible_differences(signals, largest=largest)[0].get("reduced", signals["reduced"])
        return self.window(int(np.argmax(np.abs(signal))))

    def window(self, step: int) -> Span | None:
        """Window of a twentieth of the time about a time step; None for a motion of fewer than `SHORT` samples."""
        if len(self.t) < SHORT:
            return None
        half = (self.whole.end - self.whole.start) / 40.0
        middle = float(np.clip(self.t[step], self.whole.start + half, self.whole.end - half))
        return Span(middle - half, middle + half)

    def trace(
        self, ax: Axes, curves: Mapping[str, Array], size: float, span: Span | None = None, weight: float = 1.0
    ) -> None:
        """Draw curves (T,) divided by `size` within `span`, which is by default the whole time.

        `weight` multiplies the widths of the lines.
        """
        span = span or self.whole
        inside = np.flatnonzero((self.t >= span.start) & (self.t <= span.end))
        for order, (name, curve) in enumerate(curves.items()):
            shown = inside[extreme_indices(curve[inside], bins_of(ax))]
            ax.plot(self.t[shown], curve[shown] / size, zorder=2.0 + order / 10.0, **PENS[name].line(weight))

    def frame(self, ax: Axes, label: str, span: Span | None = None, last: bool = True) -> None:
        """Set limits and labels of an axis of time, and shade the phases in which something moves.

        Only the lowest axes of a column (`last`) have the name of the time axis below them.
        """
        span = span or self.whole
        for phase in self.phases:
            if phase.end > span.start and phase.start < span.end:
                shown = max(phase.start, span.start), min(phase.end, span.end)
                ax.axvspan(*shown, color=SHADE, linewidth=0.0, zorder=0.0)
        ax.set_xlim(span.start, span.end)
        ax.set_ylabel(label)
        if last:
            ax.set_xlabel("Time in s")
        else:
            ax.tick_params(labelbottom=False)

    def legend(self, names: Sequence[str]) -> list[Any]:
        """Legend entries for the simulators `names`, and for the shade of the phases in which something moves."""
        return [*(Line2D([], [], label=PENS[name].label, **PENS[name].line()) for name in names), *self.shade_legend()]

    def shade_legend(self) -> list[Any]:
        """List with the legend entry for the phases in which something moves; empty if nothing moves."""
        what = "boom" if subject.changing_angles(self.result) else subject.moving_part(self.result)
        return [Patch(facecolor=SHADE, label=f"{what} moves")] if self.phases else []


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
    largest: float | None = None,
) -> Drawing:
    """Draw a quantity over time for every simulator, with a caption that names the difference and the enlarged part.

    Parameters
    ----------
    name : str
        Identifier of the figure in the page.
    quantity : callable
        Reads the quantity (T,), in the unit `base` without prefix, from a response.
    description, label : str
        Beginning of the caption, and label of the axis.
    largest : float, optional
        For displacements, the largest displacement in m in all directions.  Differences that are too small beside it
        are not drawn, but the caption states their size.
    """
    time = Timeline(result)
    signals = time.signals(quantity)
    window, most = time.detail(signals, largest or 0.0), largest or 0.0
    differs = bool(time.visible_differences(signals, largest=most)[0])
    apart = largest_of(time.differences(signals))
    clause = difference_clause(time, signals, most)
    if largest is not None and not differs and apart > 0.0:
        clause = f"; that of {model_words(time.reference or '')} differs by {format_length(apart, 2)} at most"
    caption = f"{description}{clause}."
    if window is not None:
        where = "" if largest is None else f", where it {'deviates' if differs else 'moves'} most"
        span = f"{window.start:.2f}{SPACE}s to {window.end:.2f}{SPACE}s{where}"
        caption += f" The frame, {span}, is enlarged on the right."
    return drawing(name, history_figure, caption, time, signals, label, base, window, most)


def difference_clause(time: Timeline, signals: Mapping[str, Array], largest: float = 0.0) -> str:
    """Clause on the difference to the reference; empty without a reference.

    If the difference is visible, the clause says that it is below in the figure; otherwise it says how small the
    difference is.  `largest` is that of `Timeline.visible_differences`.
    """
    base, limit = time.reference, invisible_difference(time.result)
    if base is None or base not in signals:
        return ""
    if time.visible_differences(signals, largest=largest)[0]:
        return f"; below, the difference to {model_words(base)}"
    share = "the time step's error" if limit > NOTHING else f"{format_percent(NOTHING, 1)} of the largest value"
    return f"; {model_words(base)} differs by less than {share}"


def _widen_limits(ax: Axes, panel: Mapping[str, Array], size: float) -> None:
    """Widen the limits of an axis whose signals hardly change, so that the labels of its ticks stay short.

    `panel` are the signals (T,), which are divided by `size` when they are drawn.
    """
    low, high = (float(end([end(signal) for signal in panel.values()])) for end in (np.min, np.max))
    least = FLATTEST * max(abs(low), abs(high))
    if 0.0 < high - low < least:
        ax.set_ylim((low + high - least) / 2.0 / size, (low + high + least) / 2.0 / size)


def model_words(simulator: str) -> str:
    """Words that name the model of a simulator within a sentence."""
    return "ANCF" if simulator == "ancf" else f"the {simulator} model"


def history_figure(
    time: Timeline, signals: Mapping[str, Array], label: str, base: str, window: Span | None, largest: float = 0.0
) -> Figure:
    """Draw signals (T,) over time, and below them their differences to the reference if these are visible.

    On the right, signals and differences are enlarged within `window`, if this is not None.  `label` and `base` are the
    quantity and its unit without prefix; `largest` is that of `Timeline.visible_differences`.
    """
    panels = [(label, signals)]
    panels += [("Difference", of) for of in time.visible_differences(signals, largest=largest) if of]
    widths, heights = ((3.6, 1.0) if window else (1.0,)), (1.35, 1.0)[: len(panels)]
    gaps = {"width_ratios": widths, "height_ratios": heights, "wspace": 0.05, "hspace": 0.12}
    tall = 2.75 if len(panels) > 1 else 1.9
    figure, axes = make_sheet(WIDE, tall, len(panels), len(widths), sharey="row", gridspec_kw=gaps)
    for number, (row, (name, panel)) in enumerate(zip(axes, panels, strict=True), start=1):
        unit = unit_for(largest_of(panel), base)
        for ax, span in zip(row, (time.whole, window), strict=False):
            time.trace(ax, panel, unit.size, span)
            time.frame(ax, f"{name} in {unit.name}" if ax is row[0] else "", span, last=number == len(panels))
        _widen_limits(row[0], panel, unit.size)
        if window:
            # no label at the place of the last label of the axes on the left
            row[1].xaxis.set_major_locator(MaxNLocator(3, steps=STEPS, prune="lower"))
            row[0].axvspan(window.start, window.end, facecolor="none", edgecolor=INK, linewidth=0.6, zorder=4.0)
    add_legend(figure, time.legend(list(signals)))
    return figure


def energy_drawing(name: str, result: RunResult) -> Drawing:
    """Draw strain, kinetic and external energy over time, and on the right their differences to the reference model.

    `name` is the identifier of the drawing.
    """
    time, parts = Timeline(result), ("strain", "kinetic", "external")
    signals = [time.signals(attrgetter(f"energy.{part}")) for part in parts]
    differences = time.visible_differences(*signals)
    caption = "Strain, kinetic and external energy, which is minus the work of the loads"
    if result.scene.hoist is not None:
        caption += "; the strain energy includes the kinetic energy of the payload and the elastic energy of the rope"
    if any(differences):
        caption += f"; on the right, the differences to {model_words(time.reference or '')}"
    return drawing(name, _energies, f"{caption}.", time, parts, signals, differences)


def _energies(
    time: Timeline,
    parts: Sequence[str],
    signals: Sequence[Mapping[str, Array]],
    differences: Sequence[dict[str, Array]],
) -> Figure:
    """Draw a row of axes for each part of the energy.

    All signals (T,) in J share one unit, and all differences share another.
    """
    columns = [([f"{part.capitalize()} energy" for part in parts], signals)]
    columns += [(["Difference"] * len(parts), differences)] if any(differences) else []
    gaps = {"wspace": 0.24, "hspace": 0.14}
    figure, axes = make_sheet(WIDE, 3.9, len(parts), len(columns), sharex=True, gridspec_kw=gaps)
    for column, (labels, panels) in zip(axes.T, columns, strict=True):
        unit = unit_for(largest_of(*panels), "J")
        for ax, label, panel in zip(column, labels, panels, strict=True):
            time.trace(ax, panel, unit.size, weight=0.6)
            time.frame(ax, f"{label} in {unit.name}", last=ax is column[-1])
            _widen_limits(ax, panel, unit.size)
    add_legend(figure, time.legend(list(signals[-1])))
    return figure


def residual_drawing(name: str, result: RunResult, level: str, unit: str) -> Drawing:
    """Draw the residual of the moving constraint over time, in `unit`.

    `name` is the identifier of the drawing.  `level` says whether it is the residual of the ``position`` or of the
    ``velocity``.
    """
    time = Timeline(result)
    signals = {of: np.abs(signal) for of, signal in time.signals(attrgetter(f"residual_{level}")).items()}
    unknown = [PENS[of].label for of in responses_in_drawing_order(result) if of not in signals]
    missing = f" It is not known for {' and '.join(unknown)}." if unknown else ""
    caption = f"Constraint residual at {level} level, the largest value of each interval.{missing}"
    return drawing(name, _residuals, caption, time, signals, f"Residual of {level} in {unit}")


def _residuals(time: Timeline, signals: Mapping[str, Array], label: str) -> Figure:
    """Draw the upper envelopes of signals (T,) on a logarithmic axis with the given label."""
    figure, axes = make_sheet(HALF, 2.0)
    ax, drawn_values = axes[0, 0], [0.0]
    for order, (name, signal) in enumerate(signals.items()):
        shown = envelope_indices(signal, bins_of(ax))
        shown = shown[signal[shown] > 0.0]
        ax.plot(time.t[shown], signal[shown], zorder=2.0 + order / 10.0, **PENS[name].line())
        drawn_values.extend(signal[shown])
    time.frame(ax, label)
    if max(drawn_values) > 0.0:
        log_axis(ax, min(value for value in drawn_values if value > 0.0), max(drawn_values))
    else:
        ax.set_ylim(0.0, 1.0)
        ax.text(0.5, 0.5, "zero at all times" if signals else "not known", transform=ax.transAxes, ha="center")
    add_legend(figure, time.legend(list(signals)))
    return figure


def estimate_band(result: RunResult, quantity: ResponseFunction, error_bound: Array) -> Figure:
    """Draw an estimated error `error_bound` (T,) in m of a tip displacement as a band about 0.

    The difference between the reduced and the full model is drawn within the band, if the full model was simulated.
    """
    time = Timeline(result)
    off = {name: values for name, values in time.differences(time.signals(quantity)).items() if name == "reduced"}
    figure, axes = make_sheet(WIDE, 1.7)
    ax, shown = axes[0, 0], envelope_indices(error_bound, bins_of(axes[0, 0]))
    unit = unit_for(max(float(error_bound.max()), largest_of(off)), "m")
    edge = error_bound[shown] / unit.size
    ax.fill_between(time.t[shown], -edge, edge, color=BAND, linewidth=0.0, zorder=1.0)
    time.trace(ax, off, unit.size)
    time.frame(ax, f"Difference in {unit.name}")
    add_legend(figure, [*time.legend(list(off)), Patch(color=BAND, label="estimate")])
    return figure
