"""What figures over time share: the time axis, phases in which something is moved, curves, legends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from pmr.report import subject
from pmr.report.columns import Quantity, unseen
from pmr.report.decimation import extremes, onto
from pmr.report.figures.canvas import INK, PENS, SHADE, STEPS, bins_of
from pmr.report.numbers import unit_for
from pmr.results import Response, RunResult

Array = NDArray[np.float64]
SHORT = 400  # samples, below which nothing is enlarged
PAUSE = 2  # samples of standstill that still count as one motion


@dataclass(frozen=True)
class Span:
    """An interval of time in s."""

    start: float
    end: float


def in_order(result: RunResult) -> Mapping[str, Response]:
    """Responses in the order in which they are drawn, the thickest line first."""
    return {name: result.responses[name] for name in PENS if name in result.responses}


def reference(result: RunResult) -> str | None:
    """Model with which the others are compared: the full one, or else ANCF; None for a reduced model alone."""
    return next((name for name in ("full", "ancf") if name in result.responses), None)


def sliding_spans(t: Array, rate: Array) -> tuple[Span, ...]:
    """Intervals in which something moves; where one ramp meets the next the rate may vanish for a moment."""
    moving = np.flatnonzero(np.abs(rate) > 1e-9 * np.abs(rate).max(initial=0.0))
    if not len(moving):
        return ()
    breaks = np.flatnonzero(np.diff(moving) > PAUSE + 1)
    starts, ends = moving[np.r_[0, breaks + 1]], moving[np.r_[breaks, len(moving) - 1]] + 1
    last = len(t) - 1
    return tuple(Span(float(t[a]), float(t[min(b, last)])) for a, b in zip(starts, ends, strict=True))


def _relative_rates(result: RunResult, t: Array) -> Array:
    """How fast what slides, luffs or slews moves beside its own fastest, the largest of all, (T,).

    The rates of lengths and of angles have no common unit.
    """
    angles = [angle.rate(t) for angle in subject.changing_angles(result).values()]
    rates = np.abs(np.column_stack([result.paths.rates, *angles]))
    fastest = rates.max(axis=0, initial=0.0)
    return np.asarray((rates / np.where(fastest > 0.0, fastest, 1.0)).max(axis=1, initial=0.0))


class Timeline:
    """The time axis of a case: that of the reduced model, on which the signals of the others are drawn too."""

    def __init__(self, result: RunResult) -> None:
        self.result = result
        self.t = result.responses["reduced"].t
        self.phases = sliding_spans(self.t, _relative_rates(result, self.t))

    def signals(self, what: Quantity) -> dict[str, Array]:
        """A quantity for each simulator that knows it; the others hold values that are no numbers."""
        signals = {name: onto(self.t, response.t, what(response)) for name, response in in_order(self.result).items()}
        return {name: signal for name, signal in signals.items() if np.isfinite(signal).all()}

    def differences(self, signals: Mapping[str, Array]) -> dict[str, Array]:
        """Signals less that of the reference; empty without one."""
        base = reference(self.result)
        if base is None or base not in signals:
            return {}
        return {name: signal - signals[base] for name, signal in signals.items() if name != base}

    def apart(self, *panels: Mapping[str, Array]) -> list[dict[str, Array]]:
        """The differences of each of some signals of one kind; none of any where all of them are as good as nothing."""
        differences = [self.differences(signals) for signals in panels]
        sizes = [
            max((float(np.abs(signal).max()) for of in some for signal in of.values()), default=0.0)
            for some in (differences, panels)
        ]
        return differences if sizes[0] > unseen(self.result) * sizes[1] else [{} for _ in panels]

    def detail(self, what: Quantity) -> Span | None:
        """A twentieth of the time, about the largest difference of the reduced model to its reference.

        Without one that is seen it is about the largest value; None for a motion too short to be seen closer.
        """
        signals = self.signals(what)
        signal = self.apart(signals)[0].get("reduced", signals["reduced"])
        return self.window(int(np.argmax(np.abs(signal))))

    def window(self, step: int) -> Span | None:
        """A twentieth of the time about a time step; None for a motion too short to be seen closer."""
        if len(self.t) < SHORT:
            return None
        start, end = float(self.t[0]), float(self.t[-1])
        half = (end - start) / 40.0
        middle = float(np.clip(self.t[step], start + half, end - half))
        return Span(middle - half, middle + half)

    def draw(
        self,
        axes: Sequence[Axes],
        curves: Mapping[str, Array],
        label: str,
        base: str,
        window: Span | None = None,
        last: bool = True,
        weight: float = 1.0,
    ) -> None:
        """Curves over the whole time on the first axes and, enlarged, over `window` on the second.

        Parameters
        ----------
        axes : sequence of one or two Axes
        curves : mapping from simulator to (T,) array
            In the unit `base`; the prefix that suits the largest value is found here.
        label, base : str
            Name of the quantity and its unit.
        window : Span, optional
            Framed on the first axes.
        last : bool
            Whether the time axis is labelled.
        weight : float
            Thins the lines.
        """
        unit = unit_for(max((float(np.abs(curve).max()) for curve in curves.values()), default=0.0), base)
        spans = [Span(float(self.t[0]), float(self.t[-1])), *([window] if window else [])]
        for ax, span in zip(axes, spans, strict=True):
            self.trace(ax, curves, unit.size, span, weight)
            self.frame(ax, f"{label} in {unit.name}" if ax is axes[0] else "", span, last)
        if window:
            axes[1].xaxis.set_major_locator(MaxNLocator(3, steps=STEPS, prune="lower"))  # beside the first axes' last
            axes[0].axvspan(window.start, window.end, facecolor="none", edgecolor=INK, linewidth=0.6, zorder=4.0)

    def trace(
        self, ax: Axes, curves: Mapping[str, Array], size: float, span: Span | None = None, weight: float = 1.0
    ) -> None:
        """Curves over `size`, the value of one unit of the axis, within `span`."""
        start, end = (span.start, span.end) if span else (float(self.t[0]), float(self.t[-1]))
        inside = np.flatnonzero((self.t >= start) & (self.t <= end))
        for order, (name, curve) in enumerate(curves.items()):
            shown = inside[extremes(curve[inside], bins_of(ax))]
            ax.plot(self.t[shown], curve[shown] / size, zorder=2.0 + order / 10.0, **PENS[name].line(weight))

    def frame(self, ax: Axes, label: str, span: Span | None = None, last: bool = True) -> None:
        """Limits and labels of the time axis, and the phases in which something is moved."""
        start, end = (span.start, span.end) if span else (float(self.t[0]), float(self.t[-1]))
        for phase in self.phases:
            if phase.end > start and phase.start < end:
                shown = max(phase.start, start), min(phase.end, end)
                ax.axvspan(*shown, color=SHADE, linewidth=0.0, zorder=0.0)
        ax.set_xlim(start, end)
        ax.set_ylabel(label)
        if last:
            ax.set_xlabel("Time in s")
        else:
            ax.tick_params(labelbottom=False)

    def legend(self, names: Sequence[str]) -> list[Any]:
        """Legend entries of simulators and of the shade."""
        return [
            *(Line2D([], [], label=PENS[name].label, **PENS[name].line()) for name in names),
            *self.shade(),
        ]

    def shade(self) -> list[Any]:
        """Legend entry of the phases in which something is moved, where there are any."""
        what = "boom" if subject.changing_angles(self.result) else subject.moving_part(self.result)
        return [Patch(facecolor=SHADE, label=f"{what} moves")] if self.phases else []
