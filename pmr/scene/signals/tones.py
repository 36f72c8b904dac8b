"""Signals that oscillate."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, model_validator

from pmr.scene.signals.base import Array, Floats, Hertz, Radians, Real, Seconds, SignalBase


class Sine(SignalBase):
    """offset + amplitude sin(2 pi frequency t + phase); frequency in Hz, phase in rad."""

    kind: Literal["sine"] = Field(default="sine", description="An oscillation of one frequency")
    amplitude: Real = Field(description="Half of the way from least to largest")
    frequency: Hertz = Field(ge=0.0, description="Its frequency")
    phase: Radians = Field(default=0.0, description="Angle at t = 0")
    offset: Real = Field(default=0.0, description="Mean value")

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

    kind: Literal["chirp"] = Field(default="chirp", description="An oscillation whose frequency changes")
    amplitude: Real = Field(description="Half of the way from least to largest")
    times: tuple[Seconds, ...] = Field(min_length=2, description="Increasing times")
    frequencies: tuple[Hertz, ...] = Field(min_length=2, description="At these times, in straight lines between them")
    phase: Radians = Field(default=0.0, description="Angle at the first time")

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


def _extremes(amplitude: float, first: float, last: float) -> tuple[float, float]:
    """Smallest and largest amplitude sin(angle) for angles in rad that grow from `first` to `last`."""
    values = [amplitude * np.sin(first), amplitude * np.sin(last)]
    for crest, value in ((0.25, amplitude), (0.75, -amplitude)):
        if np.floor(last / (2.0 * np.pi) - crest) > np.floor(first / (2.0 * np.pi) - crest):
            values.append(value)
    return float(min(values)), float(max(values))
