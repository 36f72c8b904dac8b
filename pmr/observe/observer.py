r"""Estimates of payload, loads and any output with bands, from sensors on a boom whose paths are measured.

The estimates are those of a Kalman filter, whose steps are the kernel's (src/filter.c).

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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.kernel.filter import (
    ALARM,
    AS_EXPECTED,
    CHANGED,
    WINDOW,
    FilterData,
    FilterSteps,
    KalmanFilter,
    find_drift,
    watch,
)
from pmr.observe.linear import RATE_ORDERS, SPECIFIC_FORCE, LinearMotion


@dataclass(frozen=True)
class Sensor:
    """Sensor that measures an output of the model, in the output's unit."""

    output: str
    noise: float  # standard deviation of a measurement
    bias: float = 0.0  # standard deviation of its constant error
    gain: float = 0.0  # standard deviation of the error of its factor, which is 1


@dataclass(frozen=True)
class UnknownLoad:
    """Load that nobody measures: a Gauss-Markov process, which forgets its value in a certain time."""

    input: str  # name of the load
    deviation: float  # N, of a moment N m: standard deviation
    time: float  # s: time tau in which the correlation with its present value falls to 1/e

    def deviation_in_step(self, step: float) -> float:
        r"""Standard deviation of the load's mean over a `step` h in s if the load is known at both ends of the step.

        .. math::
            \sqrt{\sigma^2\, 2 u \left( 1 - 2 u \tanh \frac{1}{2 u} \right)}, \qquad u = \tau / h

        with the load's deviation :math:`\sigma` and time :math:`\tau`.  Its unit is that of the load.
        """
        u = self.time / step
        return self.deviation * float(np.sqrt(max(0.0, 2.0 * u * (1.0 - 2.0 * u * np.tanh(0.5 / u)))))


@dataclass(frozen=True)
class Payload:
    """Unknown mass in addition to that of the reference motion; it hangs where a load along z of the model acts.

    The acceleration has to be that of the place where the load acts.
    """

    input: str  # name of the load, upwards, at the place that carries the payload
    acceleration: str  # output: acceleration of that place upwards
    deviation: float  # kg: standard deviation at the start
    wander: float = 0.0  # kg/s^(1/2): of its random walk
    gravity: float = 9.80665  # m/s^2: along -z of the body


@dataclass(frozen=True)
class Parameter:
    """Constant parameter of the model, such as a stiffness, whose effect was computed for a certain change of it.

    Its value is counted in units of this change.
    """

    name: str
    sensitivity: Array  # (T, q): what the change makes of the outputs (`output_sensitivity`)
    deviation: float = 1.0  # standard deviation, in units of the change
    estimated: bool = True  # False: it widens bands alone, as the sensors would not tell its true value
    mean: float = 0.0  # its expected value, such as that of a friction, which is never negative
    per_kilogram: Array | None = None  # (T, q): growth of the sensitivity with 1 kg of the estimated payload


class Estimate(NamedTuple):
    """Mean and standard deviation (T,) of an output or unknown at T steps."""

    mean: Array
    deviation: Array


@dataclass(frozen=True)
class Estimates:
    """Estimates of q outputs and u unknowns at T steps with standard deviations, and innovations of p sensors."""

    t: Array  # (T,) s
    outputs: tuple[str, ...]
    unknowns: tuple[str, ...]
    means: Array  # (T, q + u): of outputs, then of unknowns, each in its unit
    deviations: Array  # (T, q + u): standard deviations
    sensors: tuple[str, ...]
    innovations: Array  # (T, p): over their standard deviations; NaN where nothing was measured
    alarms: NDArray[np.bool_]  # (T, p): whether a sensor disagrees with the model, is stuck or silent
    excluded: NDArray[np.bool_]  # (T, p): whether a sensor was found at fault and is not used
    drift: NDArray[np.bool_]  # (T,): whether the payload's estimate drifts; False without a payload

    def of(self, name: str) -> Estimate:
        """Estimate of the output or unknown called `name` at all steps; raises InputError for another name."""
        names = (*self.outputs, *self.unknowns)
        if name not in names:
            allowed = f"one of these is allowed: {', '.join((*self.unknowns, *self.outputs))}"
            raise InputError("observe", "estimate", name, allowed)
        k = names.index(name)
        return Estimate(self.means[:, k], self.deviations[:, k])

    def coverage(self, name: str, truth: Array, share: float = 0.9) -> float:
        """Fraction of the true values that lie within the band of the output or unknown `name`.

        The band is as wide as a normal distribution needs to hold the fraction `share`.  `truth` (T,) are the true
        values; times at which it is NaN are left out.  The result is NaN if there are no other times.
        """
        (mean, deviation), comparable = self.of(name), np.isfinite(truth)
        width = float(scipy.stats.norm.ppf(0.5 + 0.5 * share))
        return float(np.mean((np.abs(truth - mean) <= width * deviation)[comparable]))

    def whiteness(self, lags: int = 10) -> dict[str, float]:
        """p-value of the Ljung-Box test for white innovations, by sensor.

        `lags` is the number of lags.  The value is small if the innovations are not white, and NaN for a sensor with no
        more innovations than `lags`.
        """
        values = dict[str, float]()
        for name, column in zip(self.sensors, self.innovations.T, strict=True):
            x = column[np.isfinite(column)]
            n = len(x)
            if n <= lags:
                values[name] = np.nan
                continue
            x = x - np.mean(x)
            correlations = np.array([x[lag:] @ x[: n - lag] for lag in range(1, lags + 1)]) / (x @ x)
            statistic = n * (n + 2) * np.sum(correlations**2 / (n - np.arange(1, lags + 1)))
            values[name] = float(scipy.stats.chi2.sf(statistic, lags))
        return values


#: Innovation over its standard deviation from which a measurement counts less: its variance is enlarged to this bound.
GATE = 5.0
#: The same ratio from which a measurement is not used: no error of a model is as large as that of a wrong unit.
REFUSED = 50.0


@dataclass(frozen=True)
class Observer:
    """Estimator of unknowns and outputs from sensors, on a linear model along measured paths.

    Attributes
    ----------
    model : LinearMotion
        Linear model of the boom; all of its outputs are estimated.
    sensors : tuple of Sensor
        Sensors that measure outputs of the model.
    loads, payload, parameters
        Unknowns: loads, a payload (None if there is none) and constant parameters.
    errors : mapping
        Errors of outputs as fractions of their RMS, by the part of the budget and the output's name
        (`pmr.observe.budget.output_errors`).
    error_time : float, s
        Time in which these errors change.
    disturbance : float, kg^(1/2) m/s^2
        Standard deviation of accelerations of modes that nothing else explains.

    Raises
    ------
    InputError
        If there is no sensor, for a sensor or load that the model lacks, and for numbers that are not allowed.  If two
        unknowns have one name, or an unknown has the name of an output.  For a payload whose load is no force, or whose
        `acceleration` is an output of another kind or of another place than the load's.  If sensitivities of a
        parameter have another shape than the model's outputs.
    """

    model: LinearMotion
    sensors: Sequence[Sensor]
    loads: Sequence[UnknownLoad] = ()
    payload: Payload | None = None
    parameters: Sequence[Parameter] = ()
    errors: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    error_time: float = 0.5
    disturbance: float = 1e-3

    def __post_init__(self) -> None:
        if not 0.0 < self.error_time < np.inf:
            raise InputError("observe", "error_time", self.error_time, "more than 0 s is allowed")
        if not 0.0 <= self.disturbance < np.inf:
            raise InputError("observe", "disturbance", self.disturbance, "0 or more is allowed")
        if not self.sensors:
            raise InputError("observe", "sensors", None, "one sensor or more is needed")
        for sensor in self.sensors:
            self.model.output_number(sensor.output)
            if not (0.0 < sensor.noise < np.inf and 0.0 <= sensor.bias < np.inf and 0.0 <= sensor.gain < np.inf):
                allowed = "finite numbers are allowed: noise above 0, bias and gain of 0 or more"
                raise InputError("observe", f"sensors.{sensor.output}", None, allowed)
        names = {"sensors": [each.output for each in self.sensors], "loads": [load.input for load in self.loads]}
        names["unknowns"] = [*self.unknowns, *self.model.outputs]
        for key, listed in names.items():
            if repeated := next((name for name in listed if listed.count(name) > 1), None):
                raise InputError("observe", f"{key}.{repeated}", None, "each name is allowed once")
        for load in self.loads:
            self.model.input_number(load.input)
            if not (0.0 < load.deviation < np.inf and 0.0 < load.time < np.inf):
                allowed = "a finite deviation and a finite time above 0 are allowed"
                raise InputError("observe", f"loads.{load.input}", None, allowed)
        if self.payload is not None:
            self.model.input_number(self.payload.input)
            self.model.output_number(self.payload.acceleration)
            if self.model.input_unit(self.payload.input) != "N":
                raise InputError("observe", "payload.input", self.payload.input, "a force along z is allowed")
            if self.model.units[self.model.output_number(self.payload.acceleration)] != "m/s^2":
                allowed = "an acceleration or a specific force is allowed"
                raise InputError("observe", "payload.acceleration", self.payload.acceleration, allowed)
            at_load = self.model.displacements.get(self.payload.input)
            rate = next((words for words in RATE_ORDERS if self.payload.acceleration.startswith(words)), "")
            if at_load is not None and self.payload.acceleration.removeprefix(rate) not in at_load:
                places = (
                    " or ".join(rate + name for name in at_load)
                    or "that of an output at its place, which the scene has to observe,"
                )
                allowed = f"{places} is allowed, as the load {self.payload.input!r} acts there"
                raise InputError("observe", "payload.acceleration", self.payload.acceleration, allowed)
            of = self.payload
            if not (0.0 < of.deviation < np.inf and 0.0 <= of.wander < np.inf and np.isfinite(of.gravity)):
                allowed = "finite numbers are allowed: a deviation above 0, a wander of 0 or more"
                raise InputError("observe", "payload", None, allowed)
            if self.payload.gravity and self.payload.acceleration.startswith(SPECIFIC_FORCE):
                allowed = "0 is allowed, as a specific force includes gravity"
                raise InputError("observe", "payload.gravity", self.payload.gravity, allowed)
        for parameter in self.parameters:
            for values in (parameter.sensitivity, parameter.per_kilogram):
                if values is not None and values.shape != self.model.reference.shape:
                    allowed = f"an array {self.model.reference.shape} of sensitivities is allowed"
                    raise InputError("observe", f"parameters.{parameter.name}", values.shape, allowed)

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names (u,) of the unknowns: of loads, payload, parameters, and of bias and gain of sensors, in this order."""
        return tuple(name for name, _ in self._unknown_units())

    @property
    def units(self) -> dict[str, str]:
        """Unit of each unknown, then of each output, by name; parameters and gains have the unit 1."""
        return dict([*self._unknown_units(), *zip(self.model.outputs, self.model.units, strict=True)])

    def _unknown_units(self) -> list[tuple[str, str]]:
        """Name and unit of each unknown, in the order of `unknowns`."""
        of_outputs = dict(zip(self.model.outputs, self.model.units, strict=True))
        return [
            *((load.input, self.model.input_unit(load.input)) for load in self.loads),
            *([] if self.payload is None else [("payload", "kg")]),
            *((parameter.name, "1") for parameter in self.parameters),
            *((f"bias of {each.output}", of_outputs[each.output]) for each in self.sensors if each.bias),
            *((f"gain of {each.output}", "1") for each in self.sensors if each.gain),
        ]

    def total_errors(self) -> Array:
        """Errors (q,) of the outputs as fractions: roots of the sums of squares of the budget's parts.

        A part that does not cover an output counts as 0.
        """
        parts = self.errors.values()
        return np.array([np.hypot.reduce([of.get(name, 0.0) for of in parts]) for name in self.model.outputs])

    def grid(self, measured: Mapping[str, tuple[Array, Array]]) -> Array:
        """Measurements (T, p) of the p sensors at the model's T steps, NaN where nothing was measured.

        `measured` has times (n,) in s and values (n,) by the sensors' outputs; sensors may be missing in it.  A value
        counts at the nearest step; of several values at one step, the last one counts.  Values beyond the model's times
        are left out.  Raises InputError for a name that no sensor has, for times and values of different lengths, and
        if there is no value within the model's times.
        """
        names = [sensor.output for sensor in self.sensors]
        values = np.full((len(self.model.t), len(names)), np.nan)
        for name, (times, readings) in measured.items():
            if name not in names:
                raise InputError("observe", "measured", name, f"one of the sensors is allowed: {', '.join(names)}")
            values[:, names.index(name)] = self.model.sample(name, times, readings)
        if not np.isfinite(values).any():
            allowed = (
                f"values between {self.model.t[0]:.4g} and {self.model.t[-1]:.4g} s, the times of the scene's motion"
            )
            raise InputError("observe", "measured", None, f"{allowed}, are needed: there are none")
        return values

    def run(self, measured: Mapping[str, tuple[Array, Array]]) -> Estimates:
        """Estimate outputs and unknowns from measurements, at the steps of the model.

        `measured` has times (n,) in s and values (n,) by the sensors' outputs.  Raises the InputErrors of `grid`, and a
        SimulationError if the covariance of the measurements has no inverse.
        """
        watched = watch(self.kalman_filter(), self.grid(measured), self.model.step)
        unknown = slice(self._first_unknown, self._first_unknown + len(self.unknowns))
        means, deviations = watched.states[:, unknown], np.sqrt(np.maximum(watched.state_variances[:, unknown], 0.0))
        drift, at = np.zeros(len(means), bool), len(self.loads)
        if self.payload is not None:
            drift = find_drift(means[:, at], deviations[:, at], self.model.step, self.payload.wander**2)
            changes = np.any(np.diff(watched.excluded, axis=0, prepend=False), axis=1)  # of what the estimate is from
            drift &= ~_follows(changes, CHANGED / self.model.step)
        return Estimates(
            self.model.t,
            self.model.outputs,
            self.unknowns,
            np.hstack([watched.mean, means]),
            np.hstack([np.sqrt(watched.variance), deviations]),
            tuple(sensor.output for sensor in self.sensors),
            watched.innovations,
            watched.alarms,
            watched.excluded,
            drift,
        )

    def observability(self) -> dict[str, float]:
        """Ratio of the standard deviation of each unknown after the motion to that before it, by the unknown's name.

        The ratio follows from covariances alone, with all sensors at all steps, and not from measurements.  If it is
        near 1, the sensors can't tell the unknown.
        """
        kalman, nothing = self.kalman_filter(), np.repeat(np.nan, len(self.sensors))
        for k in range(len(self.model.t)):
            kalman.update(k, nothing, np.full(len(self.sensors), AS_EXPECTED))
            kalman.predict(k)
        variances = np.diagonal(kalman.P)[self._first_unknown :][: len(self.unknowns)]
        ratios = np.sqrt(variances) / self._unknown_deviations()
        return dict(zip(self.unknowns, ratios.tolist(), strict=True))

    def kalman_filter(self) -> KalmanFilter:
        """Return the kernel's Kalman filter for all steps of the model, in its state at the start of the motion."""
        model, shape = self.model, (*self.model.reference.shape, len(self.parameters))
        sensitivity, growth = np.zeros(shape), np.zeros(shape)
        for j, parameter in enumerate(self.parameters):
            sensitivity[..., j] = parameter.sensitivity
            if parameter.per_kilogram is not None:
                growth[..., j] = parameter.per_kilogram
        return KalmanFilter(self.filter_data(), FilterSteps(model.reference, model.matrices, sensitivity, growth))

    @property
    def _first_unknown(self) -> int:
        """Number of the first unknown in the filter's state; the unknowns follow after the model's states."""
        return 3 * self.model.matrices.modes

    def _unknown_deviations(self) -> Array:
        """Standard deviations (u,) of the unknowns before the motion, in the order of `unknowns`."""
        deviations = [load.deviation for load in self.loads]
        deviations += [] if self.payload is None else [self.payload.deviation]
        deviations += [parameter.deviation for parameter in self.parameters]
        errors = [*(sensor.bias for sensor in self.sensors), *(sensor.gain for sensor in self.sensors)]
        return np.array([*deviations, *filter(None, errors)])

    def filter_data(self) -> FilterData:
        """Return the filter's sizes, constants, indices and arrays, and its estimate of the N states at the start.

        The mean x (N,) is zero, apart from the means of the parameters.  The covariance P (N, N) is that of a boom in
        static equilibrium with the unknown loads and payload.
        """
        model, h, n, payload = self.model, self.model.step, self._first_unknown, self.payload
        outputs = np.array([model.output_number(sensor.output) for sensor in self.sensors])
        biased, scaled = (np.nonzero([getattr(s, key) for s in self.sensors])[0] for key in ("bias", "gain"))
        errors = self.total_errors()
        off = np.nonzero(errors[outputs] > 0.0)[0]
        load_inputs = np.array([model.input_number(load.input) for load in self.loads], int)
        payload_input = -1 if payload is None else model.input_number(payload.input)
        acceleration = 0 if payload is None else model.output_number(payload.acceleration)
        first_parameter = n + len(self.loads) + (payload is not None)
        deviations = self._unknown_deviations()
        N = n + len(deviations) + len(off)
        x, P, equilibrium = np.zeros(N), np.zeros((N, N)), np.eye(N)
        x[first_parameter : first_parameter + len(self.parameters)] = [each.mean for each in self.parameters]
        P[range(n, N), range(n, N)] = np.array([*deviations, *[1.0] * len(off)]) ** 2
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
                "noise": np.array([sensor.noise for sensor in self.sensors]), "errors": errors,
                "decay": decay, "added": added, "courses": model.matrices.courses,
                "rough": np.array([load.deviation_in_step(h) for load in self.loads]),
            },
            x=x,
            P=equilibrium @ P @ equilibrium.T,
            square=np.mean(model.reference**2, axis=0),
        )  # fmt: skip


def _follows(events: NDArray[np.bool_], steps: float) -> NDArray[np.bool_]:
    """Mask (T,) of the steps with an event, and of the next `steps` steps after each.

    `events` (T,) is the mask of the steps with an event; `steps` need not be an integer.
    """
    at = np.where(events, np.arange(len(events)), -np.inf)
    return np.arange(len(events)) - np.maximum.accumulate(at) <= steps
