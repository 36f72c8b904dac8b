r"""Numbers of the Kalman filter behind `pmr.Observer`, whose steps are the kernel's (src/filter.c), and its alarms.

Alarms tell which sensors are to be doubted: stuck, silent, or in disagreement with the model.

The state is X = (xi, f, m, theta, b, g, e): prediction of the kernel's step, unknown loads, payload, parameters, bias
and gain of sensors, and errors of the model in measured outputs.  Loads and errors are Gauss-Markov processes,

.. math::
    f_{k+1} = e^{-h/\tau} f_k + w_k, \qquad \mathrm{var}(w_k) = \sigma^2 (1 - e^{-2h/\tau})

Between two steps such a load wanders, too.  Its mean over a step, with the load at both ends known, is one more random
load with the variance :math:`2 u \sigma^2 (1 - 2 u \tanh(1 / 2u))` of each step, :math:`u = \tau / h`.

A parameter that is not estimated has no gain, and its covariance with the state goes on (Schmidt, *Application of
state-space methods to navigation problems*, Advances in Control Systems 3, 1966).

A payload m beside that of the reference motion acts as the load :math:`-m (g + a)`, with the acceleration a of the
place that carries it.  In gains a is that of the reference motion; what the payload's estimate does by the rest of the
estimated acceleration is a known load.  So gains do not depend on what is measured: the product of an estimated
acceleration with innovations that are not white, as of any model that lacks something, would be a bias.
(Simon, *Optimal State Estimation*, 2006, section 5.1; Lourens and others, *An augmented Kalman filter for force
identification*, 2012.)
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pmr.files.arrays import Array
from pmr.kernel.filter import IF_NEAR, IF_POSSIBLE, MOST_SQUARE, NOT_USED, FilterData, FilterSteps, KalmanFilter
from pmr.observe.linear import LinearMotion
from pmr.observe.unknowns import Parameter, Payload, Sensor, UnknownLoad

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
    """Mask (T, p), true where a sensor has had no measurement for too long, at T steps of `step` s and p sensors.

    `values` (T, p) are not finite where nothing was measured.  Too long is longer than `SILENT` s and than `INTERVALS`
    times the median interval of the sensor's measurements.  The start counts as a measurement.
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
    """Filter's results at T steps: outputs (T, q), all of its states (T, N), innovations and alarms of p sensors."""

    mean: Array  # (T, q)
    variance: Array  # (T, q)
    states: Array  # (T, N)
    state_variances: Array  # (T, N)
    innovations: Array  # (T, p)
    alarms: NDArray[np.bool_]  # (T, p)
    excluded: NDArray[np.bool_]  # (T, p)


def watch(kalman: KalmanFilter, values: Array, step: float) -> Watched:
    """Filter measurements (T, p) at steps of `step` s, NaN where there is none, and watch over their sensors.

    Measurements of a sensor that is stuck are not used.  A sensor has an alarm where it is stuck or silent.  It has
    one, and is doubted, where the mean square of its innovations is large.  A sensor that is found at fault then
    (`isolate`) is excluded, and has an alarm, until the mean square of its innovations has been below `NORMAL` for
    `RETURN` s.
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
    """Whether, at each step of `step` s, a payload's estimate has drifted beyond what its standard deviation explains.

    Estimates (T,) of a constant payload with variances P change over `CHANGED` s by the variance P_0 - P_1, plus
    `growth` in kg^2/s of its random walk.  More than `DRIFT` times the root of this is a drift, as of a force sensor
    whose error grows slowly: innovations do not show it, because the payload follows.
    """
    lag, drifts = max(1, round(CHANGED / step)), np.zeros(len(mean), bool)
    variance = deviation[:-lag] ** 2 - deviation[lag:] ** 2 + growth * lag * step
    least = (0.2 * deviation[lag:]) ** 2  # where next to nothing is learnt
    drifts[lag:] = np.abs(mean[lag:] - mean[:-lag]) > DRIFT * np.sqrt(np.maximum(variance, least))
    return drifts


def isolate(
    kalman: KalmanFilter, k: int, values: Array, earlier: Array, excluded: NDArray[np.bool_], step: float
) -> int | None:
    """Number of the sensor without which all others agree with the model, and the filter without it; or None.

    The measurements (t, p) of the steps up to k are filtered again from the `earlier` state of the filter, once without
    each sensor that is not `excluded`.  A sensor is at fault if the largest mean square of the others' innovations is
    below `AGREED` without it, and at least `APART` times as large without any other one.  If none is, the filter stays
    as it is.
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


#: Innovation over its standard deviation from which a measurement counts less: its variance is enlarged to this bound.
GATE = 5.0
#: The same ratio from which a measurement is not used: no error of a model is as large as that of a wrong unit.
REFUSED = 50.0


@dataclass(frozen=True)
class FilterModel:
    """Linear model, sensors and unknowns from which the numbers of a filter follow.

    `total_errors` (q,) are errors of the outputs as fractions of their RMS; all else is as in `pmr.Observer`.
    """

    model: LinearMotion
    sensors: Sequence[Sensor]
    loads: Sequence[UnknownLoad]
    payload: Payload | None
    parameters: Sequence[Parameter]
    total_errors: Array
    error_time: float
    disturbance: float

    @property
    def first_unknown(self) -> int:
        """Number of the first unknown in the filter's state, behind the states of the model."""
        return 3 * self.model.matrices.modes

    @cached_property
    def unknown_deviations(self) -> Array:
        """Standard deviations (u,) of loads, payload, parameters, biases and gains before the motion."""
        deviations = [load.deviation for load in self.loads]
        deviations += [] if self.payload is None else [self.payload.deviation]
        deviations += [parameter.deviation for parameter in self.parameters]
        biases, gains = self._bias_and_gain
        return np.array([*deviations, *filter(None, biases), *filter(None, gains)])

    @property
    def _bias_and_gain(self) -> tuple[list[float], list[float]]:
        """Standard deviations of bias and gain of each sensor."""
        return [sensor.bias for sensor in self.sensors], [sensor.gain for sensor in self.sensors]

    def filter(self) -> KalmanFilter:
        """Filter in its first state."""
        return KalmanFilter(self.data(), self.steps())

    def steps(self) -> FilterSteps:
        """Linear models of all steps, with the sensitivities to parameters."""
        model, shape = self.model, (*self.model.reference.shape, len(self.parameters))
        sensitivity, growth = np.zeros(shape), np.zeros(shape)
        for j, parameter in enumerate(self.parameters):
            sensitivity[..., j] = parameter.sensitivity
            if parameter.per_kilogram is not None:
                growth[..., j] = parameter.per_kilogram
        return FilterSteps(model.reference, model.matrices, sensitivity, growth)

    def data(self) -> FilterData:
        """Sizes and numbers of the filter, and its first state: the boom stands in equilibrium with what is unknown."""
        model, h, n, payload = self.model, self.model.step, self.first_unknown, self.payload
        outputs = np.array([model.output_number(sensor.output) for sensor in self.sensors])
        biased, scaled = (np.nonzero(column)[0] for column in self._bias_and_gain)
        off = np.nonzero(self.total_errors[outputs] > 0.0)[0]
        load_inputs = np.array([model.input_number(load.input) for load in self.loads], int)
        payload_input = -1 if payload is None else model.input_number(payload.input)
        acceleration = 0 if payload is None else model.output_number(payload.acceleration)
        first_parameter = n + len(self.loads) + (payload is not None)
        N = n + len(self.unknown_deviations) + len(off)
        x, P, equilibrium = np.zeros(N), np.zeros((N, N)), np.eye(N)
        x[first_parameter : first_parameter + len(self.parameters)] = [each.mean for each in self.parameters]
        P[range(n, N), range(n, N)] = np.array([*self.unknown_deviations, *[1.0] * len(off)]) ** 2
        equilibrium[:n, n : n + len(self.loads)] = model.start[:, load_inputs]
        if payload is not None:
            lift = -(payload.gravity + float(model.reference[0, acceleration]))
            equilibrium[:n, first_parameter - 1] = model.start[:, payload_input] * lift
        decay, added = np.ones(N), np.zeros(N)
        load_decay = np.exp([-h / load.time for load in self.loads])
        decay[n : n + len(self.loads)], decay[N - len(off) :] = load_decay, np.exp(-h / self.error_time)
        added[n : n + len(self.loads)] = [
            load.deviation**2 * (1.0 - a * a) for load, a in zip(self.loads, load_decay, strict=True)
        ]
        added[N - len(off) :] = 1.0 - np.exp(-h / self.error_time) ** 2
        added[n // 3 : 2 * n // 3] = (self.disturbance * h) ** 2
        if payload is not None:
            added[first_parameter - 1] = payload.wander**2 * h
        return FilterData(
            sizes={
                "states": n, "outputs": len(model.outputs), "sensors": len(self.sensors), "inputs": len(model.inputs),
                "loads": len(self.loads), "parameters": len(self.parameters), "biased": len(biased),
                "scaled": len(scaled), "off": len(off), "payload": payload_input, "acceleration": acceleration,
            },
            numbers={
                "gravity": 0.0 if payload is None else payload.gravity, "gate": GATE, "refused": REFUSED,
                "alarm": ALARM, "share": min(1.0, h / WINDOW), "following": min(1.0, h / self.error_time / 10.0),
            },
            indices={
                "sensor_outputs": outputs, "load_inputs": load_inputs, "biased_sensors": biased,
                "scaled_sensors": scaled, "off_sensors": off,
                "considered": np.array([not parameter.estimated for parameter in self.parameters], int),
            },
            arrays={
                "noise": np.array([sensor.noise for sensor in self.sensors]), "errors": self.total_errors,
                "decay": decay, "added": added, "courses": model.matrices.courses,
                "rough": np.array([load.deviation_in_step(h) for load in self.loads]),
            },
            x=x,
            P=equilibrium @ P @ equilibrium.T,
            square=np.mean(model.reference**2, axis=0),
        )  # fmt: skip
