"""Sensors of an observer and what it does not know: loads, a payload, parameters; estimates of them over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.stats
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.files.arrays import Array


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
    excluded: NDArray[np.bool_]  # (T, p): whether a sensor was found at fault and is not used
    drift: NDArray[np.bool_]  # (T,): whether the payload's estimate drifts; False without a payload

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
