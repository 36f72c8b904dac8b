"""Algebra of piecewise polynomials in the path coordinate s whose values are numbers, rows or matrices; exact.

A table T(s) is a `scipy.interpolate.PPoly`: coefficients (powers, intervals, *shape), the highest power first, between
breaks (intervals + 1,) in m.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, PPoly

from pmr.errors import BEYOND_ENDS

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
#: Products of powers and entries of x that are formed at once.
AT_ONCE = 2**18


def within_domain(s: ArrayLike, low: float, high: float, what: str) -> Array:
    """`s` as an array within [low, high], or a ValueError that says by how much it lies outside."""
    s = np.asarray(s, dtype=float)
    slack = BEYOND_ENDS * (high - low)
    if s.size and not (s.min() >= low - slack and s.max() <= high + slack):
        worst = s.flat[np.argmax(np.maximum(low - s, s - high))] if np.all(np.isfinite(s)) else np.nan
        raise ValueError(f"{what}: s = {worst:g} m lies outside the path, allowed are {low:g} to {high:g} m")
    return np.minimum(np.maximum(s, low), high)  # `np.clip` takes several times as long for a few


def evaluate(table: PPoly, s: ArrayLike, derivative: int = 0, what: str = "slider") -> Array:
    """Values of a piecewise polynomial at s, refused outside its domain; shape ``s.shape + table.c.shape[2:]``."""
    return np.asarray(table(within_domain(s, table.x[0], table.x[-1], what), nu=derivative))


def apply_table(table: PPoly, s: Array, x: Array, derivative: int = 0) -> Array:
    """A(s_t) x_t, (T, m), for a table with values (m, r), s (T,) m and x (T, r); or with a derivative of A.

    A ValueError is raised where s leaves the table's domain.  SciPy would keep the values of all steps at once.
    """
    table = table if derivative == 0 else table.derivative(derivative)
    s = within_domain(s, table.x[0], table.x[-1], "slider")
    interval = _interval(table, s)
    return _sum_powers(table, interval, _powers(s - table.x[interval], len(table.c)), np.asarray(x, dtype=float))


def _interval(table: PPoly, s: Array) -> Indices:
    """(T,): the number of the table's interval at each s."""
    return np.searchsorted(table.x[1:-1], s, side="right")


def _powers(x: Array, count: int) -> Array:
    """(count, T): powers of x, the highest first; `numpy.vander` takes several times as long."""
    powers = np.ones((count, len(x)))
    for k in range(count - 1, 0, -1):
        np.multiply(powers[k], x, out=powers[k - 1])
    return powers


def _sum_powers(table: PPoly, interval: Indices, powers: Array, x: Array) -> Array:
    """Sum coefficients on each step's interval times `powers` (p, T) times x (T, r), to (T, m).

    Steps in a row on the same interval are taken at once.
    """
    count, _, m, r = table.c.shape
    products, few = np.empty((len(x), m)), m < r  # powers take what the table measures, or what it takes: the fewer
    most, first = max(1, AT_ONCE // max(1, count * min(m, r))), 0
    for end in [*(np.flatnonzero(np.diff(interval)) + 1), len(x)]:
        while first < end:
            at = slice(first, min(first + most, end))
            c = table.c[:, interval[first]]
            if few:  # one product for all powers, with the steps last, along which NumPy adds fastest
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


def contributions(table: PPoly) -> Array:
    """Coefficients (p, k, ...) times their interval's length to the matching power: the most that each adds."""
    powers = np.arange(len(table.c) - 1, -1, -1)
    size = np.diff(table.x)[None, :] ** powers[:, None]
    return np.asarray(table.c * size.reshape(*size.shape, *[1] * (table.c.ndim - 2)))


def product(A: PPoly, B: PPoly, W: Array | None = None) -> PPoly:
    """A(s) W B(s)^T, values (m, n), of tables on the same breaks with values (m, r) and (n, q).

    W is a matrix (r, q), the diagonal (r,) of one, or the identity where it is left out.
    """
    result = np.zeros((len(A.c) + len(B.c) - 1, A.c.shape[1], A.c.shape[2], B.c.shape[2]))
    for p, Ap in enumerate(A.c):
        weighted = Ap if W is None else Ap * W if W.ndim == 1 else Ap @ W
        for q, Bq in enumerate(B.c):
            result[p + q] += weighted @ Bq.swapaxes(1, 2)
    return PPoly(result, A.x)


def times(A: PPoly, X: Array) -> PPoly:
    """A(s) X, values (m, n), for a table with values (m, r) and X (r, n)."""
    return PPoly(np.ascontiguousarray(A.c @ X), A.x)


def transpose(A: PPoly) -> PPoly:
    """A(s)^T."""
    return PPoly(np.ascontiguousarray(A.c.swapaxes(2, 3)), A.x)


def total(A: PPoly, B: PPoly, factor: float = 1.0) -> PPoly:
    """A(s) + factor B(s) of tables on the same domain, whatever their breaks and degrees."""
    A, B = align_tables(A, B)
    return PPoly(A.c + factor * B.c, A.x)


def columns(table: PPoly, which: slice | Sequence[int]) -> PPoly:
    """The chosen columns of the values."""
    if _all(which, table.c.shape[3]):
        return table
    return PPoly(np.ascontiguousarray(table.c[..., which]), table.x)


def select_rows(table: PPoly, which: slice | Sequence[int] | Indices) -> PPoly:
    """The chosen rows of the values (m, n)."""
    if _all(which, table.c.shape[2]):
        return table
    return PPoly(np.ascontiguousarray(table.c[:, :, which]), table.x)


def _all(which: slice | Sequence[int] | Indices, count: int) -> bool:
    """Whether these are all, in their order."""
    return np.array_equal(np.arange(count)[which], np.arange(count))


def stack_tables(tables: Sequence[PPoly], domain: tuple[float, float]) -> PPoly:
    """Tables with their own breaks and values (r,) as the rows of one with values (m, r) within `domain`."""
    common = align_tables(*tables, domain=domain)
    return PPoly(np.stack([table.c for table in common], axis=2), common[0].x)


def side_by_side(*tables: PPoly) -> PPoly:
    """The columns of all tables, values (m, n_1 + n_2 + ...)."""
    common = align_tables(*tables)
    return PPoly(np.concatenate([table.c for table in common], axis=3), common[0].x)


def align_tables(*tables: PPoly, domain: tuple[float, float] | None = None) -> list[PPoly]:
    """Return these tables on common breaks and of the same degree within `domain`, by default that of the first one."""
    if domain is None and all(np.array_equal(table.x, tables[0].x) for table in tables):
        breaks = tables[0].x
        return [PPoly(c, breaks) for c in same_degree(*(table.c for table in tables))]
    breaks = common_breaks(tables, (float(tables[0].x[0]), float(tables[0].x[-1])) if domain is None else domain)
    degree = max(len(table.c) for table in tables) - 1
    return [refine_table(table, breaks, degree) for table in tables]


def same_degree(*coefficients: Array) -> list[Array]:
    """Coefficients with zeros before those of lower degree."""
    most = max(map(len, coefficients))
    return [np.concatenate([np.zeros((most - len(c), *c.shape[1:])), c]) for c in coefficients]


def common_breaks(tables: Sequence[PPoly], domain: tuple[float, float]) -> Array:
    """Breaks (k + 1,) in m within `domain`, such that every table is a polynomial between two of them."""
    low, high = domain
    inner = np.concatenate([table.x for table in tables])
    breaks = np.unique(np.concatenate([[low, high], inner[(inner > low) & (inner < high)]]))
    apart = np.concatenate([[True], np.diff(breaks) > 1e-12 * (high - low)])
    apart[-1] = True
    return np.asarray(breaks[apart])


def refine_table(table: PPoly, breaks: Array, degree: int | None = None) -> PPoly:
    """Return this piecewise polynomial on finer breaks, its degree raised to `degree`: exact."""
    source = interval_around(breaks, table.x)
    c = table.c[:, source].copy()
    x = (breaks[:-1] - table.x[source]).reshape(-1, *[1] * (c.ndim - 2))
    # Taylor shift by repeated synthetic division (Knuth, TAOCP 2, 4.6.4).
    for last in range(len(c), 1, -1):
        for p in range(1, last):
            c[p] += c[p - 1] * x
    missing = 0 if degree is None else degree + 1 - len(c)
    return PPoly(np.concatenate([np.zeros((missing, *c.shape[1:])), c]), breaks)


def interval_around(fine: Array, coarse: Array) -> NDArray[np.int64]:
    """Number (k,) of the coarse interval around each of k finer ones."""
    middle = (fine[1:] + fine[:-1]) / 2.0
    return np.clip(np.searchsorted(coarse, middle, side="right") - 1, 0, len(coarse) - 2)


@lru_cache(maxsize=32)  # pads of a ring have the same few, at many places
def bump(degree: int, knot: float) -> PPoly:
    r"""Centred cardinal B-spline b with knots `knot` apart, H, and as its integral; zero outside its knots.

    That of degree 3 is C2, and for any s, after division by p,

    .. math:: \sum_k b(x_k - s) = 1, \qquad \sum_k b(x_k - s)\, x_k = s, \qquad x_k = x_0 + k H / p,\; p = 1, 2, \dots

    Sums of it over a lattice move as a rigid body does.  De Boor: A Practical Guide to Splines, rev. ed., 2001, chapter
    IX (Marsden's identity).
    """
    knots = (np.arange(degree + 2) - (degree + 1) / 2.0) * knot
    spline = PPoly.from_spline(BSpline.basis_element(knots, extrapolate=False).tck)
    inside = slice(degree, 2 * degree + 1)  # `from_spline` pads with empty intervals
    return PPoly(spline.c[:, inside], spline.x[degree : 2 * degree + 2])


def value_or_zero(spline: PPoly, x: Array) -> Array:
    """The spline at x of any shape; zero outside its knots."""
    within = (x > spline.x[0]) & (x < spline.x[-1])
    return np.where(within, spline(np.where(within, x, 0.0)), 0.0)
