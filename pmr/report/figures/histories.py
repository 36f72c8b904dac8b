"""Figures over time: what the beam does, and how well the simulators agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from operator import attrgetter

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from pmr.report.columns import Quantity
from pmr.report.decimation import upper_envelope
from pmr.report.figures.canvas import HALF, PENS, WIDE, bins_of, key, log_axis, sheet
from pmr.report.figures.timeline import Array, Span, Timeline
from pmr.report.numbers import unit_for
from pmr.results import RunResult

COLOUR = "#f2d6c2"  # of a band


def history(result: RunResult, what: Quantity, label: str, base: str, focus: Quantity) -> Figure:
    """A quantity over time for every simulator; below it the difference to the reference; beside it a detail.

    Parameters
    ----------
    result : RunResult
    what : callable
        Takes the quantity, (T,) in the unit `base`, from a response.
    label : str
        Name of the quantity, for the axis.
    base : str
        Unit without prefix.
    focus : callable
        The quantity whose largest difference the detail is about.
    """
    time = Timeline(result)
    return curves(time, time.signals(what), label, base, time.detail(focus))


def single_history(result: RunResult, what: Quantity, label: str, base: str) -> Figure:
    """Draw a history without differences, where these are nothing; the detail is about the largest value."""
    time = Timeline(result)
    signals = time.signals(what)
    return _panels(time, [(label, signals)], base, time.window(int(np.argmax(np.abs(signals["reduced"])))))


def curves(time: Timeline, signals: Mapping[str, Array], label: str, base: str, window: Span | None) -> Figure:
    """Draw signals (T,) that are at hand, with the detail that `window` names."""
    (differences,) = time.apart(signals)
    return _panels(time, [(label, signals), *([("Difference", differences)] if differences else [])], base, window)


def _panels(
    time: Timeline, panels: Sequence[tuple[str, Mapping[str, Array]]], base: str, window: Span | None
) -> Figure:
    """Panels below each other, each with its detail beside it; a second one is lower."""
    widths, heights = ((3.6, 1.0) if window else (1.0,)), (1.35, 1.0)[: len(panels)]
    figure, axes = sheet(
        WIDE,
        2.75 if len(panels) > 1 else 1.9,
        rows=len(panels),
        columns=len(widths),
        sharey="row",
        gridspec_kw={"width_ratios": widths, "height_ratios": heights, "wspace": 0.05, "hspace": 0.12},
    )
    for row, (name, curves) in enumerate(panels):
        time.draw(axes[row], curves, name, base, window, last=row == len(panels) - 1)
    key(figure, time.legend(list(panels[0][1])))
    return figure


def energy_parts(result: RunResult) -> Figure:
    """Strain, kinetic and external energy, one row each; beside them the differences to the reference, if seen."""
    time = Timeline(result)
    parts = ("strain", "kinetic", "external")
    of = [time.signals(attrgetter(f"energy.{part}")) for part in parts]
    differences = time.apart(*of)
    compared = any(differences)
    gaps = {"wspace": 0.24, "hspace": 0.14}
    figure, axes = sheet(WIDE, 3.9, rows=len(parts), columns=1 + compared, sharex=True, gridspec_kw=gaps)
    _parts(time, axes[:, 0], [f"{part.capitalize()} energy" for part in parts], of)
    if compared:
        _parts(time, axes[:, 1], ["Difference"] * len(parts), differences)
    key(figure, time.legend(list(of[-1])))
    return figure


def _parts(time: Timeline, axes: Sequence[Axes], labels: Sequence[str], panels: Sequence[Mapping[str, Array]]) -> None:
    """Energies (T,) in J below each other, in one unit: they are seen against each other."""
    unit = unit_for(
        max((float(np.abs(signal).max()) for panel in panels for signal in panel.values()), default=0.0), "J"
    )
    for ax, label, panel in zip(axes, labels, panels, strict=True):
        time.trace(ax, panel, unit.size, weight=0.6)
        time.frame(ax, f"{label} in {unit.name}", last=ax is axes[-1])


def residual(result: RunResult, what: Quantity, label: str) -> Figure:
    """A violation of the slider's constraint over time, logarithmic: the largest value of each interval."""
    time = Timeline(result)
    figure, axes = sheet(HALF, 2.0)
    ax = axes[0, 0]
    signals = {name: np.abs(signal) for name, signal in time.signals(what).items()}
    drawn_values = [0.0]
    for order, (name, signal) in enumerate(signals.items()):
        shown = upper_envelope(signal, bins_of(ax))
        shown = shown[signal[shown] > 0.0]
        ax.plot(time.t[shown], signal[shown], zorder=2.0 + order / 10.0, **PENS[name].line())
        drawn_values.extend(signal[shown])
    time.frame(ax, label)
    if max(drawn_values) > 0.0:
        log_axis(ax, min(value for value in drawn_values if value > 0.0), max(drawn_values))
    else:
        ax.set_ylim(0.0, 1.0)
        ax.text(0.5, 0.5, "zero at all times" if signals else "not known", transform=ax.transAxes, ha="center")
    key(figure, time.legend(list(signals)))
    return figure


def band(result: RunResult, what: Quantity, wide: Array) -> Figure:
    """Draw the error band (T,) in m of a displacement of the tip, and the difference to the full model in it."""
    time = Timeline(result)
    off = time.differences(time.signals(what))
    figure, axes = sheet(WIDE, 1.7)
    ax = axes[0, 0]
    shown = upper_envelope(wide, bins_of(ax))
    unit = unit_for(float(max(wide.max(), *(np.abs(difference).max() for difference in off.values()), 0.0)), "m")
    edge = wide[shown] / unit.size
    ax.fill_between(time.t[shown], -edge, edge, color=COLOUR, linewidth=0.0, zorder=1.0)
    time.trace(ax, {"reduced": off["reduced"]} if "reduced" in off else {}, unit.size)
    time.frame(ax, f"Difference in {unit.name}")
    names = ["reduced"] if "reduced" in off else []
    key(figure, [*time.legend(names), Patch(color=COLOUR, label="estimate")])
    return figure
