"""Signals over time: slider paths s(t) in m and loads F(t) in N (or N m), each with its rate.

A signal is written in a scene as a table with a ``kind`` (or as a plain number, which is constant)::

    path   = { kind = "ramp", times = [3.75, 11.25], values = [1.25, 3.75] }
    signal = { kind = "chirp", amplitude = 50.0, times = [0.0, 7.5, 15.0], frequencies = [1.0, 10.0, 1.0] }
"""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, field_validator, model_validator
from scipy.interpolate import Akima1DInterpolator, PPoly

from pmr.scene.tomlfiles import is_file

Array = NDArray[np.float64]
Real = Annotated[float, Field(strict=True)]
Floats = tuple[Real, ...]

#: Samples in which a sum of signals is searched for its extremes: a period of its fastest tone, at least, at most.
SAMPLES_A_PERIOD, FEWEST_SAMPLES, MOST_SAMPLES = 64, 20_000, 1_000_000


class SignalBase(BaseModel):
    """What every signal can do; times in s, broadcast over arrays."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @abstractmethod
    def value(self, t: ArrayLike) -> Array:
        """Value at the times ``t``; same shape as ``t``."""

    @abstractmethod
    def rate(self, t: ArrayLike) -> Array:
        """Time derivative at the times ``t``; at a kink the one of the interval that begins there."""

    @property
    def breaks(self) -> Floats:
        """Times in s at which the value or its rate may jump."""
        return ()

    @property
    def parts(self) -> tuple[SignalBase, ...]:
        """The signals that this one is the sum of."""
        return (self,)

    def highest_frequency(self, start: float, end: float) -> float:
        """Frequency in Hz of the fastest tone within [start, end]; 0 where the signal is no tone."""
        return 0.0

    def bounds(self, start: float, end: float) -> tuple[float, float]:
        """Smallest and largest value within [start, end].

        What holds here: a value is extreme at an end or at a break, on one side of it or the other.
        """
        breaks = [b for b in self.breaks if start <= b <= end]
        before = [max(start, float(np.nextafter(b, -np.inf))) for b in breaks]
        values = self.value([start, end, *breaks, *before])
        return float(values.min()), float(values.max())


class Constant(SignalBase):
    """The same value at all times."""

    kind: Literal["constant"] = "constant"
    amount: Real

    def value(self, t: ArrayLike) -> Array:
        return np.full(np.shape(t), self.amount)

    def rate(self, t: ArrayLike) -> Array:
        return np.zeros(np.shape(t))


#: s, between knots; the shortest step that is allowed.  Slopes between closer ones overflow.
CLOSEST = 1e-12


class _KeptKnots:
    """Knots as arrays, and the curve through them: what a simulator that asks step by step would make anew each time.

    Compared by identity, so that two signals that are equal stay so once one of them has been evaluated.
    """

    def __init__(self, times: Floats, values: Floats) -> None:
        self.arrays = np.array(times), np.array(values)

    @cached_property
    def akima(self) -> Akima1DInterpolator:
        return Akima1DInterpolator(*self.arrays)

    @cached_property
    def akima_rate(self) -> PPoly:
        return self.akima.derivative()


class _Knots(SignalBase):
    """Values given at increasing times, held before the first and after the last."""

    times: Floats = Field(min_length=2)
    values: Floats = Field(min_length=2)

    @field_validator("times")
    @classmethod
    def _increasing(cls, times: Floats) -> Floats:
        if not np.all(np.diff(times) >= CLOSEST):
            raise ValueError(f"times must increase, by at least {CLOSEST:g} s")
        return times

    @model_validator(mode="after")
    def _same_length(self) -> _Knots:
        if len(self.times) != len(self.values):
            raise ValueError(f"{len(self.times)} times but {len(self.values)} values; give as many of each")
        return self

    @property
    def breaks(self) -> Floats:
        return self.times

    @cached_property
    def _kept(self) -> _KeptKnots:
        return _KeptKnots(self.times, self.values)

    def _interval(self, t: ArrayLike) -> tuple[Array, NDArray[np.intp], Array, Array, Array]:
        """Local coordinate in [0, 1], interval, its duration and rise, and whether t lies within the knots."""
        t = np.asarray(t, dtype=float)
        knots, values = self._kept.arrays
        i = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2)
        duration = np.diff(knots)[i]
        x = np.clip((t - knots[i]) / duration, 0.0, 1.0)
        inside = (t >= knots[0]) & (t < knots[-1])
        return x, i, duration, np.diff(values)[i], inside


class Ramp(_Knots):
    """Straight lines between the knots."""

    kind: Literal["ramp"] = "ramp"

    def value(self, t: ArrayLike) -> Array:
        return np.interp(np.asarray(t, dtype=float), *self._kept.arrays)

    def rate(self, t: ArrayLike) -> Array:
        _, _, duration, rise, inside = self._interval(t)
        return np.where(inside, rise / duration, 0.0)


class SmoothRamp(_Knots):
    """Quintic transitions 10 x^3 - 15 x^4 + 6 x^5 between the knots: rate and acceleration vanish at each knot."""

    kind: Literal["smooth_ramp"] = "smooth_ramp"

    def value(self, t: ArrayLike) -> Array:
        x, i, _, rise, _ = self._interval(t)
        return np.array(self.values)[i] + rise * x**3 * (10.0 + x * (-15.0 + 6.0 * x))

    def rate(self, t: ArrayLike) -> Array:
        x, _, duration, rise, inside = self._interval(t)
        return np.where(inside, rise / duration * 30.0 * (x * (1.0 - x)) ** 2, 0.0)


class Table(_Knots):
    """Knots read from a CSV file with two columns (time in s, value), or given inline; Akima interpolation.

    With ``interpolation = "linear"`` straight lines are drawn instead.  The file's content, not its name, counts for
    the scene's hash.
    """

    kind: Literal["table"] = "table"
    interpolation: Literal["akima", "linear"] = "akima"

    @model_validator(mode="before")
    @classmethod
    def _read(cls, data: Any) -> Any:
        if not (isinstance(data, dict) and "file" in data):
            return data
        given = dict(data)
        if "times" in given or "values" in given:
            raise ValueError("give either file or times and values")
        path = Path(str(given.pop("file")))
        if not is_file(path):
            raise ValueError(f"no such file: {path}")
        try:
            text = path.read_text(encoding="utf-8")
        except OSError as error:
            raise ValueError(f"{path} can't be read: {error.strerror}") from None
        except UnicodeDecodeError as error:
            raise ValueError(f"{path}: text is allowed ({error})") from None
        lines = [line for line in text.splitlines() if line.partition("#")[0].strip()]
        try:
            columns = np.array([[float(cell) for cell in line.partition("#")[0].split(",")] for line in lines])
        except ValueError as error:
            raise ValueError(
                f"{path}: two columns of numbers are allowed, other lines begin with # ({error})"
            ) from None
        if columns.ndim != 2 or columns.shape[1] != 2 or len(columns) < 2:
            raise ValueError(f"{path}: at least two lines of two columns are allowed: time in s, value")
        if not np.isfinite(columns).all():
            raise ValueError(f"{path}: line {int(np.argmin(np.isfinite(columns).all(axis=1))) + 1} is not finite")
        if not np.all(np.diff(columns[:, 0]) >= CLOSEST):
            raise ValueError(f"{path}: times must increase, by at least {CLOSEST:g} s")
        return {**given, "times": columns[:, 0].tolist(), "values": columns[:, 1].tolist()}

    def _held(self, t: ArrayLike) -> Array:
        return np.clip(np.asarray(t, dtype=float), self.times[0], self.times[-1])

    def value(self, t: ArrayLike) -> Array:
        if self.interpolation == "linear" or len(self.times) == 2:
            return np.interp(np.asarray(t, dtype=float), *self._kept.arrays)
        return np.asarray(self._kept.akima(self._held(t)), dtype=float)

    def rate(self, t: ArrayLike) -> Array:
        _, _, duration, rise, inside = self._interval(t)
        if self.interpolation == "linear" or len(self.times) == 2:
            return np.where(inside, rise / duration, 0.0)
        slope = self._kept.akima_rate(self._held(t))
        return np.where(inside, slope, 0.0)

    def bounds(self, start: float, end: float) -> tuple[float, float]:
        low, high = super().bounds(start, end)
        if self.interpolation == "linear" or len(self.times) == 2:
            return low, high
        turns = Akima1DInterpolator(self.times, self.values).derivative().roots(extrapolate=False)
        values = self.value(turns[np.isfinite(turns) & (turns >= start) & (turns <= end)])
        return float(min(low, values.min(initial=low))), float(max(high, values.max(initial=high)))


class Step(SignalBase):
    """``before`` until ``time`` (exclusive), ``after`` from then on."""

    kind: Literal["step"] = "step"
    time: Real
    before: Real = 0.0
    after: Real

    def value(self, t: ArrayLike) -> Array:
        return np.where(np.asarray(t, dtype=float) < self.time, self.before, self.after)

    def rate(self, t: ArrayLike) -> Array:
        return np.zeros(np.shape(t))

    @property
    def breaks(self) -> Floats:
        return (self.time,)


class Sine(SignalBase):
    """offset + amplitude sin(2 pi frequency t + phase); frequency in Hz, phase in rad."""

    kind: Literal["sine"] = "sine"
    amplitude: Real
    frequency: float = Field(ge=0.0, strict=True)
    phase: Real = 0.0
    offset: Real = 0.0

    def _angle(self, t: ArrayLike) -> Array:
        return 2.0 * np.pi * self.frequency * np.asarray(t, dtype=float) + self.phase

    def value(self, t: ArrayLike) -> Array:
        return self.offset + self.amplitude * np.sin(self._angle(t))

    def rate(self, t: ArrayLike) -> Array:
        return 2.0 * np.pi * self.frequency * self.amplitude * np.cos(self._angle(t))

    def highest_frequency(self, start: float, end: float) -> float:
        return self.frequency if self.amplitude else 0.0

    def bounds(self, start: float, end: float) -> tuple[float, float]:
        low, high = _extremes(self.amplitude, *self._angle([start, end]).tolist())
        return self.offset + low, self.offset + high


class Chirp(SignalBase):
    """amplitude sin(phi(t)) with phi' = 2 pi f(t), f piecewise linear through ``frequencies`` (Hz) at ``times`` (s).

    The phase is the exact integral of f, hence continuous where ascending and descending parts meet; f is held
    outside the knots.  ``phase`` (rad) is phi at the first knot.
    """

    kind: Literal["chirp"] = "chirp"
    amplitude: Real
    times: Floats = Field(min_length=2)
    frequencies: Floats = Field(min_length=2)
    phase: Real = 0.0

    @model_validator(mode="after")
    def _knots(self) -> Chirp:
        if np.any(np.diff(self.times) <= 0.0):
            raise ValueError("times must increase")
        if len(self.times) != len(self.frequencies):
            raise ValueError(f"{len(self.times)} times but {len(self.frequencies)} frequencies; give as many of each")
        if min(self.frequencies) < 0.0:
            raise ValueError("frequencies must not be negative")
        return self

    def frequency(self, t: ArrayLike) -> Array:
        """Instantaneous frequency in Hz."""
        return np.interp(np.asarray(t, dtype=float), self.times, self.frequencies)

    def _angle(self, t: ArrayLike) -> Array:
        t = np.asarray(t, dtype=float)
        knots, f = np.array(self.times), np.array(self.frequencies)
        cycles = np.concatenate([[0.0], np.cumsum(np.diff(knots) * (f[1:] + f[:-1]) / 2.0)])
        i = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 1)
        since = np.where(t < knots[0], t - knots[0], t - knots[i])
        mean_frequency = (f[i] + self.frequency(t)) / 2.0
        return self.phase + 2.0 * np.pi * (cycles[i] + mean_frequency * since)

    def value(self, t: ArrayLike) -> Array:
        return self.amplitude * np.sin(self._angle(t))

    def rate(self, t: ArrayLike) -> Array:
        return self.amplitude * np.cos(self._angle(t)) * 2.0 * np.pi * self.frequency(t)

    def highest_frequency(self, start: float, end: float) -> float:
        turns = [start, end, *(t for t in self.times if start <= t <= end)]
        return float(self.frequency(turns).max()) if self.amplitude else 0.0

    def bounds(self, start: float, end: float) -> tuple[float, float]:
        return _extremes(self.amplitude, *self._angle([start, end]).tolist())  # no frequency is negative

    @property
    def breaks(self) -> Floats:
        return self.times


class Sum(SignalBase):
    """Sum of other signals."""

    kind: Literal["sum"] = "sum"
    terms: tuple[Signal, ...] = Field(min_length=1)

    def value(self, t: ArrayLike) -> Array:
        return np.sum([term.value(t) for term in self.terms], axis=0)

    def rate(self, t: ArrayLike) -> Array:
        return np.sum([term.rate(t) for term in self.terms], axis=0)

    @property
    def breaks(self) -> Floats:
        return tuple(sorted({b for term in self.terms for b in term.breaks}))

    @property
    def parts(self) -> tuple[SignalBase, ...]:
        return tuple(part for term in self.terms for part in term.parts)

    def highest_frequency(self, start: float, end: float) -> float:
        return max(term.highest_frequency(start, end) for term in self.terms)

    def bounds(self, start: float, end: float) -> tuple[float, float]:
        """Sampled; a tone too fast for that is taken to meet every value of the rest."""
        fast: list[SignalBase] = []
        slow: list[SignalBase] = []
        for part in self.parts:
            samples = SAMPLES_A_PERIOD * part.highest_frequency(start, end) * (end - start)
            (fast if samples > MOST_SAMPLES else slow).append(part)
        low, high = np.sum([part.bounds(start, end) for part in fast], axis=0) if fast else (0.0, 0.0)
        if slow:
            values = np.sum([part.value(self._samples(slow, start, end)) for part in slow], axis=0)
            low, high = low + values.min(), high + values.max()
        return float(low), float(high)

    def _samples(self, parts: list[SignalBase], start: float, end: float) -> Array:
        """Times (S,) in s, breaks and a moment before each of them included."""
        fastest = max(part.highest_frequency(start, end) for part in parts)
        count = 1 + min(MOST_SAMPLES, max(FEWEST_SAMPLES, int(SAMPLES_A_PERIOD * fastest * (end - start))))
        breaks = np.array([b for b in self.breaks if start <= b <= end])
        before = np.maximum(start, np.nextafter(breaks, -np.inf))
        return np.concatenate([np.linspace(start, end, count), breaks, before])


def _extremes(amplitude: float, first: float, last: float) -> tuple[float, float]:
    """Smallest and largest amplitude sin(angle) for angles in rad that grow from `first` to `last`."""
    values = [amplitude * np.sin(first), amplitude * np.sin(last)]
    for crest, value in ((0.25, amplitude), (0.75, -amplitude)):
        if np.floor(last / (2.0 * np.pi) - crest) > np.floor(first / (2.0 * np.pi) - crest):
            values.append(value)
    return float(min(values)), float(max(values))


def _number_is_constant(data: Any) -> Any:
    if isinstance(data, (int, float)) and not isinstance(data, bool):
        return {"kind": "constant", "amount": data}
    return data


Signal = Annotated[
    Constant | Ramp | SmoothRamp | Table | Step | Sine | Chirp | Sum,
    Field(discriminator="kind"),
    BeforeValidator(_number_is_constant),
]
Sum.model_rebuild()


def bounds(signal: SignalBase, start: float, end: float) -> tuple[float, float]:
    """Smallest and largest value within [start, end], between all time steps too."""
    return signal.bounds(start, end)
