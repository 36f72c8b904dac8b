"""Piecewise polynomials times vectors along a path, compiled: SciPy would keep the values of all steps at once."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.constraints.polynomials import within_domain

Array = NDArray[np.float64]

# NaN and infinity stay visible, while sums may be reordered.
_compiled = njit(cache=True, nogil=True, error_model="numpy", fastmath={"reassoc", "contract", "nsz"})


def applied(table: PPoly, s: Array, x: Array, derivative: int = 0) -> Array:
    """A(s_t) x_t, (T, m), for a table with values (m, r), s (T,) m and x (T, r); or with a derivative of A.

    Raises
    ------
    ValueError
        If s leaves the table's domain.
    """
    c = table.c if derivative == 0 else table.derivative(derivative).c
    found = np.empty((len(s), c.shape[2]))
    _apply(np.ascontiguousarray(c), table.x, _within(table, s), np.ascontiguousarray(x, dtype=float), found)
    return found


def applied_change(table: PPoly, s: Array, x: Array) -> Array:
    """(A(s_{t+1}) - A(s_t)) x_t, (T - 1, m), for s (T,) m and x (T - 1, r); errors likewise."""
    found = np.empty((len(s) - 1, table.c.shape[2]))
    x = np.ascontiguousarray(x, dtype=float)
    _apply_change(np.ascontiguousarray(table.c), table.x, _within(table, s), x, found)
    return found


def _within(table: PPoly, s: Array) -> Array:
    return within_domain(s, table.x[0], table.x[-1], "slider")


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
def _apply(c: Array, breaks: Array, s: Array, x: Array, found: Array) -> None:
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
def _apply_change(c: Array, breaks: Array, s: Array, x: Array, found: Array) -> None:
    m, r = c.shape[2:]
    before, values, j = np.empty((m, r)), np.empty((m, r)), 0
    j = _evaluate(c, breaks, s[0], j, values)
    for t in range(len(found)):
        if s[t + 1] == s[t]:
            found[t] = 0.0
            continue
        before[:] = values
        j = _evaluate(c, breaks, s[t + 1], j, values)
        for a in range(m):
            total = 0.0
            for b in range(r):
                total += (values[a, b] - before[a, b]) * x[t, b]
            found[t, a] = total
