"""Sums and products of tables in s: piecewise polynomials whose values are matrices, exact."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.sliding import common_breaks, rebased

Array = NDArray[np.float64]


def product(A: PPoly, B: PPoly, weights: Array) -> PPoly:
    """A(s) diag(weights) B(s)^T, values (m, n), of tables on the same breaks with values (m, r) and (n, r)."""
    result = np.zeros((len(A.c) + len(B.c) - 1, A.c.shape[1], A.c.shape[2], B.c.shape[2]))
    for p, Ap in enumerate(A.c):
        for q, Bq in enumerate(B.c):
            result[p + q] += (Ap * weights) @ Bq.swapaxes(1, 2)
    return PPoly(result, A.x)


def times(A: PPoly, X: Array) -> PPoly:
    """A(s) X, values (m, n), for a table with values (m, r) and X (r, n)."""
    return PPoly(np.ascontiguousarray(A.c @ X), A.x)


def transposed(A: PPoly) -> PPoly:
    """A(s)^T."""
    return PPoly(np.ascontiguousarray(A.c.swapaxes(2, 3)), A.x)


def total(A: PPoly, B: PPoly, factor: float = 1.0) -> PPoly:
    """A(s) + factor B(s) of tables on the same domain, whatever their breaks and degrees."""
    if not np.array_equal(A.x, B.x):
        breaks = common_breaks([A, B], (float(A.x[0]), float(A.x[-1])))
        A, B = rebased(A, breaks), rebased(B, breaks)
    degree = max(len(A.c), len(B.c))
    result = np.zeros((degree, *A.c.shape[1:]))
    result[degree - len(A.c) :] += A.c
    result[degree - len(B.c) :] += factor * B.c
    return PPoly(result, A.x)
