"""Signals as plain functions of one time t in s: the source text of these is copied into exported scripts.

Each takes the fields of the signal of the same kind in `pmr.scene.signals`, and needs NumPy and SciPy only.
"""

# mypy: allow-untyped-defs, allow-untyped-calls
from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.interpolate import Akima1DInterpolator


def ramp(t, times, values):
    """Straight lines between the knots, held before the first and after the last."""
    return np.interp(t, times, values)


def smooth_ramp(t, times, values):
    """Quintic transitions between the knots: rate and acceleration vanish at each of them."""
    k = np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2)
    x = np.clip((t - times[k]) / (times[k + 1] - times[k]), 0.0, 1.0)
    return values[k] + (values[k + 1] - values[k]) * x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


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
