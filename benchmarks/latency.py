"""One step of a stepper from Python: how long it takes, and how long at worst."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import beams
from pmr.simulation.native.stepper import Stepper

Array = NDArray[np.float64]

CALLS = 100_000
#: Of the slider's way to and fro, taken again and again.
STEPS = 15_000
QUANTILES = {"median": 0.5, "p99": 0.99, "p99.9": 0.999, "worst": 1.0}


def measure(calls: int = CALLS) -> dict[str, Any]:
    """Nanoseconds of a step, the clock's own taken off, for several models and outputs."""
    bodies = {"r = 20": beams.plain(20), "r = 20, two rows held": beams.reduced("evolved")}
    bodies |= {"r = 6": beams.plain(6), "r = 6, residual flexibility": beams.flexible(6)}
    times = {}
    for name, body in bodies.items():
        count = len(body.output_positions)
        for outputs, chosen in {"tip": [count - 1], f"{count} outputs": list(range(count))}.items():
            steps = _from_python(Stepper(body, *_start(), outputs=chosen), calls)
            times[f"{name}, {outputs}"] = _quantiles(steps)
    return {"calls": calls, "ns": times}


def _start() -> tuple[float, float, Array]:
    drive = beams.sliding(STEPS)
    return drive.stepping.step, float(drive.s[0, 0]), drive.f[0]


def _inputs() -> tuple[Array, Array]:
    drive = beams.sliding(STEPS)
    return np.ascontiguousarray(drive.s[1:, 0]), drive.f[1:]


def _from_python(stepper: Stepper, calls: int) -> Array:
    """Each call between two looks at the clock, whose own time, the least there is, is taken off."""
    s, f = (values.ravel().tolist() for values in _inputs())
    stamps = np.zeros((calls, 3), np.int64)
    for n in range(calls):
        position, force = s[n % len(s)], f[n % len(f)]
        a = time.perf_counter_ns()
        stepper.step(position, force)
        b = time.perf_counter_ns()
        stamps[n] = a, b, time.perf_counter_ns()
    stepper.check_finite()
    return np.diff(stamps[:, :2], axis=1)[:, 0] - float(np.diff(stamps[:, 1:], axis=1).min())


def _quantiles(ns: Array) -> dict[str, float]:
    return {name: float(np.quantile(ns, q)) for name, q in QUANTILES.items()}
