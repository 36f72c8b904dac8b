"""One step of `march` for callers in Python: nothing but s is handed over, so the call takes less than the step."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from numba import typeof, types
from numpy.typing import NDArray

from pmr.simulate import kept
from pmr.simulate.compiled import compiled, compiled_for_python
from pmr.simulate.march_arrays import Outputs, Scheme, State, System
from pmr.simulate.march_kernel import step
from pmr.simulate.march_outputs import observe

Array = NDArray[np.float64]
Memory = NDArray[np.int64]

#: Returned instead of the number of a row where s lies off the path.
OFF_THE_PATH = -1


def _example() -> tuple[System, Scheme, Outputs, State, Array, Array]:
    """Arguments of the types that all have."""
    one, two, three, four = (np.zeros((1,) * n) for n in range(1, 5))
    system = System(one, four, four, two, three, 0)
    state = State(two, one, one, np.zeros(1, np.int64), two, two, two, one)
    return system, Scheme(*[0.0] * len(Scheme._fields)), Outputs(two, three), state, one, one


_TYPE = typeof(_example())
_kept = kept.kept(_TYPE)


def keep(system: System, scheme: Scheme, outputs: Outputs, state: State, f: Array, y: Array) -> Memory:
    """Memory for `advance`; the arrays have to outlive it."""
    memory = np.zeros(kept.words(_TYPE), np.int64)
    _keep(memory.ctypes.data, (system, scheme, outputs, state, f, y))
    return memory


@compiled
def _keep(address: int, arguments: tuple[System, Scheme, Outputs, State, Array, Array]) -> None:
    kept.keep(address, arguments)


@compiled_for_python
def _advance(address: int, s: float) -> int:
    system, scheme, outputs, state, f, y = _kept(address)
    breaks = system.breaks
    if not breaks[0] <= s <= breaks[len(breaks) - 1]:
        return OFF_THE_PATH
    failed = step(system, scheme, state, s, f)
    if failed == 0:
        observe(system, outputs, state, f, y)
    return failed


@cache
def entry() -> Callable[[int, float], int]:
    """``advance(address, s)``: a step to s under the loads in f, its outputs in y; compiled when first asked for.

    Returns 0, the number of a dependent row from 1, or OFF_THE_PATH.  Nothing is looked at as a call of a compiled
    function would do it: the address has to be that of the memory that `keep` gave.
    """
    signature = (types.int64, types.float64)
    _advance.compile(signature)
    return _advance.overloads[signature].entry_point
