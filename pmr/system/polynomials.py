"""Exact algebra of piecewise polynomials in the path coordinate s (in m) with numbers, rows or matrices as values.

A table T(s) is a `scipy.interpolate.PPoly` with coefficients (powers, intervals, *shape), the highest power first, and
breaks (intervals + 1,) in m; `shape` is the shape of a value T(s).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, PPoly

from pmr.errors import BEYOND_ENDS
from pmr.files.arrays import Array, Indices

#: Most products of powers and entries of x that `_sum_powers` forms at once.
AT_ONCE = 2**18


def clip_to_domain(s: ArrayLike, low: float, high: float, label: str) -> Array:
    """Return `s` (any shape) in m as an array in which values beyond [low, high] by round-off are clipped.

    A ValueError that names `label` and the worst value is raised if a value is further outside or not finite.
    """
    s = np.asarray(s, dtype=float)
    slack = BEYOND_ENDS * (high - low)
    if s.size and not (s.min() >= low - slack and s.max() <= high + slack):
        worst = s.flat[np.argmax(np.maximum(low - s, s - high))] if np.all(np.isfinite(s)) else np.nan
        raise ValueError(f"{label}: s = {worst:g} m lies outside the path, allowed are {low:g} to {high:g} m")
    return np.minimum(np.maximum(s, low), high)  # `np.clip` takes several times as long for a few


def evaluate(table: PPoly, s: ArrayLike, derivative: int = 0, label: str = "slider") -> Array:
    """Values ``(*s.shape, *shape)`` of a table at s in m, or of its derivative with the order `derivative`.

    `shape` is the shape of the table's values.  Where s is outside the table's breaks by round-off, the values are
    those at the nearest end.  If s is further outside, a ValueError that names `label` is raised.
    """
    return np.asarray(table(clip_to_domain(s, table.x[0], table.x[-1], label), nu=derivative))


def apply_table(table: PPoly, s: Array, x: Array, derivative: int = 0) -> Array:
    """Product A(s_t) x_t (T, m) for a table A with values (m, r), s (T,) in m and x (T, r), at all T times.

    With a `derivative` of 1 or more, that derivative of A with respect to s is used instead of A.  A ValueError is
    raised if s leaves the table's domain.  The matrices A(s_t) of all times are never stored at once, as `PPoly` would
    do.
    """
    table = table if derivative == 0 else table.derivative(derivative)
    s = clip_to_domain(s, table.x[0], table.x[-1], "slider")
    interval = np.searchsorted(table.x[1:-1], s, side="right")
    return _sum_powers(table, interval, _powers(s - table.x[interval], len(table.c)), np.asarray(x, dtype=float))


def _powers(x: Array, count: int) -> Array:
    """Powers of x (T,) as an array (`count`, T), from the exponent `count` - 1 to 0; faster than `numpy.vander`."""
    powers = np.ones((count, len(x)))
    for k in range(count - 1, 0, -1):
        np.multiply(powers[k], x, out=powers[k - 1])
    return powers


def _sum_powers(table: PPoly, interval: Indices, powers: Array, x: Array) -> Array:
    """Products (T, m) of a table's values (m, r) and x (T, r), as a sum over the table's p powers.

    Each summand is a coefficient times the powers in `powers` (p, T) times x.  `interval` (T,) is the number of the
    table's interval at each time.  Successive times on the same interval are computed together.
    """
    count, _, m, r = table.c.shape
    products, few = np.empty((len(x), m)), m < r  # multiply powers by A x (m,) or by x (r,), whichever is shorter
    most, first = max(1, AT_ONCE // max(1, count * min(m, r))), 0
    for end in [*(np.flatnonzero(np.diff(interval)) + 1), len(x)]:
        while first < end:
            at = slice(first, min(first + most, end))
            c = table.c[:, interval[first]]
            if few:  # one product for all powers; the times are the last axis, along which NumPy adds fastest
                of_powers = (c.reshape(count * m, r) @ x[at].T).reshape(count, m, at.stop - first)
                of_powers *= powers[:, None, at]
                products[at] = of_powers.sum(axis=0).T
            else:
                powers_of_x = powers[:, at].T[:, :, None] * x[at, None, :]
                products[at] = powers_of_x.reshape(len(powers_of_x), count * r) @ c.transpose(0, 2, 1).reshape(
                    count * r, m
                )
            first = at.stop
    return products


def power_contributions(table: PPoly) -> Array:
    """Coefficients (p, k, ...) of p powers on k intervals, each times the interval's length raised to this power.

    Such a product is the largest contribution of a power to the values of `table` on the interval, in the unit of the
    values.
    """
    powers = np.arange(len(table.c) - 1, -1, -1)
    size = np.diff(table.x)[None, :] ** powers[:, None]
    return np.asarray(table.c * size.reshape(*size.shape, *[1] * (table.c.ndim - 2)))


def multiply_tables(A: PPoly, B: PPoly, W: Array) -> PPoly:
    """Table A(s) W B(s)^T with values (m, n), for a matrix W (r, q) and tables A and B on the same breaks.

    A has values (m, r), and B has values (n, q).
    """
    result = np.zeros((len(A.c) + len(B.c) - 1, A.c.shape[1], A.c.shape[2], B.c.shape[2]))
    for p, Ap in enumerate(A.c):
        for q, Bq in enumerate(B.c):
            result[p + q] += Ap @ W @ Bq.swapaxes(1, 2)
    return PPoly(result, A.x)


def multiply_matrix(A: PPoly, X: Array) -> PPoly:
    """Table A(s) X, values (m, n), for a table A with values (m, r) and a matrix X (r, n)."""
    return PPoly(np.ascontiguousarray(A.c @ X), A.x)


def transpose(A: PPoly) -> PPoly:
    """Table A(s)^T, values (n, m), for a table A with values (m, n)."""
    return PPoly(np.ascontiguousarray(A.c.swapaxes(2, 3)), A.x)


def add_tables(A: PPoly, B: PPoly, factor: float) -> PPoly:
    """Table A(s) + factor B(s) of two tables with values of the same shape.

    Breaks and degrees of A and B may differ; the result has the domain of A, on which B is continued (`refine_table`).
    """
    A, B = align_tables(A, B)
    return PPoly(A.c + factor * B.c, A.x)


def select_columns(table: PPoly, numbers: slice | Sequence[int]) -> PPoly:
    """Table of the columns with these `numbers`, of a table with values (m, n).

    The table itself is returned if all columns are selected in their order.
    """
    if _selects_all(numbers, table.c.shape[3]):
        return table
    return PPoly(np.ascontiguousarray(table.c[..., numbers]), table.x)


def select_rows(table: PPoly, numbers: slice | Sequence[int] | Indices) -> PPoly:
    """Table of the rows with these `numbers`, of a table with values (m, n).

    The table itself is returned if all rows are selected in their order.
    """
    if _selects_all(numbers, table.c.shape[2]):
        return table
    return PPoly(np.ascontiguousarray(table.c[:, :, numbers]), table.x)


def _selects_all(numbers: slice | Sequence[int] | Indices, count: int) -> bool:
    """Whether `numbers`, a slice or indices (k,), select all of the indices 0 to `count` - 1, in their order."""
    return np.array_equal(np.arange(count)[numbers], np.arange(count))


def stack_tables(tables: Sequence[PPoly], domain: tuple[float, float], columns: int = 0) -> PPoly:
    """Table with values (m, r) on `domain` in m, from m tables with values (r,), which may have any breaks.

    If there are no tables, r is `columns`.
    """
    if not tables:
        return PPoly(np.zeros((1, 1, 0, columns)), np.array(domain))
    common = align_tables(*tables, domain=domain)
    return PPoly(np.stack([table.c for table in common], axis=2), common[0].x)


def align_tables(*tables: PPoly, domain: tuple[float, float] | None = None) -> list[PPoly]:
    """Return these tables on common breaks and with the same degree, exactly.

    `domain` is the (lowest, highest) s in m that they cover; None stands for the domain of the first table.  Tables
    that end within the domain are continued (`refine_table`).
    """
    if domain is None and all(np.array_equal(table.x, tables[0].x) for table in tables):
        breaks = tables[0].x
        return [PPoly(c, breaks) for c in same_degree(*(table.c for table in tables))]
    breaks = common_breaks(tables, (float(tables[0].x[0]), float(tables[0].x[-1])) if domain is None else domain)
    degree = max(len(table.c) for table in tables) - 1
    return [refine_table(table, breaks, degree) for table in tables]


def same_degree(*coefficients: Array) -> list[Array]:
    """Arrays of coefficients (p, ...) with zeros in front, so that all have one degree, the highest among them."""
    most = max(map(len, coefficients))
    return [np.concatenate([np.zeros((most - len(c), *c.shape[1:])), c]) for c in coefficients]


def common_breaks(tables: Sequence[PPoly], domain: tuple[float, float]) -> Array:
    """Breaks (k + 1,) in m that cover `domain`, between which each of `tables` is a single polynomial.

    A break that is closer to the preceding one than 1e-12 of the domain's length is left out, unless it is the last.
    """
    low, high = domain
    inner = np.concatenate([[low, high], *(table.x for table in tables)])
    breaks = np.unique(inner[(inner >= low) & (inner <= high)])
    apart = np.concatenate([[True], np.diff(breaks) > 1e-12 * (high - low)])
    apart[-1] = True
    return np.asarray(breaks[apart])


def refine_table(table: PPoly, breaks: Array, degree: int | None = None) -> PPoly:
    """Return the same piecewise polynomial on finer `breaks` (k + 1,), exactly.

    The breaks must contain all breaks of the table within their range.  Beyond the table's own range its first or last
    polynomial is continued.  The result has the `degree`, with zeros as coefficients of powers that the table lacks;
    None keeps the table's degree.
    """
    source = interval_around(breaks, table.x)
    c = shift_powers(table.c[:, source], (breaks[:-1] - table.x[source]).reshape(-1, *[1] * (table.c.ndim - 2)))
    missing = 0 if degree is None else degree + 1 - len(c)
    return PPoly(np.concatenate([np.zeros((missing, *c.shape[1:])), c]), breaks)


def shift_powers(c: Array, x: Array) -> Array:
    """Coefficients (powers, ...) of polynomials in t - x, from their coefficients c (powers, ...) in t.

    Highest powers come first.  The shape of x is broadcast to that of ``c[0]``.  The method is repeated synthetic
    division (Knuth, TAOCP 2, 4.6.4).
    """
    c = c.copy()
    for last in range(len(c), 1, -1):
        for p in range(1, last):
            c[p] += c[p - 1] * x
    return c


def interval_around(fine: Array, coarse: Array) -> Indices:
    """Number (k,) of the interval of `coarse` breaks (j + 1,) that contains each interval of `fine` breaks (k + 1,).

    A fine interval outside of all coarse ones has the number of the first or the last coarse interval.
    """
    middle = (fine[1:] + fine[:-1]) / 2.0
    return np.clip(np.searchsorted(coarse, middle, side="right") - 1, 0, len(coarse) - 2)


@lru_cache(maxsize=32)  # the pads of a ring use the same few splines at many places
def cardinal_spline(degree: int, knot: float) -> PPoly:
    r"""Centred cardinal B-spline b with the knot distance `knot` = H and the integral H, between its outermost knots.

    Outside of these b is zero (`value_or_zero`).  The table is cached, and shared by all calls with the same arguments.
    The spline of degree 3 is C2.  At points x_k with spacing H / p the
    values, divided by p, satisfy for any s

    .. math:: \sum_k b(x_k - s) = 1, \qquad \sum_k b(x_k - s)\, x_k = s, \qquad x_k = x_0 + k H / p,\; p = 1, 2, \dots

    So sums of b over a lattice of points move as a rigid body does.  De Boor: A Practical Guide to Splines, rev. ed.,
    2001, chapter IX (Marsden's identity).
    """
    knots = (np.arange(degree + 2) - (degree + 1) / 2.0) * knot
    spline = PPoly.from_spline(BSpline.basis_element(knots, extrapolate=False).tck)
    inside = slice(degree, 2 * degree + 1)  # `from_spline` pads with empty intervals
    return PPoly(spline.c[:, inside], spline.x[degree : 2 * degree + 2])


def value_or_zero(spline: PPoly, x: Array) -> Array:
    """Values of a spline at x (any shape), in the shape of x, with zeros outside the spline's knots."""
    within = (x > spline.x[0]) & (x < spline.x[-1])
    return np.where(within, spline(np.where(within, x, 0.0)), 0.0)
