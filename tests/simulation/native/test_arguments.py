"""Arguments that were unboxed once: what is read later is what was stored, arrays by reference."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit, typeof
from numpy.typing import NDArray

from pmr.simulation.native import bound_step

Array = NDArray[np.float64]


class Arguments(NamedTuple):
    matrix: Array
    factor: float
    counts: NDArray[np.int64]


EXAMPLE = Arguments(np.zeros((1, 1)), 0.0, np.zeros(1, np.int64))
WORDS = bound_step.words(typeof(EXAMPLE))
read = bound_step.stored(typeof(EXAMPLE))


@njit(_nrt=False)
def store(address: int, arguments: Arguments) -> None:
    bound_step.store_at(address, arguments)


@njit(_nrt=False)
def scaled_sum(address: int) -> float:
    arguments = read(address)
    total = 0.0
    for i in range(arguments.matrix.shape[0]):
        for j in range(arguments.matrix.shape[1]):
            total += arguments.matrix[i, j]
    arguments.counts[0] += 1
    return total * arguments.factor


def test_what_was_stored_is_read_again_and_arrays_stay_the_same() -> None:
    matrix, counts = np.arange(6.0).reshape(2, 3), np.zeros(1, np.int64)
    memory = np.zeros(WORDS, np.int64)
    store(memory.ctypes.data, Arguments(matrix, 2.0, counts))
    assert scaled_sum(memory.ctypes.data) == 30.0
    matrix[0, 0] = 10.0
    assert scaled_sum(memory.ctypes.data) == 50.0
    assert counts[0] == 2


def test_no_more_memory_is_used_than_asked_for() -> None:
    memory = np.full(WORDS + 8, 7, np.int64)
    store(memory.ctypes.data, Arguments(np.zeros((1, 1)), 2.0, np.zeros(1, np.int64)))
    assert np.all(memory[WORDS:] == 7) and np.any(memory[WORDS - 2 : WORDS] != 7)
