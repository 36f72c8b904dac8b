"""Which sensors are to be doubted: stuck, silent, or in disagreement with the model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.files.arrays import Array

#: Seconds over which innovations are averaged for alarms, and mean square of normalised ones that raises an alarm.
WINDOW, ALARM = 0.4, 6.0
#: Seconds before an alarm from which measurements are filtered again without each sensor, and last seconds of them in
#: which innovations are averaged then.
REPLAYED, JUDGED = 0.8, 0.2
#: Mean square of innovations below which sensors agree, and ratio by which it is larger without a sensor that is right.
AGREED, APART = 3.0, 2.0
#: Seconds in which a sensor that vibrates does not have one and the same value.
STUCK = 0.25
#: Seconds without a measurement, and multiple of the sensor's median interval, beyond which a sensor is silent.
SILENT, INTERVALS = 0.5, 3.0


def find_stuck(values: Array, step: float) -> NDArray[np.bool_]:
    """Whether, at each step of `step` s, a sensor's measurement (T, p) is the same as all those of `STUCK` s before.

    It has to be the third of equal values at least.  Steps without a measurement, NaN, are passed over, and are never
    stuck.
    """
    stuck = np.zeros(values.shape, bool)
    for column, marked in zip(values.T, stuck.T, strict=True):
        at = np.nonzero(np.isfinite(column))[0]
        changes = np.concatenate([[True], np.diff(column[at]) != 0.0]) if len(at) else np.zeros(0, bool)
        first = np.maximum.accumulate(np.where(changes, np.arange(len(at)), 0))  # of the equal values
        marked[at] = ((at - at[first]) * step >= STUCK * (1.0 - 1e-9)) & (np.arange(len(at)) - first >= 2)
    return stuck


def find_silent(values: Array, step: float) -> NDArray[np.bool_]:
    """Whether, at each step of `step` s, a sensor (T, p) has had no measurement for too long.

    That is longer than `SILENT` s and than `INTERVALS` times the median interval of its measurements.  The start counts
    as a measurement.
    """
    silent = np.zeros(values.shape, bool)
    steps = np.arange(len(values))
    for column, marked in zip(values.T, silent.T, strict=True):
        measured = np.isfinite(column)
        intervals = np.diff(steps[measured])
        longest = max(SILENT, INTERVALS * step * float(np.median(intervals)) if len(intervals) else 0.0)
        since = steps - np.maximum.accumulate(np.where(measured, steps, 0))
        marked[:] = since * step > longest
    return silent


@dataclass
class InnovationTest:
    """Running mean square (p,) of the innovations of p sensors, over about `WINDOW` s."""

    level: Array
    step: float  # s

    def update(self, innovations: Array) -> NDArray[np.bool_]:
        """Add innovations (p,), NaN where there is none; return whether the mean square is above `ALARM`."""
        squares = np.where(np.isfinite(innovations), np.minimum(innovations**2, 1e3), self.level)
        self.level += min(1.0, self.step / WINDOW) * (squares - self.level)
        return self.level > ALARM
