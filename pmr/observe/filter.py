"""Watch over the sensors of an observer while the kernel's Kalman filter runs (src/filter.c).

Alarms tell which sensors are to be doubted: stuck, silent, or in disagreement with the model.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.files.arrays import Array
from pmr.kernel.filter import IF_NEAR, IF_POSSIBLE, MOST_SQUARE, NOT_USED, KalmanFilter

#: Seconds over which innovations are averaged for alarms, and mean square of normalised ones that raises an alarm.
WINDOW, ALARM = 0.4, 6.0
#: Mean square of innovations below which an excluded sensor agrees again, and seconds of this after which it returns.
NORMAL, RETURN = 6.0, 1.0
#: Seconds over which a payload's change is judged, and the largest one over its standard deviation that is no drift.
CHANGED, DRIFT = 2.0, 5.0
#: Seconds before an alarm from which measurements are filtered again without each sensor, and last seconds of them in
#: which innovations are averaged then.
REPLAYED, JUDGED = 0.8, 0.2
#: Mean square of innovations below which sensors agree, and ratio by which it is larger without a sensor that is right.
#: Beside a model that lacks fast modes the ratio for a good accelerometer was up to 3.4; for faulty ones it is 9 up.
AGREED, APART = 3.0, 6.0
#: Seconds in which a sensor that vibrates does not have one and the same value.
STUCK = 0.25
#: Seconds without a measurement, and multiple of the sensor's median interval, beyond which a sensor is silent.
SILENT, INTERVALS = 0.5, 3.0


def find_stuck(values: Array, step: float) -> NDArray[np.bool_]:
    """Mask (T, p) of the measurements at which a sensor is stuck: equal to all of the sensor's in the `STUCK` s before.

    `values` (T, p) are the measurements of p sensors at T steps of `step` s; NaN stands for none.  A measurement is
    marked if at least two equal ones come before it.  Steps without a measurement are passed over, and never marked.
    """
    stuck = np.zeros(values.shape, bool)
    for column, marked in zip(values.T, stuck.T, strict=True):
        at = np.nonzero(np.isfinite(column))[0]
        changes = np.concatenate([[True], np.diff(column[at]) != 0.0]) if len(at) else np.zeros(0, bool)
        first = np.maximum.accumulate(np.where(changes, np.arange(len(at)), 0))  # of the equal values
        marked[at] = ((at - at[first]) * step >= STUCK * (1.0 - 1e-9)) & (np.arange(len(at)) - first >= 2)
    return stuck


def find_silent(values: Array, step: float) -> NDArray[np.bool_]:
    """Mask (T, p) of the steps at which a sensor has had no measurement for too long.

    `values` (T, p) are the measurements of p sensors at T steps of `step` s, not finite where nothing was measured.
    Too long is longer than `SILENT` s and than `INTERVALS` times the median interval of the sensor's measurements.  The
    start counts as a measurement.
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


@dataclass(frozen=True)
class Watched:
    """Results of a watched Kalman filter at T steps: q outputs, N states, and innovations and alarms of p sensors."""

    mean: Array  # (T, q)
    variance: Array  # (T, q)
    states: Array  # (T, N)
    state_variances: Array  # (T, N)
    innovations: Array  # (T, p): over their standard deviations; NaN where nothing was measured
    alarms: NDArray[np.bool_]  # (T, p): where a sensor is stuck, silent or doubted
    excluded: NDArray[np.bool_]  # (T, p): where a sensor is not used, as it was found at fault


def watch(kalman: KalmanFilter, values: Array, step: float) -> Watched:
    """Filter the measurements of p sensors at T steps with `kalman`, and watch over the sensors.

    `values` (T, p) are the measurements at steps of `step` s, NaN for missing ones.  Measurements of a sensor that is
    stuck are not used.  A sensor has an alarm at all steps at which it is stuck or silent (`find_stuck`,
    `find_silent`), or at which the mean square of its innovations is large; only in the last case it is checked whether
    the sensor is at fault (`isolate`), and a sensor at fault is excluded.  It stays excluded, and has an alarm, until
    the mean square of its innovations has been below `NORMAL` for `RETURN` s.
    """
    (T, p), N, q = values.shape, len(kalman.x), kalman.outputs_count
    of_outputs, of_states = np.zeros((2, T, q)), np.zeros((2, T, N))
    innovations = np.full((T, p), np.nan)
    masks = np.zeros((2, T, p), bool)
    watched = Watched(of_outputs[0], of_outputs[1], of_states[0], of_states[1], innovations, masks[0], masks[1])
    stuck, silent = find_stuck(values, step), find_silent(values, step)
    values = np.where(stuck, np.nan, values)
    excluded, agreed, due, wait = np.zeros(p, bool), np.zeros(p), 0, JUDGED / 4.0
    past = deque[Array](maxlen=max(1, round(REPLAYED / step)))
    for k in range(T):
        past.append(kalman.lasting.copy())
        innovations[k] = kalman.update(k, values[k], np.where(excluded, NOT_USED, IF_NEAR))
        agreed = np.where(kalman.level < NORMAL, agreed + step * np.isfinite(innovations[k]), 0.0)
        excluded = excluded & (agreed < RETURN)
        beyond = kalman.level > ALARM
        watched.alarms[k] = beyond | stuck[k] | silent[k] | excluded
        if k >= due and beyond[~excluded].any():
            at_fault = isolate(kalman, k, values[k + 1 - len(past) : k + 1], past[0], excluded, step)
            due, wait = k + max(1, round(wait / step)), min(2.0 * wait, REPLAYED)
            if at_fault is not None:
                excluded[at_fault] = watched.alarms[k, at_fault] = True
                kalman.level[~excluded], agreed[at_fault], wait = 1.0, 0.0, JUDGED / 4.0
        watched.excluded[k] = excluded
        watched.mean[k], watched.variance[k] = kalman.outputs(k)
        watched.states[k], watched.state_variances[k] = kalman.x, np.diagonal(kalman.P)
        kalman.predict(k)
    return watched


def find_drift(mean: Array, deviation: Array, step: float, growth: float = 0.0) -> NDArray[np.bool_]:
    """Mask (T,) of the steps at which a payload's estimate has changed over `CHANGED` s by more than chance explains.

    `mean` (T,) in kg are estimates of a constant payload at steps of `step` s, and `deviation` (T,) in kg their
    standard deviations.  The change that chance explains has the variance P_0 - P_1, by which the estimate's variance
    has fallen in this time, plus that of a random walk of `growth` in kg^2/s.  A change of more than `DRIFT` times the
    root of this variance is a drift, as by a force sensor whose error grows slowly.  Innovations do not show such an
    error, because the estimate of the payload follows it.
    """
    lag, drifts = max(1, round(CHANGED / step)), np.zeros(len(mean), bool)
    variance = deviation[:-lag] ** 2 - deviation[lag:] ** 2 + growth * lag * step
    least = (0.2 * deviation[lag:]) ** 2  # where next to nothing is learnt
    drifts[lag:] = np.abs(mean[lag:] - mean[:-lag]) > DRIFT * np.sqrt(np.maximum(variance, least))
    return drifts


def isolate(
    kalman: KalmanFilter, k: int, values: Array, earlier: Array, excluded: NDArray[np.bool_], step: float
) -> int | None:
    """Number of the sensor without which all others agree with the model, or None if there is no such sensor.

    The measurements `values` (t, p) of the t steps of `step` s up to the step k are filtered again from the `earlier`
    state of the filter, once without each sensor that is not in the mask `excluded` (p,).  The largest mean square of
    the innovations of all sensors in use is taken from each of these trials.  A sensor is at fault if this figure is
    below `AGREED` in the trial without it, and at least `APART` times as large in every other trial.  The filter
    `kalman` then gets the state that it reaches without this sensor; it stays as it is if no sensor is at fault.
    """
    trials, present = list[tuple[float, int, Array]](), kalman.memory.copy()
    judged, levels = max(1, round(JUDGED / step)), kalman.level.copy()
    for j in np.nonzero(~excluded)[0]:
        without, squares = excluded | (np.arange(len(excluded)) == j), np.zeros(values.shape)
        kalman.lasting[:] = earlier
        for i, measured in enumerate(values, k + 1 - len(values)):
            innovations = kalman.update(i, measured, np.where(without, NOT_USED, IF_POSSIBLE))
            squares[i - k - 1] = np.minimum(np.nan_to_num(innovations) ** 2, MOST_SQUARE)
            if i < k:
                kalman.predict(i)
        level = squares[-judged:].mean(axis=0)[~without].max(initial=np.inf if without.all() else 0.0)
        trials.append((float(level), int(j), kalman.memory.copy()))
    trials.sort(key=lambda trial: trial[0])
    kalman.memory[:] = present
    if trials[0][0] > AGREED or (len(trials) > 1 and trials[1][0] < APART * trials[0][0]):
        return None
    _, sensor, kalman.memory[:] = trials[0]
    kalman.level[:] = levels
    return sensor
