"""What a user should know about the time step, in words and figures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pmr.compare.step_error import LIMIT, StepError
from pmr.errors.text import rounded
from pmr.scene.signals import SignalBase
from pmr.simulate.stepping import TimeStepping

Array = NDArray[np.float64]
_FIGURES = ("beam", "tip", "largest", "finest", "settled", "by", "enough", "band", "seconds")


def summary(found: StepError | None, reason: str | None = None) -> dict[str, float | str | bool | None]:
    """What summary.json holds under ``step``: the attributes of `StepError`, ``limit`` and ``reason``.

    Without a figure all are None, and ``reason`` says why.
    """
    figures = dict.fromkeys(_FIGURES) if found is None else {name: getattr(found, name) for name in _FIGURES}
    return figures | {"limit": LIMIT, "reason": reason}


def warnings(
    found: StepError, stepping: TimeStepping, signals: Sequence[tuple[str, SignalBase]], omega: Array
) -> list[str]:
    """A line where the step's error exceeds `LIMIT`, or can't be told; signals with their names.

    `omega` (S, f) rad/s are natural frequencies with the sliders at S places of the path, ascending.
    """
    if found.beam <= LIMIT and found.settled:
        return []
    h = stepping.step
    size = f"{_percent(found.beam)} along the beam, {_percent(found.tip)} at the tip"
    if found.by == "mean":
        size += " in the mean (motions part after an impact, so they can't be compared instant by instant)"
    judged = "is too coarse: its own error" if found.beam > LIMIT else "has an error that is not settled: it"
    at_least = "" if found.settled else "at least "
    parts = [f"the time step of {h:.4g} s {judged} is {at_least}{size}, as steps of {found.finest:.2g} s show"]
    parts += [_load(name, signal, stepping) for name, signal in signals if signal.highest_frequency(0.0, stepping.end)]
    parts.append(_motion(found.band, h, omega))
    if not found.settled:
        parts.append(f"even steps of {found.finest:.2g} s don't settle it")
    elif found.enough is not None:
        parts.append(f"steps of {found.enough:.2g} s bring the error below {100.0 * LIMIT:g} %")
    return ["; ".join(parts)]


def _load(name: str, signal: SignalBase, stepping: TimeStepping) -> str:
    f = signal.highest_frequency(0.0, stepping.end)
    return f"{name} goes up to {f:.4g} Hz, {_steps(f, stepping.step)}"


def _motion(band: float, h: float, omega: Array) -> str:
    """How far the motion's band reaches, by itself and in modes."""
    known = omega[:, ~np.isnan(omega).all(axis=0)]  # some reduced models have fewer modes than are drawn
    lowest = np.sort(np.nanmin(known, axis=0)) / (2.0 * np.pi) if known.size else np.empty(0)
    said = f"the motion goes up to {band:.3g} Hz, {_steps(band, h)}"
    excited = int(np.count_nonzero(lowest <= band))
    if not excited:
        return said
    more = " or more" if excited == len(lowest) else ""
    return f"{said}; the highest mode that it excites is number {excited}{more}, {lowest[excited - 1]:.3g} Hz and above"


def _steps(frequency: float, h: float) -> str:
    return f"{rounded(1.0 / (frequency * h))} steps a period" if frequency > 0.0 else "no period"


def _percent(fraction: float) -> str:
    return f"{rounded(100.0 * fraction)} %" if fraction < 10.0 else f"{rounded(fraction)} times the motion"
