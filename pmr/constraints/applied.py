"""Piecewise polynomials times vectors along a path, compiled: `pmr.constraints.polynomials` has what they are for."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


def _compiled(function: Callable[..., Any]) -> Any:
    """Compiled on the first call; NaN and infinity stay visible, while sums may be reordered."""
    dispatcher = njit(nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})(function)
    with suppress(RuntimeError):  # no folder can be written to: it is compiled anew in each process
        dispatcher.enable_caching()
    return dispatcher


@_compiled
def _evaluate(c: Array, breaks: Array, s: float, j: int, values: Array) -> int:
    """Values (m, r) at s, and the number of its interval, sought from j on."""
    powers, intervals, m, r = c.shape
    while j > 0 and s < breaks[j]:
        j -= 1
    while j < intervals - 1 and s >= breaks[j + 1]:
        j += 1
    d = s - breaks[j]
    for a in range(m):
        for b in range(r):
            values[a, b] = c[0, j, a, b]
        for p in range(1, powers):
            for b in range(r):
                values[a, b] = values[a, b] * d + c[p, j, a, b]
    return j


@_compiled
def apply(c: Array, breaks: Array, s: Array, x: Array, found: Array) -> None:
    """A(s_t) x_t into `found` (T, m)."""
    m, r = c.shape[2:]
    values, j = np.empty((m, r)), 0
    for t in range(len(s)):
        if t == 0 or s[t] != s[t - 1]:
            j = _evaluate(c, breaks, s[t], j, values)
        for a in range(m):
            total = 0.0
            for b in range(r):
                total += values[a, b] * x[t, b]
            found[t, a] = total


@_compiled
def apply_change(c: Array, breaks: Array, s: Array, x: Array, found: Array) -> None:
    """(A(s_{t+1}) - A(s_t)) x_t into `found` (T - 1, m)."""
    m, r = c.shape[2:]
    before, values, j = np.empty((m, r)), np.empty((m, r)), 0
    j = _evaluate(c, breaks, s[0], j, values)
    for t in range(len(found)):
        if s[t + 1] == s[t]:
            found[t] = 0.0
            continue
        for a in range(m):  # before[:] = values takes three seconds to compile, for the error that it may raise
            for b in range(r):
                before[a, b] = values[a, b]
        j = _evaluate(c, breaks, s[t + 1], j, values)
        for a in range(m):
            total = 0.0
            for b in range(r):
                total += (values[a, b] - before[a, b]) * x[t, b]
            found[t, a] = total
