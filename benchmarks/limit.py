r"""How far the compiled loop is from what the core can do.

A step of a beam with one moving row, r' modes (r rounded up to a multiple of four) and one input does, mode by mode:

====================================  ==============  ==============
part (`pmr.simulation`)               flops a mode    numbers a mode
====================================  ==============  ==============
row at s: cubic by Horner             6               4 read, 1 written
row times free motion                 2               2 read
end of the step and next prediction   31              9 read, 6 written
====================================  ==============  ==============

that is 39 flops and 176 bytes a mode, on a working set of 128 bytes a mode.  Two loops say what the core reaches: one
of independent fused multiply-adds in registers, and a triad a = b + x c on a working set of the same size.  Third,
steps follow each other: from one step's multiplier to the next lead 15 operations that wait for one another, and r'/8
more to sum up the row times the motion; a chain of dependent multiply-adds says how long that takes at least.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from benchmarks import beams
from pmr.simulation.native import systems
from pmr.simulation.native.compilation import OPTIONS
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.simd import LANES, aligned, load, spread, store, total

Array = NDArray[np.float64]

FLOPS, BYTES, WORKING_SET = 39, 176, 128  # a mode
CHAIN = 15  # operations, and r' / 8 more
FAR = 3.0  # from that factor on an account of the reasons is due

_compiled = njit(**OPTIONS)


@_compiled
def _multiply_add(count: int, x: float, y: float) -> float:
    """Ten independent sums, 80 flops a turn."""
    a = b = c = d = e = f = g = h = i = j = spread(0.5)
    for _ in range(count):
        a, b, c, d, e = a * x + spread(y), b * x + spread(y), c * x + spread(y), d * x + spread(y), e * x + spread(y)
        f, g, h, i, j = f * x + spread(y), g * x + spread(y), h * x + spread(y), i * x + spread(y), j * x + spread(y)
    return total(a + b + c + d + e + (f + g + h + i + j))


@_compiled
def _triad(count: int, a: Array, b: Array, c: Array, x: float) -> None:
    """24 bytes a number."""
    for _ in range(count):
        for n in range(0, len(a), LANES):
            store(a, n, load(b, n) + load(c, n) * x)


@_compiled
def _chain(count: int, x: float, y: float) -> float:
    """Each multiply-add waits for the one before."""
    a = 0.5
    for _ in range(count):
        a = a * x + y
    return a


def measure(sizes: tuple[int, ...] = (6, 20, 48, 100, 151), repeats: int = 200) -> dict[str, Any]:
    """Nanoseconds of a step, and the least that flops, bytes and the chain of dependent operations allow."""
    drive, form = beams.sliding(1500), beams.modal()
    steps = drive.stepping.steps
    bodies = {r: SystemForm.alone(beams.leading(form, r)) for r in sizes}
    arrays = {
        r: [aligned(np.zeros(max(LANES, WORKING_SET * _wide(r) // 24 // LANES * LANES))) for _ in range(3)]
        for r in sizes
    }
    step, byte, flop, operation = dict.fromkeys(sizes, np.inf), dict.fromkeys(sizes, np.inf), np.inf, np.inf
    for _ in range(repeats):
        for r in sizes:
            seen = systems.observe(bodies[r], drive, outputs=[50], every=steps)
            step[r] = min(step[r], 1e9 * seen.seconds / steps)
            turns = 1 + 20_000 // len(arrays[r][0])
            byte[r] = min(byte[r], _ns(_triad, turns, *arrays[r], 0.5) / (turns * len(arrays[r][0]) * 24))
            flop = min(flop, _ns(_multiply_add, 2000, 0.5, 0.5) / (2000 * 80))
            operation = min(operation, _ns(_chain, 5000, 0.5, 0.5) / 5000)
    records = []
    for r in sizes:
        least = {
            "flops": FLOPS * _wide(r) * flop,
            "bytes": BYTES * _wide(r) * min(byte.values()),
            "chain": (CHAIN + _wide(r) / 8) * operation,
        }
        factor = step[r] / max(least.values())
        records.append({"r": r, "step_ns": step[r], "byte_ns": byte[r], "least_ns": least, "factor": factor})
    counted = {"flops": FLOPS, "bytes": BYTES, "working_set": WORKING_SET, "chain": CHAIN}
    return {"a_mode": counted, "flop_ns": flop, "operation_ns": operation, "sizes": records}


def _wide(r: int) -> int:
    """The number of modes rounded up as the loop does it: r'."""
    return r + -r % LANES


def _ns(loop: Any, *arguments: Any) -> float:
    begin = time.perf_counter_ns()
    loop(*arguments)
    return time.perf_counter_ns() - begin
