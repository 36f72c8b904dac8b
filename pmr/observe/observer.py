r"""Kalman filter on a reduced model whose paths are measured: payload, loads, and any output with bands.

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
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.observe.alarms import AGREED, ALARM, APART, JUDGED, REPLAYED, InnovationTest, find_silent, find_stuck
from pmr.observe.linear import SPECIFIC_FORCE, LinearMotion

#: Innovation over its standard deviation from which a measurement counts less: its variance is enlarged to this bound.
GATE = 5.0
#: The same ratio from which a measurement is not used: no error of a model is as large as that of a wrong unit.
REFUSED = 50.0


@dataclass(frozen=True)
class Sensor:
    """Sensor that measures an output of the model, in the output's unit."""

    output: str
    noise: float  # standard deviation of a measurement
    bias: float = 0.0  # standard deviation of its constant error
    gain: float = 0.0  # standard deviation of the error of its factor, which is 1


@dataclass(frozen=True)
class UnknownLoad:
    """Load that nobody measures, a Gauss-Markov process."""

    input: str  # name of the load
    deviation: float  # N: standard deviation
    time: float  # s: time in which it changes

    def deviation_in_step(self, step: float) -> float:
        r"""Standard deviation in N of the load's mean over a `step` h in s whose ends are known.

        .. math::
            \sigma^2\, 2 u \left( 1 - 2 u \tanh \frac{1}{2 u} \right), \qquad u = \tau / h
        """
        u = self.time / step
        return self.deviation * float(np.sqrt(max(0.0, 2.0 * u * (1.0 - 2.0 * u * np.tanh(0.5 / u)))))


@dataclass(frozen=True)
class Payload:
    """Mass beside that of the reference motion, which hangs at the place of a load along z."""

    input: str  # name of the load, upwards, at the place that carries the payload
    acceleration: str  # output: acceleration of that place upwards
    deviation: float  # kg: standard deviation at the start
    wander: float = 0.0  # kg/s^(1/2): of its random walk
    gravity: float = 9.80665  # m/s^2


@dataclass(frozen=True)
class Parameter:
    """Constant parameter of the model, such as a stiffness, known up to a multiple of one change."""

    name: str
    sensitivity: Array  # (T, q): what the change makes of the outputs (`output_sensitivity`)
    deviation: float = 1.0  # standard deviation, in units of the change
    estimated: bool = True  # False: it widens bands alone, as the sensors would not tell its true value
    mean: float = 0.0  # its expected value, such as that of a friction, which is never negative
    per_kilogram: Array | None = None  # (T, q): growth of the sensitivity with 1 kg of the estimated payload


@dataclass(frozen=True)
class Estimates:
    """Estimates at T steps: outputs (T, q) and unknowns (T, u) with standard deviations, innovations of p sensors."""

    t: Array  # (T,) s
    outputs: tuple[str, ...]
    mean: Array  # (T, q)
    deviation: Array  # (T, q)
    unknowns: tuple[str, ...]
    unknown_mean: Array  # (T, u)
    unknown_deviation: Array  # (T, u)
    sensors: tuple[str, ...]
    innovations: Array  # (T, p): over their standard deviations; NaN where nothing was measured
    alarms: NDArray[np.bool_]  # (T, p): whether a sensor disagrees with the model, is stuck or silent

    def of(self, name: str) -> tuple[Array, Array]:
        """Mean and standard deviation (T,) of an output or unknown; an InputError is raised for another name."""
        if name in self.outputs:
            k = self.outputs.index(name)
            return self.mean[:, k], self.deviation[:, k]
        if name not in self.unknowns:
            allowed = f"one of these is allowed: {', '.join((*self.unknowns, *self.outputs))}"
            raise InputError("observe", "estimate", name, allowed)
        k = self.unknowns.index(name)
        return self.unknown_mean[:, k], self.unknown_deviation[:, k]

    def coverage(self, name: str, truth: Array, share: float = 0.9) -> float:
        """Share of T true values within the bands of the output or unknown `name` that should hold `share` of them.

        Times at which the true value is NaN are left out.
        """
        (mean, deviation), comparable = self.of(name), np.isfinite(truth)
        width = float(scipy.stats.norm.ppf(0.5 + 0.5 * share))
        return float(np.mean((np.abs(truth - mean) <= width * deviation)[comparable]))

    def whiteness(self, lags: int = 10) -> dict[str, float]:
        """p-value of the Ljung-Box test of each sensor's innovations with `lags` lags: small if they are not white."""
        values = dict[str, float]()
        for name, column in zip(self.sensors, self.innovations.T, strict=True):
            x = column[np.isfinite(column)]
            n, x = len(x), x - np.mean(x)
            correlations = np.array([x[lag:] @ x[: n - lag] for lag in range(1, lags + 1)]) / (x @ x)
            statistic = n * (n + 2) * np.sum(correlations**2 / (n - np.arange(1, lags + 1)))
            values[name] = float(scipy.stats.chi2.sf(statistic, lags))
        return values


@dataclass(frozen=True)
class Observer:
    """Estimator of unknowns and outputs from sensors, on a linear model along measured paths.

    Attributes
    ----------
    model : LinearMotion
        Its outputs are estimated.
    sensors, loads, payload, parameters
        What is measured, and what is not known.
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
        For a sensor or load that the model lacks, and for standard deviations that are not allowed.
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
        if not self.sensors:
            raise InputError("observe", "sensors", None, "one sensor or more is needed")
        for sensor in self.sensors:
            self.model.output_number(sensor.output)
            if not sensor.noise > 0.0 or sensor.bias < 0.0 or sensor.gain < 0.0:
                raise InputError("observe", f"sensors.{sensor.output}", None, "noise above 0, bias and gain from 0 on")
        for load in self.loads:
            self.model.input_number(load.input)
            if not (load.deviation > 0.0 and load.time > 0.0):
                raise InputError("observe", f"loads.{load.input}", None, "a deviation and a time above 0 are allowed")
        if self.payload is not None:
            self.model.input_number(self.payload.input)
            self.model.output_number(self.payload.acceleration)
            if self.payload.gravity and self.payload.acceleration.startswith(SPECIFIC_FORCE):
                allowed = "0 is allowed with a specific force, which includes it"
                raise InputError("observe", "payload.gravity", self.payload.gravity, allowed)
        for parameter in self.parameters:
            for values in (parameter.sensitivity, parameter.per_kilogram):
                if values is not None and values.shape != self.model.reference.shape:
                    allowed = f"an array {self.model.reference.shape} of sensitivities is allowed"
                    raise InputError("observe", f"parameters.{parameter.name}", values.shape, allowed)

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of what is estimated beside outputs: loads, payload, parameters, bias and gain of sensors."""
        return tuple(name for name in self.units if name not in self.model.outputs)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each unknown, then of each output, by name; that of a parameter is its change."""
        of_outputs = dict(zip(self.model.outputs, self.model.units, strict=True))
        return {
            **{load.input: "N" for load in self.loads},
            **({} if self.payload is None else {"payload": "kg"}),
            **{parameter.name: "1" for parameter in self.parameters},
            **{f"bias of {each.output}": of_outputs[each.output] for each in self.sensors if each.bias},
            **{f"gain of {each.output}": "1" for each in self.sensors if each.gain},
            **of_outputs,
        }

    def total_errors(self) -> Array:
        """Errors (q,) of the outputs over all parts of the budget, as fractions: roots of sums of squares.

        A part that does not cover an output counts as 0.
        """
        return np.array(
            [
                np.sqrt(sum(of_part.get(name, 0.0) ** 2 for of_part in self.errors.values()))
                for name in self.model.outputs
            ]
        )

    def grid(self, measured: Mapping[str, tuple[Array, Array]]) -> Array:
        """Measurements (T, p) at the model's steps, NaN where there is none.

        `measured` has times (n,) in s and values (n,) by the sensors' outputs; each value counts at the nearest step.
        Raises InputError for a name that no sensor has, for times and values of different lengths, and if there is no
        value within the model's times.
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
        """Estimates from measurements; arguments and errors as `grid`."""
        return _Filter(self).run(self.grid(measured))

    def observability(self) -> dict[str, float]:
        """Standard deviation of each unknown after the whole motion, over that before, whatever is measured.

        It follows from covariances alone, with all sensors at all steps.  Near 1 the sensors can't tell the unknown.
        """
        values = np.repeat(np.nan, len(self.sensors))
        filter_ = _Filter(self)
        first = filter_.unknown_variances()
        for k in range(len(self.model.t)):
            filter_.update(k, values, np.ones(len(self.sensors), bool))
            filter_.predict(k)
        ratios = np.sqrt(filter_.unknown_variances() / first)
        return dict(zip(self.unknowns, ratios.tolist(), strict=True))


class _Filter:
    """State X (N,), its covariance P (N, N), and what they are made of; one pass over the steps of a model."""

    def __init__(self, observer: Observer) -> None:
        self.observer, model = observer, observer.model
        sensors = observer.sensors
        n, self.h = model.A.shape[1], model.step
        self.number = np.array([model.output_number(sensor.output) for sensor in sensors])
        self.noise = np.array([sensor.noise for sensor in sensors])
        self.errors, self.square = observer.total_errors(), np.mean(model.reference**2, axis=0)
        self.lift = 0.0 if observer.payload is None else self._lift_at(0)
        self.load_columns = [model.input_number(load.input) for load in observer.loads]
        sizes = [len(observer.loads), int(observer.payload is not None), len(observer.parameters)]
        self.biased = [k for k, sensor in enumerate(sensors) if sensor.bias]
        self.scaled = [k for k, sensor in enumerate(sensors) if sensor.gain]
        self.off = [k for k, number in enumerate(self.number) if self.errors[number] > 0.0]
        sizes += [len(self.biased), len(self.scaled), len(self.off)]
        ends = np.cumsum([n, *sizes])
        self.of_loads, self.of_payload, self.of_parameters, self.of_bias, self.of_gain, self.of_errors = (
            slice(a, b) for a, b in zip(ends[:-1], ends[1:], strict=True)
        )
        self.n, N = n, int(ends[-1])
        first = self.of_parameters.start
        self.considered = [first + k for k, parameter in enumerate(observer.parameters) if not parameter.estimated]
        self.unknown = slice(n, int(ends[-2]))
        deviations = [load.deviation for load in observer.loads]
        deviations += [] if observer.payload is None else [observer.payload.deviation]
        deviations += [parameter.deviation for parameter in observer.parameters]
        deviations += [sensors[k].bias for k in self.biased] + [sensors[k].gain for k in self.scaled]
        self.x, self.P = np.zeros(N), np.zeros((N, N))
        self.x[self.of_parameters] = [parameter.mean for parameter in observer.parameters]
        self.P[range(n, N), range(n, N)] = np.array([*deviations, *[1.0] * len(self.off)]) ** 2
        equilibrium = np.eye(N)  # the boom stands in equilibrium with what is not known
        equilibrium[:n, self.of_loads] = model.start[:, self.load_columns]
        if observer.payload is not None:
            equilibrium[:n, self.of_payload] = model.start[:, [model.input_number(observer.payload.input)]] * self.lift
        self.P = equilibrium @ self.P @ equilibrium.T
        decay = [np.exp(-self.h / load.time) for load in observer.loads]
        error_decay = np.exp(-self.h / observer.error_time)
        self.decay, self.Q = np.ones(N), np.zeros(N)
        self.decay[self.of_loads], self.decay[self.of_errors] = decay, error_decay
        self.Q[self.of_loads] = [
            load.deviation**2 * (1.0 - a * a) for load, a in zip(observer.loads, decay, strict=True)
        ]
        self.rough = np.array([load.deviation_in_step(self.h) for load in observer.loads])
        self.Q[self.of_errors] = 1.0 - error_decay**2
        if observer.payload is not None:
            self.Q[self.of_payload] = observer.payload.wander**2 * self.h
        self.Q[n // 3 : 2 * n // 3] = (observer.disturbance * self.h) ** 2
        self.rows, self.shift = np.zeros((len(model.outputs), N)), np.zeros(len(model.outputs))

    def unknown_variances(self) -> Array:
        """Variances (u,) of the unknowns."""
        return np.diagonal(self.P)[self.unknown].copy()

    def _lift_at(self, k: int) -> float:
        """Upward force in N by 1 kg of payload at step k of the reference motion, whose weight acts from the start."""
        payload, model = self.observer.payload, self.observer.model
        assert payload is not None  # without one there is no lift
        return -(payload.gravity + float(model.reference[k, model.output_number(payload.acceleration)]))

    def _load_rows(self, of_loads: Array) -> Array:
        """Columns (., loads + 1) of unknown loads and payload, from the derivatives (., i) by the model's loads."""
        payload, model = self.observer.payload, self.observer.model
        columns = of_loads[:, self.load_columns]
        if payload is None:
            return columns
        return np.column_stack([columns, self.lift * of_loads[:, model.input_number(payload.input)]])

    def _payload_inertia(self, of_loads: Array) -> Array:
        """Effect (.) of the payload's inertia beside the reference's acceleration, by derivatives (., i) by loads."""
        payload, model = self.observer.payload, self.observer.model
        if payload is None:
            return np.zeros(len(of_loads))
        acceleration = float(self.rows[model.output_number(payload.acceleration)] @ self.x)
        return of_loads[:, model.input_number(payload.input)] * -acceleration * float(self.x[self.of_payload][0])

    def update(
        self,
        k: int,
        measured: Array,
        present: NDArray[np.bool_],
        doubted: NDArray[np.bool_] | bool = False,
        excluded: NDArray[np.bool_] | bool = False,
    ) -> Array:
        """Correct the state by measurements (p,) at step k; return innovations (p,) over their standard deviations.

        Only measurements in the mask `present` (p,) are used; the innovations of others are NaN.  One whose innovation
        is beyond `GATE` counts with a larger variance, or not at all if the sensor is `doubted` (p,) or the innovation
        beyond `REFUSED`.  Those of sensors that are `excluded` (p,) have innovations, but are not used.
        """
        observer, model = self.observer, self.observer.model
        n, rows, payload = self.n, self.rows, observer.payload
        rows[:, :n] = model.C[k]
        rows[:, n : self.of_payload.stop] = self._load_rows(model.D[k])
        for j, parameter in enumerate(observer.parameters):
            rows[:, self.of_parameters.start + j] = parameter.sensitivity[k]
            if parameter.per_kilogram is not None:
                rows[:, self.of_parameters.start + j] += self.x[self.of_payload].sum() * parameter.per_kilogram[k]
        if payload is not None:
            self.lift = self._lift_at(k)
            rows[:, n : self.of_payload.stop] = self._load_rows(model.D[k])
        self.shift = self._payload_inertia(model.D[k])
        predicted = model.reference[k] + self.shift + rows @ self.x
        H = rows[self.number].copy()
        H[self.biased, range(self.of_bias.start, self.of_bias.stop)] = 1.0
        H[self.scaled, range(self.of_gain.start, self.of_gain.stop)] = predicted[self.number[self.scaled]]
        off = self.number[self.off]
        H[self.off, range(self.of_errors.start, self.of_errors.stop)] = self.errors[off] * np.sqrt(self.square[off])
        expected = (model.reference[k] + self.shift)[self.number] + H @ self.x
        innovations = np.full(len(self.number), np.nan)
        variances = np.sum((H @ self.P) * H, axis=1) + self.noise**2
        gaps = np.where(np.isfinite(measured), measured, expected) - expected
        innovations[present] = (gaps / np.sqrt(variances))[present]
        used = np.nonzero((np.abs(innovations) <= np.where(doubted, GATE, REFUSED)) & ~np.asarray(excluded))[0]
        if len(used):
            H, gap = H[used], gaps[used]
            PH = self.P @ H.T
            beyond = np.maximum((innovations[used] / GATE) ** 2 - 1.0, 0.0)
            S = H @ PH + np.diag(self.noise[used] ** 2 + beyond * variances[used])
            K = np.linalg.solve(S, PH.T).T
            K[self.considered] = 0.0
            self.x = self.x + K @ gap
            self.P -= K @ PH.T + PH @ K.T - K @ S @ K.T
            self.P = 0.5 * (self.P + self.P.T)
        return innovations

    def outputs(self, k: int) -> tuple[Array, Array]:
        """Mean and variance (q,) of the outputs at step k, after `update`, with the errors of the model."""
        mean = self.observer.model.reference[k] + self.shift + self.rows @ self.x
        self.square += (mean**2 - self.square) * min(1.0, self.h / self.observer.error_time / 10.0)
        variance = np.sum((self.rows @ self.P) * self.rows, axis=1)
        return mean, np.maximum(variance, 0.0) + self.errors**2 * self.square

    def predict(self, k: int) -> None:
        """Advance state and covariance from step k to the next."""
        model, n = self.observer.model, self.n
        F = np.diag(self.decay)
        F[:n, :n] = model.A[k]
        F[:n, n : self.of_payload.stop] = self._load_rows(model.B[k])
        swing = self._payload_inertia(model.B[k])
        self.x = F @ self.x
        self.x[:n] += swing
        self.P = F @ self.P @ F.T
        self.P[range(len(self.x)), range(len(self.x))] += self.Q
        rough = model.B[k][:, self.load_columns] * self.rough
        self.P[:n, :n] += rough @ rough.T

    def isolate(self, k: int, values: Array, earlier: tuple[Array, Array], excluded: NDArray[np.bool_]) -> int | None:
        """Number of the sensor without which all others agree with the model, and the state without it; or None.

        The measurements (t, p) of the steps up to k are filtered again from the `earlier` state, once without each
        sensor that is not `excluded`.  A sensor is at fault if the largest mean square of the others' innovations is
        below `AGREED` without it, and at least `APART` times as large without any other one.  If none is, the state
        stays.
        """
        trials, present = list[tuple[float, int, Array, Array]](), (self.x, self.P)
        judged = max(1, round(JUDGED / self.h))
        for j in np.nonzero(~excluded)[0]:
            without, squares = excluded | (np.arange(len(excluded)) == j), np.zeros(values.shape)
            self.x, self.P = earlier[0], earlier[1].copy()
            for i, measured in enumerate(values, k + 1 - len(values)):
                innovations = self.update(i, measured, np.isfinite(measured), False, without)
                squares[i - k - 1] = np.minimum(np.nan_to_num(innovations) ** 2, 1e3)
                if i < k:
                    self.predict(i)
            level = squares[-judged:].mean(axis=0)[~without].max(initial=np.inf if without.all() else 0.0)
            trials.append((float(level), int(j), self.x, self.P))
        trials.sort(key=lambda trial: trial[0])
        self.x, self.P = present
        if trials[0][0] > AGREED or (len(trials) > 1 and trials[1][0] < APART * trials[0][0]):
            return None
        _, sensor, self.x, self.P = trials[0]
        return sensor

    def run(self, values: Array) -> Estimates:
        """Estimates from measurements (T, p) at the steps of the model, NaN where there is none.

        Measurements of a sensor that is stuck are not used.  A sensor has an alarm where it is stuck or silent.  It has
        one, and is doubted, where the mean square of its innovations is large (`pmr.observe.alarms`).  A sensor that is
        found at fault then (`isolate`) is excluded, and has an alarm, until the end.
        """
        observer, model = self.observer, self.observer.model
        T, q = model.reference.shape
        mean, deviation = np.zeros((T, q)), np.zeros((T, q))
        unknown, unknown_deviation = np.zeros((2, T, self.unknown.stop - self.unknown.start))
        innovations, alarms = np.full(values.shape, np.nan), np.zeros(values.shape, bool)
        stuck, silent = find_stuck(values, self.h), find_silent(values, self.h)
        test, values = InnovationTest(np.ones(values.shape[1]), self.h), np.where(stuck, np.nan, values)
        excluded, due, wait = np.zeros(values.shape[1], bool), 0, JUDGED / 4.0
        past = deque[tuple[Array, Array]](maxlen=max(1, round(REPLAYED / self.h)))
        for k in range(T):
            past.append((self.x, self.P.copy()))
            innovations[k] = self.update(k, values[k], np.isfinite(values[k]), test.level > ALARM, excluded)
            alarms[k] = test.update(innovations[k]) | stuck[k] | silent[k] | excluded
            if k >= due and (test.level > ALARM)[~excluded].any():
                at_fault = self.isolate(k, values[k + 1 - len(past) : k + 1], past[0], excluded)
                due, wait = k + max(1, round(wait / self.h)), min(2.0 * wait, REPLAYED)
                if at_fault is not None:
                    excluded[at_fault] = alarms[k, at_fault] = True
                    test.level[~excluded], wait = 1.0, JUDGED / 4.0
            mean[k], variance = self.outputs(k)
            deviation[k] = np.sqrt(variance)
            unknown[k] = self.x[self.unknown]
            unknown_deviation[k] = np.sqrt(np.maximum(self.unknown_variances(), 0.0))
            self.predict(k)
        names = tuple(sensor.output for sensor in observer.sensors)
        estimated = (model.outputs, mean, deviation, observer.unknowns, unknown, unknown_deviation)
        return Estimates(model.t, *estimated, names, innovations, alarms)
