"""One step: how long it takes, how long at worst, in a compiled loop and from Python."""

from __future__ import annotations

import ctypes
import time
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks import beams
from pmr.simulation.native.part import step_on_tables
from pmr.simulation.native.stepper import Stepper

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

PYTHON_CALLS = 100_000
#: Of the slider's way to and fro, taken again and again.
STEPS = 15_000
QUANTILES = {"median": 0.5, "p99": 0.99, "p99.9": 0.999, "worst": 1.0}

_clock_gettime = ctypes.CDLL(None).clock_gettime
_clock_gettime.argtypes, _clock_gettime.restype = [ctypes.c_int, ctypes.c_void_p], ctypes.c_int
_MONOTONIC = time.CLOCK_MONOTONIC


@njit
def _march(arguments: Any, s: Array, f: Array, y: Array, stamps: Stamps) -> int:
    """A time stamp before the first step and after each one."""
    now = np.zeros(2, np.int64)
    for n in range(len(stamps)):
        _clock_gettime(_MONOTONIC, now.ctypes)
        stamps[n] = now[0] * 1_000_000_000 + now[1]
        if n + 1 < len(stamps):
            k = n % len(s)
            failed = step_on_tables(*arguments, s[k], f[k], y)
            if failed:
                return failed
    return 0


@njit
def _nothing(stamps: Stamps) -> None:
    """What the clock itself takes."""
    now = np.zeros(2, np.int64)
    for n in range(len(stamps)):
        _clock_gettime(_MONOTONIC, now.ctypes)
        stamps[n] = now[0] * 1_000_000_000 + now[1]


def measure(steps: int, python_calls: int = PYTHON_CALLS) -> dict[str, Any]:
    """Nanoseconds of a step, the clock's own taken off, for several models and outputs."""
    stamps = np.zeros(steps + 1, np.int64)
    _nothing(stamps)
    _nothing(stamps)
    clock = float(np.median(np.diff(stamps)))
    bodies = {"r = 20": beams.plain(20), "r = 20, two rows held": beams.reduced("evolved")}
    bodies |= {"r = 6": beams.plain(6), "r = 6, residual flexibility": beams.flexible(6)}
    found = {}
    for name, body in bodies.items():
        count = len(body.output_positions)
        for outputs, chosen in {"tip": [count - 1], f"{count} outputs": list(range(count))}.items():
            compiled = _compiled(Stepper(body, *_start(), outputs=chosen), len(chosen), stamps) - clock
            python = _from_python(Stepper(body, *_start(), outputs=chosen), python_calls)
            found[f"{name}, {outputs}"] = {"compiled": _quantiles(compiled), "python": _quantiles(python)}
    return {"steps": steps, "python_calls": python_calls, "clock_ns": clock, "ns": found}


def _start() -> tuple[float, float, Array]:
    drive = beams.sliding(STEPS)
    return drive.stepping.step, float(drive.s[0, 0]), drive.f[0]


def _inputs() -> tuple[Array, Array]:
    drive = beams.sliding(STEPS)
    return np.ascontiguousarray(drive.s[1:, 0]), drive.f[1:]


def _compiled(stepper: Stepper, outputs: int, stamps: Stamps) -> Array:
    s, f = _inputs()
    y = np.zeros(outputs)
    failed = _march(stepper.arguments, s, f, y, stamps[:1000])
    failed = failed or _march(stepper.arguments, s, f, y, stamps)
    assert failed == 0 and np.isfinite(y).all()
    return np.diff(stamps).astype(float)


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
