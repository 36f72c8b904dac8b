"""Named tuples by their address: compiled code reads what stands in them, and writes to their arrays."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import njit, types
from numpy.typing import NDArray

from pmr.simulation.native.compilation import addressed
from pmr.simulation.native.handles import address_of, call, handle, instead, number, words_of

Array = NDArray[np.float64]


class Inner(NamedTuple):
    counts: NDArray[np.int64]
    size: int
    nothing: Any = None


class Outer(NamedTuple):
    factor: float
    matrix: Array
    inner: Inner
    marked: NDArray[np.bool_]


@njit(_nrt=False)
def _unless(nothing: Any, value: float) -> float:
    if nothing is None:  # decided when compiled
        return value
    return 0.0


@njit(_nrt=False)
def scaled_sum(held: Outer) -> float:
    total = 0.0
    for i in range(held.matrix.shape[0]):
        for j in range(held.matrix.shape[1]):
            total += held.matrix[i, j]
    for k in range(len(held.marked)):
        held.inner.counts[k] += held.marked[k]
    return _unless(held.inner.nothing, total * held.factor + held.inner.size)


@njit(_nrt=False)
def scaled_sum_of_another(held: Outer, words: NDArray[np.int64]) -> float:
    return scaled_sum(instead(held, words))


@addressed
def added(held: Outer, row: Array, shift: int) -> int:
    for k in range(len(row)):
        row[k] += held.factor
    return shift + len(row)


@addressed
def first_of(row: Array) -> float:
    return row[0]


@njit(_nrt=False)
def called_by_addresses(held: Outer, one: int, other: int) -> float:
    count = call(one, (held, held.matrix[1], -1))
    return count + number(other, (held.matrix[1],))


def _example(factor: float = 2.0) -> Outer:
    marked = np.array([True, False, True])
    return Outer(factor, np.arange(6.0).reshape(2, 3), Inner(np.zeros(3, np.int64), 7), marked)


def test_all_fields_are_read_and_arrays_are_the_same() -> None:
    values = _example()
    held = handle(values)
    assert scaled_sum(held) == 2.0 * 15.0 + 7.0
    values.matrix[0, 0] = 10.0
    assert scaled_sum(held) == 2.0 * 25.0 + 7.0
    assert values.inner.counts.tolist() == [2, 0, 2]


def test_memory_of_another_one_is_read_instead() -> None:
    values, other = _example(), _example(-1.0)
    assert scaled_sum_of_another(handle(values), words_of(other)) == -15.0 + 7.0
    assert values.inner.counts.tolist() == [0, 0, 0] and other.inner.counts.tolist() == [1, 0, 1]


def test_what_stands_at_an_address_is_called() -> None:
    """With a handle, a row and a number; it is compiled once."""
    held, row = handle(_example()), types.Array(types.float64, 1, "C")
    one, other = address_of(added, held.kind, row, types.int64), address_of(first_of, row)
    assert called_by_addresses(held, one, other) == (-1 + 3) + (3.0 + 2.0)
    assert address_of(added, held.kind, row, types.int64) == one and len(added.overloads) == 1


def test_arrays_and_the_memory_live_as_long_as_the_handle() -> None:
    held = handle(_example())
    kept = [np.full(1000, np.nan) for _ in range(100)]  # takes what would have been freed
    assert scaled_sum(held) == 37.0 and len(kept) == 100


def test_an_array_in_another_order_is_refused() -> None:
    with pytest.raises(TypeError, match="C order"):
        handle(_example()._replace(matrix=np.zeros((3, 2)).T))


def test_the_types_of_what_is_alike_are_the_same() -> None:
    one, other = handle(_example()), handle(_example(3.0))
    assert one.kind == other.kind
    assert handle(_example()._replace(inner=Inner(np.zeros(3, np.int64), 7, 1.0))).kind != one.kind
