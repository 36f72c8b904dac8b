"""The kernel's Kalman filter on linear models of steps (src/filter.c), these models (src/chosen.c), and its sensors.

While the filter runs, alarms tell which of its sensors are to be doubted: stuck, silent, or in disagreement with the
model.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.errors import SimulationError
from pmr.files.arrays import Array
from pmr.kernel._native import ffi, lib
from pmr.kernel.kernel import pointer, structure
from pmr.kernel.state import State

#: How a measurement is used (`pmr_filter_update` in src/pmr_kernel.h).
IF_POSSIBLE, IF_NEAR = lib.PMR_IF_POSSIBLE, lib.PMR_IF_NEAR
AS_EXPECTED, NOT_USED = lib.PMR_AS_EXPECTED, lib.PMR_NOT_USED
#: Most that a normalised innovation counts in the running mean square.
MOST_SQUARE = float(lib.PMR_MOST_SQUARE)


@dataclass(frozen=True)
class FilterData:
    """Data of a Kalman filter by their names in `pmr_filter` (src/pmr_kernel.h), and its initial estimates."""

    sizes: Mapping[str, int]
    numbers: Mapping[str, float]
    indices: Mapping[str, NDArray[np.int32]]
    arrays: Mapping[str, Array]
    x: Array  # (N,)
    P: Array  # (N, N)
    square: Array  # (q,): mean squares of the outputs


class Transitions(NamedTuple):
    """Matrices of T steps: the state after state x (n,) under loads f (i,) is A x + B f."""

    A: Array  # (T, n, n)
    B: Array  # (T, n, i)


@dataclass(frozen=True)
class StepMatrices:
    """Factors and matrices of T steps of r modes, from which the transition matrices of 3 r states follow.

    A step's acceleration is R (z*, v*) + G f.  Five numbers of each mode are weighted sums of its prediction (z*, v*,
    a*) and its acceleration: the next prediction, and z and its rate at the end of the step.  `courses` has the
    weights.
    """

    # (5, 4, r): z*, v*, a* of the next prediction, z and its rate by z*, v*, a* and the acceleration of the same mode
    courses: Array
    R: Array  # (T, r, 2 r)
    G: Array  # (T, r, i)
    C: Array  # (T, q, 2 r): of outputs
    D: Array  # (T, q, i)

    @property
    def modes(self) -> int:
        """Number r of modes."""
        return self.courses.shape[2]

    def transitions(self, steps: slice = slice(None)) -> Transitions:
        """Transition matrices A and B of the steps in a slice `steps`, by default of all."""
        by_acceleration, r = self.courses[:3, 3], self.modes
        R, G = np.pad(self.R[steps], [(0, 0), (0, 0), (0, r)]), self.G[steps]
        A, B = (np.einsum("pj,tjc->tpjc", by_acceleration, by).reshape(len(by), 3 * r, by.shape[2]) for by in (R, G))
        return Transitions(A + np.block([[np.diag(factors) for factors in part[:3]] for part in self.courses[:3]]), B)


@dataclass(frozen=True)
class FilterSteps:
    """Linear models of T steps, and how their q outputs change with unknown parameters of the machine.

    The outputs change by `sensitivity` per unit of a parameter, and by `per_kilogram` more for each kg of an estimated
    payload.
    """

    reference: Array  # (T, q): outputs of the motion about which the models are linear
    matrices: StepMatrices
    sensitivity: Array  # (T, q, parameters)
    per_kilogram: Array  # (T, q, parameters)


class KalmanFilter:
    """A Kalman filter and its state: the estimates x of N quantities with their covariance P.

    These arrays are views of the filter's memory: `x` (N,), `P` (N, N), `level` (p,) with the running mean squares of
    the p sensors' normalised innovations, and `lasting` with all numbers from which an update begins.
    """

    def __init__(self, data: FilterData, steps: FilterSteps) -> None:
        """Make the kernel's filter from `data` and the linear models in `steps`, and set its initial state."""
        self._filter = structure("pmr_filter", {**data.sizes, **data.numbers, **data.indices, **data.arrays})
        counts = ffi.new("pmr_filter_counts *")
        lib.pmr_filter_sizes(self._filter, counts)
        N, stride, self.outputs_count = counts.states, counts.stride, data.sizes["outputs"]
        self.memory = np.zeros(counts.memory)
        start = [np.ascontiguousarray(array, float) for array in (data.x, data.P, data.square)]
        lib.pmr_filter_start(self._filter, pointer(self.memory), *map(pointer, start))
        self.x = self.memory[:N]
        self.P = self.memory[stride : stride + N * stride].reshape(N, stride)[:, :N]
        self.lasting = self.memory[: counts.kept]
        self.level = self.memory[counts.kept - data.sizes["sensors"] : counts.kept]
        arrays = {name: getattr(steps, name) for name in ("reference", "sensitivity", "per_kilogram")}
        arrays |= {name: getattr(steps.matrices, name) for name in "RGCD"}
        self._steps = {name: np.ascontiguousarray(array, float) for name, array in arrays.items()}
        self._places = {name: (pointer(array), array[0].size) for name, array in self._steps.items()}
        self._step = ffi.new("pmr_filter_step *")

    def _step_data(self, k: int) -> Any:
        """Addresses of the linear model of step k, as the kernel's structure ``pmr_filter_step``."""
        for name, (first, size) in self._places.items():
            setattr(self._step, name, first + k * size)
        return self._step

    def update(self, k: int, measured: Array, use: NDArray[np.int64]) -> Array:
        """Correct the state at step k by `measured` (p,); return innovations (p,) divided by their standard deviations.

        Measurements that are not finite are missing.  `use` (p,) has a constant of the kernel for each sensor.
        ``PMR_IF_POSSIBLE`` uses a measurement unless it is far beyond what the model can explain.  ``PMR_IF_NEAR`` does
        the same, but while the sensor's `level` is above the alarm, a measurement also has to be near the estimate.
        With ``PMR_AS_EXPECTED``, a missing measurement counts as if the estimate had been measured.  ``PMR_NOT_USED``
        only returns the innovation.  The innovation of a missing measurement is NaN, or 0 with ``PMR_AS_EXPECTED``.  A
        measurement that is finite changes the sensor's `level`, whether it is used or not.  Raises a SimulationError if
        the covariance of the measurements is not positive definite.
        """
        measured, innovations = np.ascontiguousarray(measured, float), np.zeros(len(measured))
        used = np.ascontiguousarray(use, np.int32)
        arguments = (pointer(measured), pointer(used), pointer(innovations))
        if lib.pmr_filter_update(self._filter, pointer(self.memory), self._step_data(k), *arguments) != lib.PMR_DONE:
            raise SimulationError(f"step {k}: the covariance of the measurements is not finite, or has no inverse")
        return innovations

    def outputs(self, k: int) -> Array:
        """Mean and variance, (2, q), of the q outputs at step k after `update`.

        The variance includes errors of the model.
        """
        values = np.zeros((2, self.outputs_count))
        lib.pmr_filter_outputs(self._filter, pointer(self.memory), self._step_data(k), *map(pointer, values))
        return values

    def predict(self, k: int) -> None:
        """Advance the state and its covariance from step k to step k + 1."""
        lib.pmr_filter_predict(self._filter, pointer(self.memory), self._step_data(k))


@dataclass(frozen=True)
class ChosenOutputs:
    """Chosen outputs and loads of a linear model, by their numbers, as the kernel's `pmr_chosen` (src/pmr_kernel.h)."""

    columns: NDArray[np.int32]  # (q,) among outputs of the bodies, then forces of all contacts
    orders: NDArray[np.int32]  # (q,): 0 for the quantity itself, 1 or 2 for its first or second rate
    loads: NDArray[np.int32]  # (i,) among the drivers
    at_modes: NDArray[np.int32]  # (r,): modes without padding


class LinearSteps:
    """Linear models of T steps for chosen outputs and loads.

    The arrays (T, ...) have their names in `pmr_linear_step` (src/pmr_kernel.h).
    """

    def __init__(self, chosen: ChosenOutputs, T: int) -> None:
        """Make arrays of zeros for the models of T steps, with the outputs, loads and modes in `chosen`."""
        q, i, r = len(chosen.columns), len(chosen.loads), len(chosen.at_modes)
        shapes = ((5, 4, r), (T, r, 2 * r), (T, r, i), (T, q, 2 * r), (T, q, i))
        self.reference, self.matrices = np.zeros((T, q)), StepMatrices(*map(np.zeros, shapes))
        self._chosen, stored = chosen, T if chosen.orders.any() else 1  # without rates nothing is stored for them
        self._arrays = {
            "reference": self.reference, **{name: getattr(self.matrices, name) for name in "RGCD"},
            "shapes": np.zeros((stored, q, r)), "loaded": np.zeros((stored, q)), "motion": np.zeros((stored, 3 * r)),
        }  # fmt: skip
        self._data = structure("pmr_chosen", {"outputs": q, "inputs": i, "modes": r} | vars(chosen))
        self._steps = ffi.new("pmr_linear_step[]", T)  # addresses of the arrays of all steps
        for name, array in self._arrays.items():
            first, size, last = pointer(array), array[0].size, len(array) - 1
            for k in range(T):
                setattr(self._steps[k], name, first + min(k, last) * size)

    def take(self, state: State, k: int, u: Array) -> None:
        """Take a step of `state` to the drivers u (N,), and store its linear model as that of step k.

        Raises StepError if the step fails.
        """
        u, where = np.ascontiguousarray(u, float), f"step {state.step_number + 1}"
        arguments = (state.pointer, self._data, pointer(u), self._steps + k)
        lib.pmr_linear_courses(state.pointer, self._data, pointer(self.matrices.courses))
        state.raise_unless_done(lib.pmr_linear_matrices(*arguments), where)
        state.step(u)
        state.raise_unless_done(lib.pmr_linear_outputs(*arguments), where)

    def follow_rates(self, h: float) -> None:
        """Turn outputs that are rates into derivatives with respect to time, from the models of neighbouring steps.

        The matrices and the reference of all steps, which are h s apart, are changed in place.  Call it after all steps
        are taken.
        """
        if self._chosen.orders.any():
            steps = [ffi.NULL, *(self._steps + k for k in range(len(self.reference))), ffi.NULL]
            for before, now, after in zip(steps[:-2], steps[1:-1], steps[2:], strict=True):
                lib.pmr_output_rates(self._data, pointer(self.matrices.courses), h, before, now, after)


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
    """Mask (T, p) of the measurements at which a sensor is stuck.

    `values` (T, p) are the measurements of p sensors at T steps of `step` s; NaN stands for none.  A measurement is
    marked if it is at least the third of successive equal measurements, the first of which was at least `STUCK` s
    before.  Steps without a measurement are passed over, and never marked.
    """
    stuck = np.zeros(values.shape, bool)
    for column, marked in zip(values.T, stuck.T, strict=True):
        at = np.nonzero(np.isfinite(column))[0]
        changes = np.diff(column[at], prepend=np.nan) != 0.0
        first = np.maximum.accumulate(np.where(changes, np.arange(len(at)), 0))  # of the equal values
        marked[at] = ((at - at[first]) * step >= STUCK * (1.0 - 1e-9)) & (np.arange(len(at)) - first >= 2)
    return stuck


def find_silent(values: Array, step: float) -> NDArray[np.bool_]:
    """Mask (T, p) of the steps at which a sensor has had no measurement for too long.

    `values` (T, p) are the measurements of p sensors at T steps of `step` s, not finite where nothing was measured.  A
    step is marked if the last measurement is more than `SILENT` s ago, and also more than `INTERVALS` times the median
    interval between the sensor's measurements.  The start counts as a measurement.
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
    `find_silent`), or at which the mean square of its innovations is above `ALARM`.  Only in the last case it is
    checked whether the sensor is at fault (`isolate`).  A sensor at fault is excluded, and has an alarm, until the mean
    square of its innovations has been below `NORMAL` for `RETURN` s.
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


def find_drift(mean: Array, deviation: Array, step: float, growth: float) -> NDArray[np.bool_]:
    """Mask (T,) of the steps at which a payload's estimate has changed over `CHANGED` s by more than chance explains.

    `mean` (T,) in kg are estimates of a constant payload at steps of `step` s, and `deviation` (T,) in kg their
    standard deviations.  No step of the first `CHANGED` s is marked.  Two variances explain a change by chance.  The
    first is the amount by which the estimate's variance has fallen in this time; the second is that of a random walk,
    which grows by `growth` in kg^2/s.  Their sum counts as at least the square of a fifth of the `deviation`.  A change
    of more than `DRIFT` times the root of this sum is a drift, as by a force sensor whose error grows slowly.
    Innovations do not show such an error, because the estimate of the payload follows it.
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

    The last t steps of `step` s, up to step k, are filtered again from the `earlier` state of the filter, with their
    measurements `values` (t, p).  This is tried without each sensor that is not in the mask `excluded` (p,), one trial
    for each.  The figure of a trial is the largest mean square of innovations, in its last `JUDGED` s, among the
    sensors that it uses.

    A sensor is at fault if the trial without it has a figure of at most `AGREED`, and every other trial has a figure at
    least `APART` times as large.  The filter `kalman` then gets the state of the trial without this sensor, except for
    the `level` of the sensors.  If no sensor is at fault, the filter stays as it is.
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
