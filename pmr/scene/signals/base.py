"""Base class of all signals, and signals given by a formula: constants, steps, sines and chirps."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict, Field, SerializerFunctionWrapHandler, model_serializer, model_validator

from pmr.files.arrays import Array, Indices
from pmr.scene.keys import Usual

#: A number in the unit of the signal's path or load: m, N or N m.
Real = Annotated[float, Field(strict=True, json_schema_extra={"unit": "the unit of what it drives"})]
Seconds = Annotated[float, Field(strict=True, json_schema_extra={"unit": "s"}), Usual(0.0, 300.0, "time", "s")]
Hertz = Annotated[float, Field(strict=True, json_schema_extra={"unit": "Hz"})]
Radians = Annotated[float, Field(strict=True, json_schema_extra={"unit": "rad"}), Usual(0.0, 6.3, unit="rad")]
Floats = tuple[Real, ...]
#: Least jump of the rate that counts as a kink, as a share of the signal's range over its duration.
KINK = 1e-6
#: Difference of two values of a signal that is round-off, as a share of its largest value.
ROUND_OFF = 1e-14


class Interval(NamedTuple):
    """Smallest and largest of some numbers, such as the values of a signal or positions in m."""

    low: float
    high: float

    def union(self, other: Interval) -> Interval:
        """Return the smallest interval that contains this one and another one."""
        return Interval(min(self.low, other.low), max(self.high, other.high))


@dataclass(frozen=True, eq=False)
class Strand:
    """Curve over time in pieces p(x) + a sin(q(x)), with polynomials p and q of the time x since the piece began.

    The first piece also holds before it begins, and the last one for ever.  Let u(t) be the value of the pieces.
    Without a `spread`, the strand is u itself.  With a `spread` h > 0 it is (u'(t + h/2) - u'(t - h/2)) / h, from t = 0
    on only.  With a negative `spread` it is the second rate u''.
    """

    breaks: Array  # (k,) s: where each piece begins
    polynomials: Array  # (k, p): p, highest power first
    amplitude: float = 0.0  # a
    angles: Array = field(default_factory=lambda: np.zeros((1, 3)))  # (k or 1, 3) rad: q, highest power first
    spread: float = 0.0  # s

    def derivative(self, t: ArrayLike, order: int) -> Array:
        """Value (`order` 0), rate (1) or second rate (2) of the pieces at the times t (any shape) in s.

        The result has the shape of t.  The `spread` has no effect.
        """
        at = np.asarray(t, float)
        k = np.maximum(np.searchsorted(self.breaks, at, side="right") - 1, 0) if len(self.breaks) > 1 else 0
        x = at - self.breaks[k]
        value = _polynomial(self.polynomials, k, x, order)
        if self.amplitude:
            row = k % len(self.angles)
            q, rate, second = (_polynomial(self.angles, row, x, n) if n <= order else 0.0 for n in range(3))
            sine, cosine = np.sin(q), np.cos(q)
            value = value + self.amplitude * (sine, cosine * rate, cosine * second - sine * rate**2)[order]
        return np.asarray(value)

    def angle(self, t: float) -> float:
        """Argument q of the sine in rad at the time t in s."""
        k = max(int(np.searchsorted(self.breaks, t, side="right")) - 1, 0)
        return float(_polynomial(self.angles, k % len(self.angles), np.asarray(t - self.breaks[k]), 0))


def _polynomial(c: Array, k: Indices | int, x: Array, order: int) -> Array:
    """Derivatives, of the `order` 0 or more, of polynomials at x (any shape), in the shape of x.

    c (n, p) are the coefficients of n polynomials, highest of p powers first.  `k` is the number of the polynomial at
    each entry of x, or one number for all entries.
    """
    for _ in range(order):
        c = c[:, :-1] * np.arange(c.shape[1] - 1, 0, -1)
    value = np.zeros_like(x)
    for (
        of_power
    ) in c.T:  # one power after the other: the coefficients of all entries would take p times the memory of x
        value *= x
        value += of_power[k]
    return value


class SignalBase(BaseModel):
    """Signal over time; times in s, broadcast over arrays."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    @model_serializer(mode="wrap")
    def _dump_kind(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Return the keys of the signal with its kind, even without defaults: several kinds have the same keys."""
        return ({"kind": self.kind} if hasattr(self, "kind") else {}) | dump(self)

    def value(self, t: ArrayLike) -> Array:
        """Return the values at the times t (any shape) in s, in the shape of t."""
        return self._derivative(t, 0)

    def rate(self, t: ArrayLike) -> Array:
        """Return the time derivatives at times t (any shape) in s, in the shape of t; at a kink those just after it."""
        return self._derivative(t, 1)

    def second_rate(self, t: ArrayLike) -> Array:
        """Return the second time derivatives at times t (any shape) in s, in the shape of t.

        At a break the derivatives are those just after the break.  Raises NotImplementedError for a kind of signal that
        has none.
        """
        return self._derivative(t, 2)

    def _derivative(self, t: ArrayLike, order: int) -> Array:
        """Derivative of an order from 0 to 2, by `strands`, at the times t (any shape) in s, in the shape of t."""
        try:
            strands = self.strands
        except NotImplementedError:
            name = ("value", "rate", "second_rate")[order]
            raise NotImplementedError(f"{type(self).__name__} has neither {name} nor strands") from None
        return np.asarray(sum((strand.derivative(t, order) for strand in strands), np.zeros(np.shape(t))))

    @property
    def breaks(self) -> Floats:
        """Times in s at which the value or its rate may jump; empty unless a kind of signal overrides this property."""
        return ()

    def kinks(self, end: float) -> dict[float, float]:
        """Return by how much the rate jumps at each kink, by the kink's time in s; only times within (0, end] count.

        Jumps that are round-off, or small for the signal (`KINK`), are left out.  The result is empty without kinks.
        """
        at = np.array([b for b in self.breaks if 0.0 < b <= end])
        if not len(at):
            return {}
        low, high = self.bounds(0.0, end)
        change = self.rate(at) - self.rate(np.nextafter(at, -np.inf))
        nearest = np.diff(self.breaks).min(initial=end)  # over which round-off of the values changes the rate
        least = KINK * (high - low) / end + ROUND_OFF * max(abs(low), abs(high)) / nearest
        return {float(t): float(c) for t, c in zip(at, change, strict=True) if abs(c) > least}

    @property
    def parts(self) -> tuple[SignalBase, ...]:
        """Signals whose sum this signal is; the signal itself unless it is a sum."""
        return (self,)

    @property
    def signals(self) -> tuple[SignalBase, ...]:
        """Signals from which this one follows; empty unless it follows from others."""
        return ()

    @property
    def strands(self) -> tuple[Strand, ...]:
        """Strands whose sum is the signal; raises NotImplementedError for a signal that has none."""
        raise NotImplementedError(f"{type(self).__name__} is no sum of polynomials and sines")

    def on_steps(self, step: float) -> SignalBase:
        """Return the signal for time steps of length `step` in s: itself unless its value depends on the steps."""
        return self

    def highest_frequency(self, start: float, end: float) -> float:
        """Return the frequency in Hz of the fastest tone within [start, end] s; 0 for a signal without tones."""
        return 0.0

    def bounds(self, start: float, end: float) -> Interval:
        """Return the smallest and largest value within [start, end] s.

        This method is right for signals whose extremes are at the ends, or just before or after a break; signals of
        another kind override it.
        """
        breaks = [b for b in self.breaks if start <= b <= end]
        before = [max(start, float(np.nextafter(b, -np.inf))) for b in breaks]
        values = self.value([start, end, *breaks, *before])
        return Interval(float(values.min()), float(values.max()))


class Constant(SignalBase):
    """Signal with the same value at all times."""

    kind: Literal["constant"] = Field(default="constant", description="One value")
    amount: Real = Field(description="The value")

    @property
    def strands(self) -> tuple[Strand, ...]:
        return (Strand(np.zeros(1), np.array([[self.amount]])),)


class Step(SignalBase):
    """Signal with the value ``before`` until ``time`` (exclusive) and ``after`` from then on."""

    kind: Literal["step"] = Field(default="step", description="A step")
    time: Seconds = Field(description="Time of the step")
    before: Real = Field(default=0.0, description="Value before that time")
    after: Real = Field(description="Value from that time on")

    @property
    def strands(self) -> tuple[Strand, ...]:
        return (Strand(np.array([self.time - 1.0, self.time]), np.array([[self.before], [self.after]])),)

    @property
    def breaks(self) -> Floats:
        return (self.time,)


class Sine(SignalBase):
    """offset + amplitude sin(2 pi frequency t + phase); frequency in Hz, phase in rad."""

    kind: Literal["sine"] = Field(default="sine", description="An oscillation of one frequency")
    amplitude: Real = Field(description="Amplitude, half the distance from the smallest to the largest value")
    frequency: Hertz = Field(ge=0.0, description="Its frequency")
    phase: Radians = Field(default=0.0, description="Angle at t = 0")
    offset: Real = Field(default=0.0, description="Mean value")

    @property
    def strands(self) -> tuple[Strand, ...]:
        angles = np.array([[0.0, 2.0 * np.pi * self.frequency, self.phase]])
        return (Strand(np.zeros(1), np.array([[self.offset]]), self.amplitude, angles),)

    def highest_frequency(self, start: float, end: float) -> float:
        return self.frequency if self.amplitude else 0.0

    def bounds(self, start: float, end: float) -> Interval:
        low, high = _sine_bounds(self.strands[0], start, end)
        return Interval(self.offset + low, self.offset + high)


class Chirp(SignalBase):
    """amplitude sin(phi(t)) with phi' = 2 pi f(t), f piecewise linear through ``frequencies`` (Hz) at ``times`` (s).

    The phase phi is the exact integral of the frequency f, hence continuous where ascending and descending parts meet.
    Before the first and after the last of ``times`` f is constant.  ``phase`` (rad) is phi at the first time.
    """

    kind: Literal["chirp"] = Field(default="chirp", description="An oscillation whose frequency changes")
    amplitude: Real = Field(description="Amplitude, half the distance from the smallest to the largest value")
    times: tuple[Seconds, ...] = Field(min_length=2, description="Increasing times")
    frequencies: tuple[Hertz, ...] = Field(min_length=2, description="Frequencies at these times, linear in between")
    phase: Radians = Field(default=0.0, description="Angle at the first time")

    @model_validator(mode="after")
    def _check_frequencies(self) -> Chirp:
        """Refuse times that do not increase, negative frequencies, and another number of frequencies than of times."""
        if np.any(np.diff(self.times) <= 0.0):
            raise ValueError("times must increase")
        if len(self.times) != len(self.frequencies):
            raise ValueError(f"{len(self.times)} times but {len(self.frequencies)} frequencies; give as many of each")
        if min(self.frequencies) < 0.0:
            raise ValueError("frequencies must not be negative")
        return self

    def frequency(self, t: ArrayLike) -> Array:
        """Return the instantaneous frequency in Hz at the times t (any shape) in s, in the shape of t."""
        return np.interp(np.asarray(t, dtype=float), self.times, self.frequencies)

    @property
    def strands(self) -> tuple[Strand, ...]:
        """The chirp as one strand: a piece between each two of `times`, one before the first and one after the last."""
        knots, f = np.array(self.times), np.array(self.frequencies)
        breaks = np.array([knots[0] - 1.0, *knots])  # before the first knot the frequency is constant
        slopes = np.array([0.0, *(np.diff(f) / np.diff(knots)), 0.0])
        cycles = np.cumsum([-f[0], f[0], *(np.diff(knots) * (f[1:] + f[:-1]) / 2.0)])
        angles = np.column_stack(
            [np.pi * slopes, 2.0 * np.pi * np.array([f[0], *f]), self.phase + 2.0 * np.pi * cycles]
        )
        return (Strand(breaks, np.zeros((len(breaks), 1)), self.amplitude, angles),)

    def highest_frequency(self, start: float, end: float) -> float:
        turns = [start, end, *(t for t in self.times if start <= t <= end)]
        return float(self.frequency(turns).max()) if self.amplitude else 0.0

    def bounds(self, start: float, end: float) -> Interval:
        return _sine_bounds(self.strands[0], start, end)  # no frequency is negative

    @property
    def breaks(self) -> Floats:
        return self.times


def _sine_bounds(strand: Strand, start: float, end: float) -> Interval:
    """Return the smallest and largest value of a strand's sine within [start, end] s; its angle must not decrease."""
    amplitude, first, last = strand.amplitude, strand.angle(start), strand.angle(end)
    values = [amplitude * np.sin(first), amplitude * np.sin(last)]
    for crest, value in ((0.25, amplitude), (0.75, -amplitude)):
        if np.floor(last / (2.0 * np.pi) - crest) > np.floor(first / (2.0 * np.pi) - crest):
            values.append(value)
    return Interval(float(min(values)), float(max(values)))
