"""Signals without pmr: the source text of these is copied into scripts.

A signal is a function of one time t in s and takes the fields of the signal of the same kind in `pmr.scene.signals`.
"""

# mypy: allow-untyped-defs, allow-untyped-calls
from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.interpolate import Akima1DInterpolator


def ramp(t, times, values):
    """Straight lines between the knots, held before the first and after the last."""
    return np.interp(t, times, values)


def smooth_ramp(t, times, values, degree):
    """Smooth transitions between the knots: rate and acceleration vanish at each of them."""
    k = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
    x = np.clip((t - times[k]) / (times[k + 1] - times[k]), 0.0, 1.0)
    smooth = x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
    if degree == 9:
        smooth = x**5 * (126.0 - 420.0 * x + 540.0 * x**2 - 315.0 * x**3 + 70.0 * x**4)
    return values[k] + (values[k + 1] - values[k]) * smooth


@lru_cache
def akima(times, values):
    """Akima's interpolation, kept for the next call."""
    return Akima1DInterpolator(times, values)


def table(t, times, values, interpolation):
    """Measured values between the knots, held before the first and after the last."""
    if interpolation == "linear" or len(times) == 2:
        return np.interp(t, times, values)
    return akima(times, values)(np.clip(t, times[0], times[-1]))


def step(t, time, before, after):
    """A jump at `time`."""
    return before if t < time else after


def sine(t, amplitude, frequency, phase, offset):
    """Frequency in Hz, phase in rad."""
    return offset + amplitude * np.sin(2.0 * np.pi * frequency * t + phase)


def chirp(t, amplitude, times, frequencies, phase):
    """A sine whose frequency (Hz) runs linearly from knot to knot; its phase is continuous."""
    knots = np.append(np.clip(times, None, max(t, times[0])), t)
    mean = (np.interp(knots[1:], times, frequencies) + np.interp(knots[:-1], times, frequencies)) / 2.0
    return amplitude * np.sin(phase + 2.0 * np.pi * np.sum(mean * np.diff(knots)))


def acceleration(t, positions, step):
    """The sum of some paths twice differentiated, as a step sees it; what moves at t = 0 has moved so before."""
    begin = max(t - step / 2.0, 0.0)
    change = sum(rate(one, t + step / 2.0, step / 16.0) - rate(one, begin, step / 16.0) for one in positions)
    return change / (t + step / 2.0 - begin)


def rate(position, t, d):
    """Time derivative by values d apart, to their fourth power: of those around t, at t = 0 of those behind it."""
    if t > 0.0:
        near, far = (position(t + k * d) - position(t - k * d) for k in (1, 2))
        return (8.0 * near - far) / (12.0 * d)
    weights = (-25.0, 48.0, -36.0, 16.0, -3.0)
    return sum(w * position(t + k * d) for k, w in enumerate(weights)) / (12.0 * d)
