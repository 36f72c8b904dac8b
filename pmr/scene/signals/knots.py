"""Signals through values given at times: ramps, and tables read from files."""

from __future__ import annotations

from functools import cached_property
from os.path import isfile
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import ConfigDict, Field, field_validator, model_validator
from scipy.interpolate import Akima1DInterpolator, PPoly

from pmr.scene.signals.base import Array, Floats, Seconds, SignalBase

#: s, between knots; the shortest step that is allowed.  Slopes between closer ones overflow.
CLOSEST = 1e-12


class _KnotArrays:
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
    """Values given at increasing times, held before the first and after the last; straight lines in between."""

    times: tuple[Seconds, ...] = Field(min_length=2, description="Increasing times")
    values: Floats = Field(min_length=2, description="Values at these times")

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
    def _cached(self) -> _KnotArrays:
        return _KnotArrays(self.times, self.values)

    def _interval(self, t: ArrayLike) -> tuple[Array, NDArray[np.intp], Array, Array, Array]:
        """Local coordinate in [0, 1], interval, its duration and rise, and whether t lies within the knots."""
        t = np.asarray(t, dtype=float)
        knots, values = self._cached.arrays
        only = np.zeros((), np.intp)  # of two knots, where nothing has to be sought
        i = only if len(knots) == 2 else np.clip(np.searchsorted(knots, t, side="right") - 1, 0, len(knots) - 2)
        duration = np.diff(knots)[i]
        x = np.clip((t - knots[i]) / duration, 0.0, 1.0)
        inside = (t >= knots[0]) & (t < knots[-1])
        return x, i, duration, np.diff(values)[i], inside

    def value(self, t: ArrayLike) -> Array:
        return np.interp(np.asarray(t, dtype=float), *self._cached.arrays)

    def rate(self, t: ArrayLike) -> Array:
        _, _, duration, rise, inside = self._interval(t)
        return np.where(inside, rise / duration, 0.0)

    def second_rate(self, t: ArrayLike) -> Array:
        return np.zeros(np.shape(t))


class Ramp(_Knots):
    """Straight lines between the knots."""

    kind: Literal["ramp"] = Field(default="ramp", description="Straight lines between values")


#: Of transitions from 0 to 1 by their degree: coefficients, highest power first.
TRANSITIONS = {
    5: (6.0, -15.0, 10.0, 0.0, 0.0, 0.0),
    9: (70.0, -315.0, 540.0, -420.0, 126.0, 0.0, 0.0, 0.0, 0.0, 0.0),
}
#: Times that are evaluated at once: what that takes fits a processor's cache.
PART = 8192


class SmoothRamp(_Knots):
    """Smooth transitions between the knots, 10 x^3 - 15 x^4 + 6 x^5: rate and acceleration vanish at each knot.

    Of degree 9, 126 x^5 - 420 x^6 + 540 x^7 - 315 x^8 + 70 x^9, so do the next two rates.
    """

    kind: Literal["smooth_ramp"] = Field(default="smooth_ramp", description="Smooth transitions between values")
    degree: Literal[5, 9] = Field(
        default=5,
        description="Degree of the polynomials: 9 has smoother ends and a higher speed in between",
    )

    def _transition(self, t: ArrayLike, derivative: int) -> Array:
        """Of the transition at t, per s to the power of the `derivative`; 0 outside the knots but for the value."""
        t = np.asarray(t, dtype=float)
        if t.size > PART:
            parts = np.array_split(t.ravel(), -(-t.size // PART))
            return np.concatenate([self._transition(part, derivative) for part in parts]).reshape(t.shape)
        x, i, duration, rise, inside = self._interval(t)
        first, *others = np.polyder(TRANSITIONS[self.degree], derivative)
        found = np.full(x.shape, first)
        for coefficient in others:  # in place: memory takes longer than the sums
            found *= x
            found += coefficient
        found *= rise / duration**derivative
        return np.asarray(self._cached.arrays[1][i] + found if derivative == 0 else np.where(inside, found, 0.0))

    def value(self, t: ArrayLike) -> Array:
        return self._transition(t, 0)

    def rate(self, t: ArrayLike) -> Array:
        return self._transition(t, 1)

    def second_rate(self, t: ArrayLike) -> Array:
        return self._transition(t, 2)


def _or_file(schema: dict[str, Any]) -> None:
    """A file may stand in the place of times and values."""
    about = "CSV file with two columns, time in s and value, in place of times and values"
    schema["properties"]["file"] = {"type": "string", "format": "path", "description": about, "default": None}
    schema["required"] = []
    schema["anyOf"] = [{"required": ["times", "values"]}, {"required": ["file"]}]


class Table(_Knots):
    """Knots read from a CSV file with two columns (time in s, value), or given inline; Akima interpolation.

    With ``interpolation = "linear"`` straight lines are drawn instead.  The file's content, not its name, counts for
    the scene's hash.
    """

    model_config = ConfigDict(json_schema_extra=_or_file)

    kind: Literal["table"] = Field(default="table", description="A curve through values, from a file or given here")
    interpolation: Literal["akima", "linear"] = Field(default="akima", description="How values are connected")

    @model_validator(mode="before")
    @classmethod
    def _read(cls, data: Any) -> Any:
        if not (isinstance(data, dict) and "file" in data):
            return data
        given = dict(data)
        if "times" in given or "values" in given:
            raise ValueError("give either file or times and values")
        path = Path(str(given.pop("file")))
        if not isfile(path):
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

    @property
    def _is_straight(self) -> bool:
        return self.interpolation == "linear" or len(self.times) == 2

    def _held(self, t: ArrayLike) -> Array:
        return np.clip(np.asarray(t, dtype=float), self.times[0], self.times[-1])

    def value(self, t: ArrayLike) -> Array:
        if self._is_straight:
            return super().value(t)
        return np.asarray(self._cached.akima(self._held(t)), dtype=float)

    def rate(self, t: ArrayLike) -> Array:
        if self._is_straight:
            return super().rate(t)
        return np.where(self._interval(t)[-1], self._cached.akima_rate(self._held(t)), 0.0)

    def second_rate(self, t: ArrayLike) -> Array:
        if self._is_straight:
            return super().second_rate(t)
        return np.where(self._interval(t)[-1], self._cached.akima_rate(self._held(t), 1), 0.0)

    def bounds(self, start: float, end: float) -> tuple[float, float]:
        low, high = super().bounds(start, end)
        if self._is_straight:
            return low, high
        turns = self._cached.akima_rate.roots(extrapolate=False)
        values = self.value(turns[np.isfinite(turns) & (turns >= start) & (turns <= end)])
        return float(min(low, values.min(initial=low))), float(max(high, values.max(initial=high)))
