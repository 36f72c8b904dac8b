r"""What signals do between the steps of a simulation, which no simulator sees.

A tone of frequency f sampled with the step h looks like one of :math:`|f - k / h|` with the whole number k that makes
this smallest (Nyquist, Shannon); below 1 / (2 h) that is f itself, and between two samples it rises by up to
:math:`A (1 - \cos \pi f h)` beyond both.  Knots and jumps are looked at one by one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from pmr.errors.text import rounded, rounded_down
from pmr.scene.signals import SignalBase, Table
from pmr.simulation.stepping import TimeStepping

#: Share of its own range by which a signal may leave, between two steps, what it is at these.
UNSEEN = 0.05
#: Steps a period from which on a tone keeps to that: (1 - cos(pi / n)) / 2 < `UNSEEN`.
STEPS_A_PERIOD = 7


def unseen(signals: Sequence[tuple[str, SignalBase]], stepping: TimeStepping) -> list[str]:
    """Lines that say what of each named signal is lost between the steps; empty where nothing is."""
    return [f"{name}: {what}" for name, signal in signals for what in _lost(signal, stepping)]


def overshoots(signals: Sequence[tuple[str, SignalBase]], stepping: TimeStepping) -> list[str]:
    """Tables whose curve leaves what they hold by more than `UNSEEN` of its range; a line each."""
    return [f"{name}: {what}" for name, signal in signals for part in signal.parts for what in _beyond(part, stepping)]


def is_aliased(signal: SignalBase, stepping: TimeStepping) -> bool:
    """Whether the signal has a tone that looks like a slower one at the steps."""
    return 2.0 * signal.highest_frequency(0.0, stepping.end) * stepping.step >= 1.0


def _lost(signal: SignalBase, stepping: TimeStepping) -> Iterator[str]:
    h = stepping.step
    for part in signal.parts:
        f = part.highest_frequency(0.0, stepping.end)
        if f * h >= 0.5:
            apparent = abs(f - round(f * h) / h)
            at_rest = "stands still" if apparent < 1.0 / stepping.end else f"looks like {apparent:.4g} Hz"
            yield f"{f:.6g} Hz {at_rest} at steps of {h:.4g} s; {_fine_enough(f)}"
        elif (1.0 - np.cos(np.pi * f * h)) / 2.0 > UNSEEN:
            yield f"{f:.6g} Hz has {1.0 / (f * h):.2g} steps of {h:.4g} s a period; {_fine_enough(f)}"
    share, at = _overshoot(signal, stepping)
    if share > UNSEEN:
        yield (
            f"what it does about t = {at:.6g} s passes between two steps of {h:.4g} s, "
            f"{rounded(100.0 * share)} % of its whole range; smaller steps see it"
        )


def _beyond(part: SignalBase, stepping: TimeStepping) -> Iterator[str]:
    if not isinstance(part, Table):
        return
    knots = [0.0, *(t for t in part.times if 0.0 < t < stepping.end), stepping.end]
    held, (low, high) = part.value(knots), part.bounds(0.0, stepping.end)
    least, most = float(held.min()), float(held.max())
    beyond = max(least - low, high - most)
    if beyond > UNSEEN * (most - least):
        yield (
            f"the curve through its table ({part.interpolation}) goes from {low:.6g} to {high:.6g}, "
            f"{rounded(100.0 * beyond / (most - least))} % of the table's range beyond it; interpolation = "
            "'linear', or more rows where it turns, keep to the table"
        )


def _fine_enough(f: float) -> str:
    return f"steps of {rounded_down(1.0 / (STEPS_A_PERIOD * f))} s or less follow it"


def _overshoot(signal: SignalBase, stepping: TimeStepping) -> tuple[float, float]:
    """By how much of its range a signal leaves, at its breaks, what the steps around them see; and when, in s."""
    steps, h, breaks = stepping.steps, stepping.step, np.array(signal.breaks)
    breaks = breaks[(breaks > 0.0) & (breaks < stepping.end)]
    low, high = signal.bounds(0.0, stepping.end)
    if not len(breaks) or high <= low:
        return 0.0, 0.0
    x = breaks / h
    first, last = np.ceil(x - 1e-9) - 1.0, np.floor(x + 1e-9) + 1.0  # a step on a break has one on either side
    around = signal.value(h * np.clip([first, np.clip(np.round(x), first, last), last], 0, steps))
    at_breaks = np.stack([signal.value(breaks), signal.value(np.nextafter(breaks, -np.inf))])
    beyond = np.maximum(at_breaks - around.max(axis=0), around.min(axis=0) - at_breaks).max(axis=0)
    worst = int(np.argmax(beyond))
    return float(max(beyond[worst], 0.0) / (high - low)), float(breaks[worst])
