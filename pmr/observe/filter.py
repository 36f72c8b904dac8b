r"""Numbers of the Kalman filter behind `pmr.Observer`, whose steps are the kernel's (src/filter.c).

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

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pmr.files.arrays import Array
from pmr.kernel.filter import FilterData, FilterSteps, KalmanFilter
from pmr.observe.alarms import ALARM, WINDOW
from pmr.observe.linear import LinearMotion
from pmr.observe.unknowns import Parameter, Payload, Sensor, UnknownLoad

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
        return self.model.A.shape[1]

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
        return FilterSteps(model.reference, model.A, model.B, model.C, model.D, sensitivity, growth)

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
                "decay": decay, "added": added, "rough": np.array([load.deviation_in_step(h) for load in self.loads]),
            },
            x=x,
            P=equilibrium @ P @ equilibrium.T,
            square=np.mean(model.reference**2, axis=0),
        )  # fmt: skip
