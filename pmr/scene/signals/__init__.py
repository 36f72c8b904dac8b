"""Signals over time: slider paths s(t) in m and loads F(t) in N (or N m), each with its rate.

A signal is written in a scene as a table with a ``kind`` (or as a plain number, which is constant)::

    path   = { kind = "ramp", times = [3.75, 11.25], values = [1.25, 3.75] }
    signal = { kind = "chirp", amplitude = 50.0, times = [0.0, 7.5, 15.0], frequencies = [1.0, 10.0, 1.0] }
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, Literal, cast, get_args

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, Field, SerializeAsAny, WrapValidator

from pmr.errors import environment
from pmr.scene.signals.base import Array, Chirp, Constant, Floats, Interval, SignalBase, Sine, Step, Strand
from pmr.scene.signals.knots import Ramp, SmoothRamp, Table

__all__ = [
    "Chirp", "Constant", "Ramp", "Signal", "SignalBase", "Sine", "SmoothRamp", "Step", "Sum", "Table",
]  # fmt: skip

#: Samples in which a sum of signals is searched for its extremes: per period of its fastest tone, least and most.
SAMPLES_A_PERIOD, FEWEST_SAMPLES, MOST_SAMPLES = 64, 20_000, 1_000_000
#: Number of highest crests that are searched between samples, and how often a third of the interval is cut off.
CRESTS, THIRDS = 256, 40


class Sum(SignalBase):
    """Sum of other signals."""

    kind: Literal["sum"] = Field(default="sum", description="Several signals added up")
    terms: tuple[Signal, ...] = Field(min_length=1, description="The signals")

    def value(self, t: ArrayLike) -> Array:
        return np.sum([term.value(t) for term in self.terms], axis=0)

    def rate(self, t: ArrayLike) -> Array:
        return np.sum([term.rate(t) for term in self.terms], axis=0)

    def second_rate(self, t: ArrayLike) -> Array:
        return np.sum([term.second_rate(t) for term in self.terms], axis=0)

    @property
    def strands(self) -> tuple[Strand, ...]:
        return tuple(strand for term in self.terms for strand in term.strands)

    @property
    def breaks(self) -> Floats:
        return tuple(sorted({b for term in self.terms for b in term.breaks}))

    @property
    def parts(self) -> tuple[SignalBase, ...]:
        return tuple(part for term in self.terms for part in term.parts)

    def highest_frequency(self, start: float, end: float) -> float:
        return max(term.highest_frequency(start, end) for term in self.terms)

    def bounds(self, start: float, end: float) -> Interval:
        """Return the smallest and largest value within [start, end] s, from samples and a search around their extremes.

        A tone too fast to be sampled is assumed to meet every value of the other terms: its bounds are added to theirs.
        """
        fast: list[SignalBase] = []
        slow: list[SignalBase] = []
        for part in self.parts:
            samples = SAMPLES_A_PERIOD * part.highest_frequency(start, end) * (end - start)
            (fast if samples > MOST_SAMPLES else slow).append(part)
        low, high = np.sum([part.bounds(start, end) for part in fast], axis=0) if fast else (0.0, 0.0)
        if slow:
            t = np.sort(self._samples(slow, start, end), kind="stable")
            values = _sum_of_signals(slow, t)
            high += _largest_value(lambda t: _sum_of_signals(slow, t), t, values)
            low -= _largest_value(lambda t: -_sum_of_signals(slow, t), t, -values)
        return Interval(float(low), float(high))

    def _samples(self, parts: list[SignalBase], start: float, end: float) -> Array:
        """Return sample times (S,) in s from `start` to `end`, with the breaks and the last number before each break.

        They are as dense as the highest frequency of the `parts` needs.
        """
        fastest = max(part.highest_frequency(start, end) for part in parts)
        count = 1 + min(MOST_SAMPLES, max(FEWEST_SAMPLES, int(SAMPLES_A_PERIOD * fastest * (end - start))))
        breaks = np.array([b for b in self.breaks if start <= b <= end])
        before = np.maximum(start, np.nextafter(breaks, -np.inf))
        return np.concatenate([np.linspace(start, end, count), breaks, before])


def _sum_of_signals(parts: Sequence[SignalBase], t: Array) -> Array:
    """Return the sum of the signals at the times t (S,) in s."""
    return np.asarray(np.sum([part.value(t) for part in parts], axis=0))


def _largest_value(f: Callable[[Array], Array], t: Array, values: Array) -> float:
    """Return the largest value of a function f, from its `values` (S,) at ascending t (S,) and near their crests.

    The interval around each of the highest `CRESTS` crests is searched by thirds.
    """
    before, at, after = values[:-2], values[1:-1], values[2:]
    crests = np.flatnonzero((at >= before) & (at >= after))
    bend = np.minimum(before[crests] - 2.0 * at[crests] + after[crests], -np.finfo(float).tiny)
    heights = at[crests] - np.minimum((after[crests] - before[crests]) ** 2, bend**2) / (8.0 * bend)  # of a parabola
    crests = crests[np.argsort(heights)[-CRESTS:]]
    first, last, best = t[crests], t[crests + 2], float(values.max())
    for _ in range(THIRDS):
        third = (last - first) / 3.0
        a, b = f(first + third), f(last - third)
        best = max(best, float(a.max(initial=best)), float(b.max(initial=best)))
        first, last = np.where(a < b, first + third, first), np.where(a < b, last, last - third)
    return best


def _constant_from_number(data: object) -> object:
    """Return the table of a constant signal for a number; anything else unchanged."""
    if isinstance(data, (int, float)) and not isinstance(data, bool):
        return {"kind": "constant", "amount": data}
    return data


def _plugin_signal(data: object, check: Callable[[object], SignalBase]) -> SignalBase:
    """Return a signal of a kind that an installed plug-in adds, and import it; `check` validates all other kinds."""
    if not isinstance(data, dict) or data.get("kind") in (None, *_OWN):
        return check(data)
    offered = environment.plugin_objects("pmr.signals", _OWN)
    kind = offered.get(data["kind"])
    if kind is None:
        return check(data)
    if not issubclass(kind, SignalBase) or kind.model_fields["kind"].default != data["kind"]:
        raise environment.plugin_error("pmr.signals", data["kind"])
    return cast(SignalBase, kind.model_validate(data))


_Kinds = Constant | Ramp | SmoothRamp | Table | Step | Sine | Chirp | Sum
_OWN: frozenset[str] = frozenset(kind.model_fields["kind"].default for kind in get_args(_Kinds))
Signal = Annotated[
    SerializeAsAny[_Kinds],
    Field(discriminator="kind"),
    WrapValidator(_plugin_signal),
    BeforeValidator(_constant_from_number),
]
Sum.model_rebuild()
