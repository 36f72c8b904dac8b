r"""Products of rows on common carriers and breaks, with all of them at the same path coordinate, as tables.

With rows C(s) = b(s) U, values U X (K, c) on the carriers and R = U Q U^T (K, K) between them,

.. math:: C(s)\, X = b(s)\, (U X), \qquad C(s)\, Q\, C(s)^T = b(s)\, R\, b(s)^T
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.constraints.polynomials import same_degree
from pmr.constraints.rows import Row, gather

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
#: Entries of R that are gathered at once.
AT_ONCE = 2**20


@dataclass(frozen=True)
class RowPolynomials:
    """Coefficients of m rows, the highest power first, on the w carriers that they touch together on each interval."""

    breaks: Array  # (k + 1,) m
    touched: Indices  # (k, w)
    coefficients: Array  # (m, powers, k, w)

    @classmethod
    def of(cls, rows: Sequence[Row]) -> RowPolynomials:
        """Rows that have their carriers and breaks in common."""
        degree = same_degree(*(row.coefficients for row in rows))
        n, interval = rows[0].carriers.shape[0], np.arange(len(rows[0].breaks) - 1)
        touching = [interval[:, None] * n + row.touched for row in rows]
        different, place, touched = gather(np.concatenate(touching, axis=None), n, len(interval))
        coefficients = np.zeros((len(rows), len(degree[0]), *touched.shape))
        for of_row, c, numbers in zip(coefficients, degree, touching, strict=True):
            at = place[np.searchsorted(different, numbers)]
            for l in range(at.shape[1]):
                of_row[:, interval, at[:, l]] += c[:, :, l]
        return cls(rows[0].breaks, touched, coefficients)

    def times(self, X: Array) -> PPoly:
        """C(s) X, values (m, c), from U X (K, c) on the carriers."""
        m, powers, k, w = self.coefficients.shape
        blocks = self.coefficients.transpose(2, 0, 1, 3).reshape(k, m * powers, w)
        c = (blocks @ np.ascontiguousarray(X)[self.touched]).reshape(k, m, powers, X.shape[1])
        return PPoly(np.ascontiguousarray(c.transpose(2, 0, 1, 3)), self.breaks)

    def quadratic_form(self, R: sp.csr_matrix | Array) -> PPoly:
        """C(s) Q C(s)^T, values (m, m), from symmetric R (K, K) between the carriers.

        On an interval rows touch a few carriers only, so of R a small block counts, however long the path is.
        """
        m, powers, k, w = self.coefficients.shape
        blocks = self.coefficients.transpose(2, 1, 0, 3).reshape(k, powers * m, w)
        result, some = np.zeros((2 * powers - 1, k, m, m)), max(1, AT_ONCE // w**2)
        for j in range(0, k, some):
            at, b = self.touched[j : j + some], blocks[j : j + some]
            product = (b @ _entries_between(R, at) @ b.swapaxes(1, 2)).reshape(len(b), powers, m, powers, m)
            for p in range(powers):
                result[p : p + powers, j : j + some] += product[:, p].transpose(2, 0, 1, 3)
        return PPoly((result + result.swapaxes(2, 3)) / 2.0, self.breaks)


def _entries_between(R: sp.csr_matrix | Array, touched: Indices) -> Array:
    """Entries (k, w, w) of R between the carriers that each of k intervals touches (k, w)."""
    rows, columns = np.broadcast_arrays(touched[:, :, None], touched[:, None])
    if isinstance(R, np.ndarray):
        return np.asarray(R[rows, columns])
    return np.asarray(R[rows.ravel(), columns.ravel()]).reshape(rows.shape)
