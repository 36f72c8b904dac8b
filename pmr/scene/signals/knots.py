"""Signals through values at given times: ramps, and tables read from files."""

from __future__ import annotations

from functools import cached_property
from os.path import isfile
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import ConfigDict, Field, field_validator, model_validator
from scipy.interpolate import Akima1DInterpolator, PPoly

from pmr.errors.text import missing_file_reason
from pmr.scene.keys import Schema
from pmr.scene.signals.base import Array, Floats, Interval, Seconds, SignalBase, Strand

#: Least distance between knots in s, which is also the shortest allowed time step; closer knots overflow.
CLOSEST = 1e-12


class _Curve:
    """A piecewise polynomial through knots with two derivatives, constant before the first and after the last knot.

    It is made once for a signal, as a simulator may evaluate it step by step.  Two curves are equal only if they are
    the same object, so that two equal signals stay equal once one of them has been evaluated.
    """

    def __init__(self, coefficients: Array, times: Floats, values: Floats) -> None:
        """Make a curve of `coefficients` (p, knots - 1), highest power first, of the time since each knot."""
        held = np.zeros((len(coefficients), 2))
        held[-1] = values[0], values[-1]
        c = np.column_stack([held[:, 0], coefficients, held[:, 1]])
        curve = PPoly(c, np.array([times[0] - 1.0, *times, times[-1] + 1.0]))
        self.derivatives = curve, curve.derivative(), curve.derivative(2)


class _Knots(SignalBase):
    """Values at increasing times, constant before the first and after the last; straight lines in between."""

    times: tuple[Seconds, ...] = Field(min_length=2, description="Increasing times")
    values: Floats = Field(min_length=2, description="Values at these times")

    @field_validator("times")
    @classmethod
    def _check_times(cls, times: Floats) -> Floats:
        """Refuse times that do not increase by at least `CLOSEST`."""
        if not np.all(np.diff(times) >= CLOSEST):
            raise ValueError(f"times must increase, by at least {CLOSEST:g} s")
        return times

    @model_validator(mode="after")
    def _check_lengths(self) -> _Knots:
        """Refuse unequal numbers of times and values."""
        if len(self.times) != len(self.values):
            raise ValueError(f"{len(self.times)} times but {len(self.values)} values; give as many of each")
        return self

    @property
    def breaks(self) -> Floats:
        return self.times

    @property
    def _rises(self) -> tuple[Array, Array]:
        """Durations in s of the intervals between knots, and increases of the value in these intervals."""
        return np.diff(self.times), np.diff(self.values)

    def _coefficients(self) -> Array:
        """Return the coefficients of the polynomials between knots, in the order of `_Curve`."""
        duration, rise = self._rises
        return np.array([rise / duration, self.values[:-1]])

    @cached_property
    def _curve(self) -> _Curve:
        """Curve through the knots with its derivatives."""
        return _Curve(self._coefficients(), self.times, self.values)

    def value(self, t: ArrayLike) -> Array:
        return self._curve.derivatives[0](t)

    @property
    def strands(self) -> tuple[Strand, ...]:
        curve = self._curve.derivatives[0]
        return (Strand(curve.x[:-1], curve.c.T),)

    def bounds(self, start: float, end: float) -> Interval:
        """Return the smallest and largest value within [start, end] s; the signal is monotonic between knots."""
        inside = [value for t, value in zip(self.times, self.values, strict=True) if start <= t <= end]
        values = [*self.value([start, end]), *inside]
        return Interval(float(min(values)), float(max(values)))

    def rate(self, t: ArrayLike) -> Array:
        return self._curve.derivatives[1](t)

    def second_rate(self, t: ArrayLike) -> Array:
        return self._curve.derivatives[2](t)


class Ramp(_Knots):
    """Straight lines between the knots."""

    kind: Literal["ramp"] = Field(default="ramp", description="Straight lines between values")


#: Coefficients of transitions from 0 to 1 by their degree, highest power first.
TRANSITIONS = {5: (6.0, -15.0, 10.0, 0.0, 0.0, 0.0), 9: (70.0, -315.0, 540.0, -420.0, 126.0, 0.0, 0.0, 0.0, 0.0, 0.0)}


class SmoothRamp(_Knots):
    """Smooth transitions between the knots, 10 x^3 - 15 x^4 + 6 x^5: rate and acceleration vanish at each knot.

    With the degree 9, 126 x^5 - 420 x^6 + 540 x^7 - 315 x^8 + 70 x^9, the next two rates vanish there as well.
    """

    kind: Literal["smooth_ramp"] = Field(default="smooth_ramp", description="Smooth transitions between values")
    degree: Literal[5, 9] = Field(
        default=5, description="Degree of the polynomials: 9 has smoother ends and a higher speed in between"
    )

    def _coefficients(self) -> Array:
        """Return the coefficients of the transitions between knots, in the order of `_Curve`."""
        duration, rise = self._rises
        transition = np.array(TRANSITIONS[self.degree])
        coefficients = transition[:, None] * rise / duration ** np.arange(len(transition) - 1, -1, -1)[:, None]
        coefficients[-1] = self.values[:-1]
        return coefficients


def _allow_file(schema: Schema) -> None:
    """Allow in a JSON schema, which is changed in place, a file instead of times and values."""
    about = "CSV file with two columns, time in s and value, in place of times and values"
    schema["properties"]["file"] = {"type": "string", "format": "path", "description": about, "default": None}
    schema["required"] = []
    schema["anyOf"] = [{"required": ["times", "values"]}, {"required": ["file"]}]


class Table(_Knots):
    """Knots read from a CSV file with two columns (time in s, value), or given inline; Akima interpolation.

    With ``interpolation = "linear"`` straight lines are drawn instead.  The scene's hash depends on the file's content,
    not on its name.
    """

    model_config = ConfigDict(json_schema_extra=_allow_file)

    kind: Literal["table"] = Field(default="table", description="A curve through values, from a file or given here")
    interpolation: Literal["akima", "linear"] = Field(default="akima", description="How values are connected")

    @model_validator(mode="before")
    @classmethod
    def _read(cls, data: object) -> object:
        """Read times and values from a table's file; raises ValueError if it is not two columns of numbers."""
        if not (isinstance(data, dict) and "file" in data):
            return data
        content = dict(data)
        if "times" in content or "values" in content:
            raise ValueError("give either file or times and values")
        path = Path(str(content.pop("file")))
        if not isfile(path):
            raise ValueError(f"{missing_file_reason(path)}: {path}")
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
        return {**content, "times": columns[:, 0].tolist(), "values": columns[:, 1].tolist()}

    @property
    def _is_straight(self) -> bool:
        """Whether the values are joined by straight lines."""
        return self.interpolation == "linear" or len(self.times) == 2

    def _coefficients(self) -> Array:
        """Return the coefficients of Akima's curve or of straight lines between knots, in the order of `_Curve`."""
        if self._is_straight:
            return super()._coefficients()
        return np.asarray(Akima1DInterpolator(self.times, self.values).c)

    def bounds(self, start: float, end: float) -> Interval:
        low, high = super().bounds(start, end)
        if self._is_straight:
            return Interval(low, high)
        turns = self._curve.derivatives[1].roots(extrapolate=False)
        values = self.value(turns[np.isfinite(turns) & (turns >= start) & (turns <= end)])
        return Interval(float(min(low, values.min(initial=low))), float(max(high, values.max(initial=high))))
