"""A step of the kernel for loops in Python, at hardly more than it takes in C."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.kernel._native import ffi, lib
from pmr.kernel.kernel import State

Array = NDArray[np.float64]
Integers = NDArray[np.int32]


class BoundStep:
    """Steps of a state with pointers that are found once, for loops in Python; a call returns what stopped it, or 0.

    A step leads to `motions` (3, n) of the frame, of each of which `rows` (n,) count; without a frame to the drivers
    u (N,) in the first row of `motions` (3, N).  `values` holds what `observe` found: outputs and forces, by their
    `numbers` among all outputs and, behind these, all forces.
    """

    def __init__(self, state: State, numbers: Sequence[int]) -> None:
        kernel, count = state.kernel, len(numbers)
        self.motions = np.zeros((3, kernel.motions or kernel.drivers))
        self.rows: Integers = np.ones(self.motions.shape[1], np.int32)
        self.rates = np.zeros((2, kernel.drivers))  # at both ends of a step
        self._numbers, self.values = np.array(numbers, np.int32), np.zeros(count)
        handle, motions = state.pointer, _numbers_at(self.motions)
        if kernel.motions:
            self.step = partial(lib.pmr_step_in_frame, handle, motions, _integers_at(self.rows))
        else:
            self.step = partial(lib.pmr_step, handle, motions, ffi.NULL)
        self.step_by_rates = partial(lib.pmr_step, handle, motions, _numbers_at(self.rates))
        self.observe = partial(lib.pmr_observe, handle, count, _integers_at(self._numbers), _numbers_at(self.values))


def _numbers_at(array: Array) -> Any:
    return ffi.cast("double *", array.ctypes.data)


def _integers_at(array: Integers) -> Any:
    return ffi.cast("int32_t *", array.ctypes.data)
