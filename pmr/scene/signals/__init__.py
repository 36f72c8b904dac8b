"""Signals over time: slider paths s(t) in m and loads F(t) in N (or N m), each with its rate.

A signal is written in a scene as a table with a ``kind`` (or as a plain number, which is constant)::

    path   = { kind = "ramp", times = [3.75, 11.25], values = [1.25, 3.75] }
    signal = { kind = "chirp", amplitude = 50.0, times = [0.0, 7.5, 15.0], frequencies = [1.0, 10.0, 1.0] }
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from os.path import isfile
from pathlib import Path
from typing import Annotated, Literal, cast, get_args

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, ConfigDict, Field, SerializeAsAny, WrapValidator, field_validator, model_validator
from scipy.interpolate import Akima1DInterpolator, PPoly

from pmr.errors import environment, missing_file_reason
from pmr.scene.keys import Schema
from pmr.scene.signals.base import Array, Chirp, Constant, Floats, Interval, Seconds, SignalBase, Sine, Step, Strand

#: Least distance between knots in s, which is also the shortest allowed time step; closer knots overflow.
CLOSEST = 1e-12


class _Knots(SignalBase):
    """Values at increasing times, constant before the first and after the last; straight lines in between."""

    times: tuple[Seconds, ...] = Field(min_length=2, description="Increasing times")
    values: Floats = Field(min_length=2, description="Values at these times")

    @field_validator("times")
    @classmethod
    def _check_times(cls, times: Floats) -> Floats:
        """Refuse times (k,) in s that do not increase by at least `CLOSEST`."""
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
    def _rises(self) -> Array:
        """Durations in s of the k intervals between knots, and increases of the value in these intervals, (2, k)."""
        return np.diff([self.times, self.values])

    def _coefficients(self) -> Array:
        """Return the coefficients (p, k) of the polynomials in k intervals between knots, highest of p powers first.

        Their variable is the time in s since the first knot of the interval.
        """
        duration, rise = self._rises
        return np.array([rise / duration, self.values[:-1]])

    @cached_property
    def strands(self) -> tuple[Strand, ...]:
        """Polynomial between each two knots, constant before the first and after the last one; computed once."""
        between = self._coefficients()
        held = np.zeros((len(between), 2))
        held[-1] = self.values[0], self.values[-1]
        polynomials = np.column_stack([held[:, 0], between, held[:, 1]]).T
        return (Strand(np.array([self.times[0] - 1.0, *self.times]), polynomials),)

    def bounds(self, start: float, end: float) -> Interval:
        """Return the smallest and largest value within [start, end] s; the signal is monotonic between knots."""
        inside = [value for t, value in zip(self.times, self.values, strict=True) if start <= t <= end]
        values = [*self.value([start, end]), *inside]
        return Interval(float(min(values)), float(max(values)))


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
        """Coefficients (degree + 1, knots - 1) of the polynomial between each two knots, highest power first.

        The variable is the time in s since the first of the two knots.
        """
        duration, rise = self._rises
        transition = np.array(TRANSITIONS[self.degree])
        coefficients = transition[:, None] * rise / duration ** np.arange(len(transition) - 1, -1, -1)[:, None]
        coefficients[-1] = self.values[:-1]
        return coefficients


def _allow_file(schema: Schema) -> None:
    """Change the JSON schema of a table of values in place: a key ``file`` may replace ``times`` and ``values``."""
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
        """Return the keys of a table with times and values in place of the name of a file, which is read.

        Keys without a file are returned unchanged.  Raises a ValueError unless the file has two columns of numbers, and
        at least two lines with ascending times; and if times or values are given beside the file.
        """
        if not (isinstance(data, dict) and "file" in data):
            return data
        content = dict(data)
        if "times" in content or "values" in content:
            raise ValueError("give either file or times and values")
        path = Path(str(content.pop("file")))
        if not isfile(path):
            raise ValueError(f"{missing_file_reason(path)}: {path}")
        try:
            text = path.read_text(encoding="utf-8-sig")
        except OSError as error:
            raise ValueError(f"{path} can't be read: {error.strerror}") from None
        except UnicodeDecodeError as error:
            raise ValueError(f"{path}: text is allowed ({error})") from None
        lines = [line.partition("#")[0] for line in text.splitlines()]
        numbers = [number for number, line in enumerate(lines, start=1) if line.strip()]
        try:
            columns = np.array([[float(cell) for cell in lines[number - 1].split(",")] for number in numbers])
        except ValueError as error:
            raise ValueError(
                f"{path}: two columns of numbers are allowed, other lines begin with # ({error})"
            ) from None
        if columns.ndim != 2 or columns.shape[1] != 2 or len(columns) < 2:
            raise ValueError(f"{path}: at least two lines of two columns are allowed: time in s, value")
        if not np.isfinite(columns).all():
            raise ValueError(f"{path}: line {numbers[int(np.argmin(np.isfinite(columns).all(axis=1)))]} is not finite")
        if not np.all(np.diff(columns[:, 0]) >= CLOSEST):
            raise ValueError(f"{path}: times must increase, by at least {CLOSEST:g} s")
        return {**content, "times": columns[:, 0].tolist(), "values": columns[:, 1].tolist()}

    @property
    def _is_straight(self) -> bool:
        """Whether the values are joined by straight lines, as the scene says or because there are only two."""
        return self.interpolation == "linear" or len(self.times) == 2

    def _coefficients(self) -> Array:
        """Return the coefficients, as those of `_Knots`, of Akima's curve or of straight lines between knots."""
        if self._is_straight:
            return super()._coefficients()
        return np.asarray(Akima1DInterpolator(self.times, self.values).c)

    def bounds(self, start: float, end: float) -> Interval:
        """Return the smallest and largest value within [start, end] s, extremes of the curve between knots included."""
        low, high = super().bounds(start, end)
        if self._is_straight:
            return Interval(low, high)
        turns = PPoly(self._coefficients(), self.times).derivative().roots(extrapolate=False)
        values = self.value(turns[np.isfinite(turns) & (turns >= start) & (turns <= end)])
        return Interval(float(min(low, values.min(initial=low))), float(max(high, values.max(initial=high))))


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
            # sample times, with the breaks and the last number before each break
            fastest = max(part.highest_frequency(start, end) for part in slow)
            count = 1 + min(MOST_SAMPLES, max(FEWEST_SAMPLES, int(SAMPLES_A_PERIOD * fastest * (end - start))))
            breaks = np.array([b for b in self.breaks if start <= b <= end])
            before = np.maximum(start, np.nextafter(breaks, -np.inf))
            t = np.sort(np.concatenate([np.linspace(start, end, count), breaks, before]), kind="stable")
            values = _sum_of_signals(slow, t)
            high += _largest_value(lambda t: _sum_of_signals(slow, t), t, values)
            low -= _largest_value(lambda t: -_sum_of_signals(slow, t), t, -values)
        return Interval(float(low), float(high))


def _sum_of_signals(parts: Sequence[SignalBase], t: Array) -> Array:
    """Return the sum of the signals `parts` at the times t (S,) in s."""
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
    """Return the signal of a table, a number or the like, also if an installed plug-in adds the kind of the signal.

    The plug-in is imported only for a kind that pmr itself lacks.  `check` validates all other data.  Raises an
    InputError for a plug-in that is no signal of this kind.
    """
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
