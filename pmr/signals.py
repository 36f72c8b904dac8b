"""Signals over time: slider paths s(t) in m and loads F(t) in N (or N m), each with its rate.

A signal is written in a scene as a table with a ``kind`` (or as a plain number, which is constant)::

    path   = { kind = "ramp", times = [3.75, 11.25], values = [1.25, 3.75] }
    signal = { kind = "chirp", amplitude = 50.0, times = [0.0, 7.5, 15.0], frequencies = [1.0, 10.0, 1.0] }
"""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, field_validator, model_validator
from scipy.interpolate import Akima1DInterpolator

Array = NDArray[np.float64]
Real = Annotated[float, Field(strict=True)]
Floats = tuple[Real, ...]


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


class Constant(SignalBase):
    """The same value at all times."""

    kind: Literal["constant"] = "constant"
    amount: Real

    def value(self, t: ArrayLike) -> Array:
        return np.full(np.shape(t), self.amount)

    def rate(self, t: ArrayLike) -> Array:
        return np.zeros(np.shape(t))


class _Knots(SignalBase):
    """Values given at increasing times, held before the first and after the last."""

    times: Floats = Field(min_length=2)
    values: Floats = Field(min_length=2)

    @field_validator("times")
    @classmethod
    def _increasing(cls, times: Floats) -> Floats:
        if np.any(np.diff(times) <= 0.0):
            raise ValueError("times must increase")
        return times

    @model_validator(mode="after")
    def _same_length(self) -> _Knots:
        if len(self.times) != len(self.values):
            raise ValueError(f"{len(self.times)} times but {len(self.values)} values; give as many of each")
        return self

    @property
    def breaks(self) -> Floats:
        return self.times

    def _interval(self, t: ArrayLike) -> tuple[Array, NDArray[np.intp], Array, Array, Array]:
        """Local coordinate in [0, 1], interval, its duration and rise, and whether t lies within the knots."""
        t = np.asarray(t, dtype=float)
        knots, values = np.array(self.times), np.array(self.values)
        i = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2)
        duration = np.diff(knots)[i]
        x = np.clip((t - knots[i]) / duration, 0.0, 1.0)
        inside = (t >= knots[0]) & (t < knots[-1])
        return x, i, duration, np.diff(values)[i], inside


class Ramp(_Knots):
    """Straight lines between the knots."""

    kind: Literal["ramp"] = "ramp"

    def value(self, t: ArrayLike) -> Array:
        return np.interp(np.asarray(t, dtype=float), self.times, self.values)

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
        if not path.is_file():
            raise ValueError(f"no such file: {path}")
        lines = [line for line in path.read_text().splitlines() if line.partition("#")[0].strip()]
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
        if np.any(np.diff(columns[:, 0]) <= 0.0):
            raise ValueError(f"{path}: times must increase")
        return {**given, "times": columns[:, 0].tolist(), "values": columns[:, 1].tolist()}

    def _held(self, t: ArrayLike) -> Array:
        return np.clip(np.asarray(t, dtype=float), self.times[0], self.times[-1])

    def value(self, t: ArrayLike) -> Array:
        if self.interpolation == "linear" or len(self.times) == 2:
            return np.interp(np.asarray(t, dtype=float), self.times, self.values)
        return np.asarray(Akima1DInterpolator(self.times, self.values)(self._held(t)), dtype=float)

    def rate(self, t: ArrayLike) -> Array:
        _, _, duration, rise, inside = self._interval(t)
        if self.interpolation == "linear" or len(self.times) == 2:
            return np.where(inside, rise / duration, 0.0)
        slope = Akima1DInterpolator(self.times, self.values).derivative()(self._held(t))
        return np.where(inside, slope, 0.0)


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


def bounds(signal: SignalBase, start: float, end: float, samples: int = 20_001) -> tuple[float, float]:
    """Smallest and largest value within [start, end], sampled and taken at every break."""
    t = np.concatenate([np.linspace(start, end, samples), [b for b in signal.breaks if start <= b <= end]])
    values = signal.value(t)
    return float(values.min()), float(values.max())
