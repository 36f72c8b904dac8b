"""Estimates of payload, loads and any output with bands, from sensors on a boom whose paths are measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.kernel.filter import AS_EXPECTED
from pmr.observe.filter import CHANGED, FilterModel, find_drift, watch
from pmr.observe.linear import SPECIFIC_FORCE, LinearMotion
from pmr.observe.unknowns import Estimates, Parameter, Payload, Sensor, UnknownLoad

__all__ = ["Estimates", "Observer", "Parameter", "Payload", "Sensor", "UnknownLoad"]


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
        names = {"sensors": [each.output for each in self.sensors], "loads": [load.input for load in self.loads]}
        for key, listed in names.items():
            if repeated := next((name for name in listed if listed.count(name) > 1), None):
                raise InputError("observe", f"{key}.{repeated}", None, "one of each name is allowed")
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

    def filter_model(self) -> FilterModel:
        """Model from which the numbers of the Kalman filter follow."""
        unknowns = (self.sensors, self.loads, self.payload, self.parameters)
        return FilterModel(self.model, *unknowns, self.total_errors(), self.error_time, self.disturbance)

    def run(self, measured: Mapping[str, tuple[Array, Array]]) -> Estimates:
        """Estimates from measurements; arguments and errors as `grid`."""
        described = self.filter_model()
        watched = watch(described.filter(), self.grid(measured), self.model.step)
        unknown = slice(described.first_unknown, described.first_unknown + len(self.unknowns))
        means, deviations = watched.states[:, unknown], np.sqrt(np.maximum(watched.state_variances[:, unknown], 0.0))
        drift, at = np.zeros(len(means), bool), len(self.loads)
        if self.payload is not None:
            drift = find_drift(means[:, at], deviations[:, at], self.model.step, self.payload.wander**2)
            changes = np.any(np.diff(watched.excluded, axis=0, prepend=False), axis=1)  # of what the estimate is from
            drift &= ~_follows(changes, CHANGED / self.model.step)
        return Estimates(
            self.model.t,
            self.model.outputs,
            watched.mean,
            np.sqrt(watched.variance),
            self.unknowns,
            means,
            deviations,
            tuple(sensor.output for sensor in self.sensors),
            watched.innovations,
            watched.alarms,
            watched.excluded,
            drift,
        )

    def observability(self) -> dict[str, float]:
        """Standard deviation of each unknown after the whole motion, over that before, whatever is measured.

        It follows from covariances alone, with all sensors at all steps.  Near 1 the sensors can't tell the unknown.
        """
        described = self.filter_model()
        kalman, nothing = described.filter(), np.repeat(np.nan, len(self.sensors))
        for k in range(len(self.model.t)):
            kalman.update(k, nothing, np.full(len(self.sensors), AS_EXPECTED))
            kalman.predict(k)
        variances = np.diagonal(kalman.P)[described.first_unknown :][: len(self.unknowns)]
        ratios = np.sqrt(variances) / described.unknown_deviations
        return dict(zip(self.unknowns, ratios.tolist(), strict=True))


def _follows(events: NDArray[np.bool_], steps: float) -> NDArray[np.bool_]:
    """Whether one of the `events` (T,) was at most this number of steps ago."""
    at = np.where(events, np.arange(len(events)), -np.inf)
    return np.arange(len(events)) - np.maximum.accumulate(at) <= steps
