"""Four numbers as one, against NumPy."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pmr.simulation.native.simd import LANES, load, spread, store, total

Array = NDArray[np.float64]


@njit
def fill(c: Array, a: Array, b: Array, x: float) -> float:
    sums = spread(1.0)
    for n in range(0, len(a), LANES):
        first, second = load(a, n), load(b, n)
        store(c, n, (first - second) * first + second * x - 2.0)
        sums = sums + first * second
    return total(sums)


def test_arithmetic_is_numpys() -> None:
    a, b = np.random.default_rng(0).standard_normal((2, 12))
    c = np.zeros(12)
    summed = fill(c, a, b, 3.0)
    np.testing.assert_allclose(c, (a - b) * a + 3.0 * b - 2.0, atol=1e-14)
    np.testing.assert_allclose(summed, 4.0 + a @ b)


def test_entries_need_no_alignment() -> None:
    a, b, c = np.random.default_rng(1).standard_normal((3, 13))
    fill(c[1:], a[1:], b[1:], 3.0)
    np.testing.assert_allclose(c[1:], (a - b)[1:] * a[1:] + 3.0 * b[1:] - 2.0, atol=1e-14)
