r"""Constraint rows C(s) of sliders and pads, exact in the path coordinate s.

.. math:: C(s) = b(s)\, U

U (K, n) is fixed and sparse: its K rows, the *carriers*, are the displacements that the constraint row combines.  The
weights b(s) (K,) are a piecewise polynomial; on each interval of s, only a few of them are not zero.  A slider holds
the interpolated displacement of a beam: its carriers are the coordinates themselves, its weights the shape functions of
one element, C1 for cubic Hermite elements.  A pad that slides over a mesh touches thousands of coordinates, but only
through K weighted means.  Quantities of the full model along the path, such as the compliance U R U^T with the
flexibility R, then take K static solves, however fine the mesh is.  If several rows together touch fewer than K / 2
coordinates, as pads on a beam do, these coordinates are the common carriers of the rows.

Products of rows C(s) = b(s) U, on common carriers and breaks and at the same path coordinate, are tables in s.  With
the values U X (K, c) of a matrix X (n, c) on the carriers, and the values R = U Q U^T (K, K) of a symmetric matrix Q
(n, n) between the carriers,

.. math:: C(s)\, X = b(s)\, (U X), \qquad C(s)\, Q\, C(s)^T = b(s)\, R\, b(s)^T

`StraightRows` are two rows that are zero if a beam does not bend between a fixed point and a moving one.  With the row
w(x) of the beam's displacement at x, the fixed point at p and the moving one at s,

.. math:: w(p) + (s - p)\, w'(p) - w(s) = 0 \qquad \text{and} \qquad (s - p)\, w'(s) - w(s) + w(p) = 0

both points have the slope of the line through them.  Both rows are zero for rigid motions, so their multipliers exert
no resultant force and no resultant moment.  The multipliers are in N; times s - p they are moments in N m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.interpolate import PPoly

from pmr.errors import BEYOND_ENDS
from pmr.files.arrays import Array, Indices
from pmr.scene.signals.base import Interval
from pmr.system.polynomials import clip_to_domain, common_breaks, interval_around, refine_table, same_degree


class TouchedWeights(NamedTuple):
    """Numbers of the carriers or coordinates that rows touch, and their weights.

    The function that returns them states their shapes.
    """

    touched: Indices
    weights: Array


@cache
def _power_derivatives(count: int) -> Array:
    """Exponents and factors (2, 3, count) of x^(count - 1) to x^0 and of their first and second derivatives."""
    exponents, factors = np.arange(count - 1.0, -1.0, -1.0), np.ones(count)
    by_order = []
    for order in range(3):
        by_order.append([np.maximum(exponents - order, 0.0), factors])
        factors = factors * (exponents - order)
    return np.array(by_order).swapaxes(0, 1)


@dataclass(frozen=True)
class Row:
    """One constraint row C(s) = b(s) U of a full model on K carriers, which are the rows of U (K, n).

    The weights of the carriers are b(s) (K,).  On each interval of s, the row touches d of the carriers.  On
    ``[breaks[j], breaks[j + 1]]`` it is ``C(s) = sum_l sum_p coefficients[p, j, l] (s - breaks[j])**(degree - p)
    carriers[touched[j, l]]``.
    """

    name: str  # shown in messages, tables and charts
    breaks: Array  # (k + 1,) m
    carriers: sp.csr_matrix  # U (K, n)
    touched: Indices  # (k, d): numbers of the carriers that the row touches on each of k intervals
    coefficients: Array  # (degree + 1, k, d): highest power first, as in `scipy.interpolate.PPoly`
    compliance: float = 0.0  # m/N: 1/k of a pad with C q = lambda / k; 0 for a rigid pad
    # m: value of C q at which a row that only pushes closes; None for a row that holds both ways
    clearance: float | None = None
    unit: str = "N"  # of the multiplier: N, or N m if the row measures a rotation

    @cached_property
    def _polynomial(self) -> PPoly:
        """Weights of the d touched carriers as a piecewise polynomial in s with values (d,)."""
        return PPoly(*(np.require(array, requirements="W") for array in (self.coefficients, self.breaks)))

    @property
    def slope(self) -> Row:
        """Row on the same carriers that is the derivative dC/ds of this row."""
        degree = len(self.coefficients) - 1
        lowered = self.coefficients[:-1] * np.arange(degree, 0.0, -1.0)[:, None, None]
        return replace(self, coefficients=lowered if degree else np.zeros_like(self.coefficients))

    @cached_property
    def entries(self) -> sp.csr_matrix:
        """Coefficients as a sparse matrix (powers k, K): for each power, highest first, one row per interval."""
        powers, k, d = self.coefficients.shape
        at = np.broadcast_to(self.touched, (powers, k, d)).ravel()
        return sp.csr_matrix((self.coefficients.ravel(), at, d * np.arange(powers * k + 1)), (powers * k, self._count))

    @property
    def _count(self) -> int:
        """Number K of carriers."""
        return int(self.carriers.shape[0])

    def restrict_to(self, ranges: Sequence[Interval]) -> Row:
        """Row with zeros on those intervals between breaks that lie outside all `ranges` of s in m.

        An interval that is partly in a range is not changed.  An interval with zeros touches the same carriers as the
        first interval in a range, so that the row needs no carriers for its zeros.
        """
        slack = BEYOND_ENDS * (self.breaks[-1] - self.breaks[0])
        begin, end = self.breaks[:-1] - slack, self.breaks[1:] + slack
        inside = np.any([(low <= end) & (begin <= high) for low, high in ranges], axis=0)[:, None]
        touched = np.where(inside, self.touched, self.touched[inside.argmax()])
        return replace(self, touched=touched, coefficients=self.coefficients * inside)

    def weights(self, s: ArrayLike, derivative: int = 0) -> sp.csr_matrix:
        """Weights b(s) at s (T,) in m, or their derivative of the order `derivative` with respect to s: sparse (T, K).

        A ValueError is raised if s is outside the path.
        """
        return self._sparse(*self.touched_weights(s, derivative))

    def _sparse(self, touched: Indices, entries: Array) -> sp.csr_matrix:
        """Sparse matrix (T, K) with `entries` (T, d) in the columns `touched` (T, d) of each row."""
        ends = touched.shape[1] * np.arange(len(touched) + 1)
        return sp.csr_matrix((entries.ravel(), touched.ravel(), ends), (len(touched), self._count))

    def touched_weights(self, s: ArrayLike, derivative: int) -> TouchedWeights:
        """Numbers of the carriers that the row touches at s (T,) in m, and their weights b(s), both (T, d).

        With a `derivative` of 1 or more, the weights are that derivative of b by s.  A ValueError is raised if s is
        outside the path.
        """
        s = clip_to_domain(np.atleast_1d(np.asarray(s, float)), self.breaks[0], self.breaks[-1], self.name)
        j = np.searchsorted(self.breaks[1:-1], s, side="right")
        return TouchedWeights(self.touched[j], self._polynomial(s, nu=derivative))

    def derivatives(self, s: float) -> TouchedWeights:
        """Numbers (d,) of the carriers that the row touches at s in m, and their weights with two derivatives (3, d).

        If s is beyond an end of the row, the result is that at this end.
        """
        at = min(max(s, self.breaks[0]), self.breaks[-1])
        j = int(self.breaks[1:-1].searchsorted(at, side="right"))
        exponents, factors = _power_derivatives(len(self.coefficients))
        b = (factors * (at - self.breaks[j]) ** exponents) @ self.coefficients[:, j]
        return TouchedWeights(self.touched[j], b)

    def at(self, s: ArrayLike, derivative: int = 0) -> sp.csr_matrix:
        """Row C(s) at s (T,) in m, or its derivative of the order `derivative` with respect to s: sparse (T, n).

        A ValueError is raised if s is outside the path.
        """
        return self.weights(s, derivative) @ self.carriers

    def forces_on_coordinates(self, s: Array, force: Array, derivative: int = 0) -> sp.csr_matrix:
        """Multipliers `force` (T,) times C(s) at s (T,) in m: sparse (T, n).

        With a `derivative` of 1 or more, that derivative of C with respect to s is used instead of C.  Raises
        ValueError if s is outside the path.
        """
        touched, b = self.touched_weights(s, derivative)
        return self._sparse(touched, b * force[:, None]) @ self.carriers

    def apply(self, s: Array, q: Array, derivative: int = 0) -> Array:
        """Product C(s) q (T,) for s (T,) in m and coordinates q (T, n).

        With a `derivative` of 1 or more, that derivative of C with respect to s is used instead of C.  Raises
        ValueError if s is outside the path.
        """
        touched, b = self.touched_weights(s, derivative)
        return np.einsum("td,td->t", b, np.take_along_axis((self.carriers @ q.T).T, touched, axis=1))

    @property
    def moves(self) -> bool:
        """Whether the row depends on s."""
        return len(self.breaks) > 2 or len(self.coefficients) > 1

    @cached_property
    def held_coordinate(self) -> int | None:
        """Number of the coordinate that the row holds at zero.

        None is returned if the row is not fixed (`is_fixed`) or has any other entry than a single 1.
        """
        if not self.is_fixed:
            return None
        C = self.at(self.breaks[0])
        return int(C.indices[0]) if C.nnz == 1 and C.data[0] == 1.0 else None

    @property
    def is_fixed(self) -> bool:
        """Whether the row is rigid, holds both ways and does not depend on s.

        A basis may satisfy such a row exactly.
        """
        return self.compliance == 0.0 and self.clearance is None and not self.moves

    def project(self, V: Array, first: int = 0) -> PPoly:
        """Piecewise polynomial C(s) V with values (r,), for a basis V (n, r).

        `V` (n_local, r) may also be one rank's part of the basis, for the coordinates ``first`` to ``first + n_local``.
        Then the coefficients of all ranks add up to those of the whole basis.
        """
        measured = self.carriers[:, first : first + len(V)] @ V
        return PPoly(np.einsum("pkd,kdr->pkr", self.coefficients, measured[self.touched]), self.breaks)

    def refine(self, breaks: Array) -> Row:
        """Return this row, exactly, as polynomials on the intervals between `breaks` (k + 1,) in m.

        The breaks become the row's range.  All breaks of the row that lie in the new range must be among them.
        """
        if np.array_equal(breaks, self.breaks):
            return self
        finer = refine_table(self._polynomial, breaks)
        touched = self.touched[interval_around(finer.x, self.breaks)]
        return replace(self, breaks=finer.x, touched=touched, coefficients=finer.c)


def row_on_coordinates(name: str, breaks: Array, dofs: ArrayLike, coefficients: Array, size: int) -> Row:
    """Row called `name` on single coordinates out of `size`: those numbered in `dofs` (k, d) on each of k intervals.

    `breaks` (k + 1,) in m are the ends of the intervals.  `coefficients` (powers, k, d) are those of the d coordinates'
    weights, polynomials in the distance from the lower break, highest power first.
    """
    dofs = np.asarray(dofs, np.int64)
    numbers, touched = np.unique(dofs, return_inverse=True)
    carriers = sp.csr_matrix((np.ones(len(numbers)), numbers, np.arange(len(numbers) + 1)), (len(numbers), size))
    return Row(name, breaks, carriers, touched.reshape(dofs.shape), coefficients)


class IntervalColumns(NamedTuple):
    """Columns out of n that each of k intervals touches.

    An interval touches at most w columns.  All intervals together have c pairs of interval and column.  A pair is
    written as the code ``interval * n + column``.
    """

    codes: Indices  # (c,): each once, ascending
    place: Indices  # (c,): index of each code's column among the columns of its interval
    columns: Indices  # (k, w): ascending; an interval with fewer columns repeats its last one, or column 0 without any


def columns_by_interval(touching: Indices, n: int, k: int) -> IntervalColumns:
    """Columns, of n in all, that each of k intervals touches.

    They are given by the codes ``interval * n + column`` in `touching` (any,), in any order and also several times.
    """
    different = np.unique(touching)
    interval, width = different // n, np.bincount(different // n, minlength=k)
    place = np.arange(len(different)) - np.repeat(np.cumsum(width) - width, width)
    columns = np.zeros((k, max(1, int(width.max(initial=0)))), np.int64)
    columns[interval, place] = different % n
    missing = np.arange(columns.shape[1]) >= width[:, None]
    return IntervalColumns(different, place, np.where(missing, columns.max(axis=1, keepdims=True), columns))


def dense_entries(entries: sp.csr_matrix, powers: int) -> TouchedWeights:
    """Columns (k, d) that each of k intervals touches, and their coefficients (powers, k, d): undoes `Row.entries`.

    `entries` is sparse (powers k, K).  An interval that touches fewer than d columns repeats its last column with
    zeros.
    """
    every, (height, n) = sp.csr_matrix(entries, copy=True), entries.shape
    every.sum_duplicates()
    every = every.tocoo()
    k = height // powers
    touching = (every.row % k).astype(np.int64) * n + every.col
    different, place, touched = columns_by_interval(touching, n, k)
    coefficients = np.zeros((powers, *touched.shape))
    coefficients[every.row // k, every.row % k, place[np.searchsorted(different, touching)]] = every.data
    return TouchedWeights(touched, coefficients)


def fixed_row(name: str, carrier: sp.csr_matrix, domain: tuple[float, float]) -> Row:
    """Row called `name` that does not depend on s, as of a support or of a slider at rest.

    Its entries are `carrier` (1, n).  The `domain` in m is the interval of path coordinates on which the row is
    defined.
    """
    return Row(name, np.array(domain, float), sp.csr_matrix(carrier), np.zeros((1, 1), np.int64), np.ones((1, 1, 1)))


def sparse_row(dofs: ArrayLike, entries: ArrayLike, size: int) -> sp.csr_matrix:
    """Sparse row (1, size) with the `entries` (k,) at the coordinates numbered `dofs` (k,); both may be one number.

    Entries at the same coordinate are added.
    """
    columns, values = np.atleast_1d(np.asarray(dofs, np.int64)), np.atleast_1d(np.asarray(entries, float))
    return sp.csr_matrix((values, (np.zeros(len(columns), np.int64), columns)), (1, size))


@dataclass(frozen=True)
class Rows:
    """All m constraint rows of a full model with n = `size` coordinates; at each s they form a matrix (m, n)."""

    rows: tuple[Row, ...]
    size: int

    @property
    def names(self) -> tuple[str, ...]:
        """Names (m,) of the rows, in their order."""
        return tuple(row.name for row in self.rows)

    @property
    def compliance(self) -> Array:
        """Compliance 1/k (m,) of each row's pad, in m/N; 0 where the row is rigid."""
        return np.array([row.compliance for row in self.rows])

    @property
    def clearance(self) -> Array:
        """Clearance (m,) in m of each row that only pushes; NaN for rows that hold both ways."""
        return np.array([np.nan if row.clearance is None else row.clearance for row in self.rows])

    @property
    def domain(self) -> Interval:
        """Lowest and highest path coordinate in m at which every row is defined; 0 and 1 m without rows."""
        starts, ends = ([row.breaks[end] for row in self.rows] for end in (0, -1))
        return Interval(max(starts, default=0.0), min(ends, default=1.0))

    def at(self, s: float, derivative: int = 0) -> sp.csr_matrix:
        """Rows C(s) at one s in m, or their derivative of the order `derivative` with respect to s: sparse (m, n).

        Raises ValueError if s is outside the path.
        """
        if not self.rows:
            return sp.csr_matrix((0, self.size))
        touched, entries = zip(*(row.touched_weights(s, derivative) for row in self.shared_carriers.rows), strict=True)
        ends = np.cumsum([0, *(part.size for part in touched)])
        weights = np.concatenate(entries, axis=None), np.concatenate(touched, axis=None), ends
        U = self.shared_carriers.carriers
        return sp.csr_matrix(weights, (len(self.rows), U.shape[0])) @ U

    @property
    def fixed(self) -> list[int]:
        """Numbers of the rows that are rigid, hold both ways and do not depend on s: supports, and pads that stay."""
        return [i for i, row in enumerate(self.rows) if row.is_fixed]

    @cached_property
    def shared_carriers(self) -> SharedCarriers:
        """The rows with their weights on common carriers U, which are stored once."""
        numbers: dict[bytes, int] = {}
        new, touched = [sp.csr_matrix((0, self.size))], []
        for row in self.rows:
            used, count = np.unique(row.touched), len(numbers)
            carriers = row.carriers[used].sorted_indices()
            ends = zip(carriers.indptr[:-1], carriers.indptr[1:], strict=True)
            contents = [
                carriers.indices[a:b].astype(np.int64).tobytes() + carriers.data[a:b].tobytes() for a, b in ends
            ]
            at = np.array([numbers.setdefault(content, len(numbers)) for content in contents])
            new.append(carriers[np.unique(at, return_index=True)[1][np.unique(at) >= count]])
            touched.append(at[np.searchsorted(used, row.touched)])
        U = sp.vstack(new, format="csr")
        on_common = [replace(row, carriers=U, touched=numbers) for row, numbers in zip(self.rows, touched, strict=True)]
        coordinates = np.unique(U.indices)
        if 2 * len(coordinates) >= U.shape[0]:  # a mesh has many, of which each carrier touches few
            return SharedCarriers(U, tuple(on_common))
        return _on_single_coordinates(on_common, coordinates)


@dataclass(frozen=True)
class SharedCarriers:
    """Rows on K common carriers: each row is C(s) = b(s) U with the same U (K, n)."""

    # (K, n): each carrier once; or single coordinates, if the carriers touch less than half as many of these
    carriers: sp.csr_matrix
    rows: tuple[Row, ...]  # all on these carriers

    def row(self, number: int, name: str) -> Row:
        """Row with the given `number`, called `name`."""
        return replace(self.rows[number], name=name)

    def refine(self, breaks: Array) -> SharedCarriers:
        """Return all rows on common `breaks` (k + 1,) in m, exactly.

        The breaks must contain all breaks of each row within their range.
        """
        return replace(self, rows=tuple(row.refine(breaks) for row in self.rows))

    def align_breaks(self, domain: tuple[float, float]) -> SharedCarriers:
        """Return all rows on the union of their breaks within `domain` (m), which a common table of all rows needs."""
        return self.refine(common_breaks([row._polynomial for row in self.rows], domain))


def _on_single_coordinates(rows: Sequence[Row], coordinates: Indices) -> SharedCarriers:
    """Rows on single coordinates, from rows on common carriers.

    `coordinates` (k,) are the ascending numbers of all coordinates that the common carriers touch.
    """
    U, count = rows[0].carriers[:, coordinates], len(coordinates)
    single = sp.csr_matrix((np.ones(count), coordinates, np.arange(count + 1)), (count, rows[0].carriers.shape[1]))
    on_coordinates = []
    for row in rows:
        touched, coefficients = dense_entries(sp.csr_matrix(row.entries @ U), len(row.coefficients))
        on_coordinates.append(replace(row, carriers=single, touched=touched, coefficients=coefficients))
    return SharedCarriers(single, tuple(on_coordinates))


#: Most entries of R that `RowPolynomials.quadratic_form` gathers at once.
AT_ONCE = 2**20


@dataclass(frozen=True)
class RowPolynomials:
    """Weights b(s) of m rows on K carriers; on each of k intervals, the rows together touch w of the carriers."""

    breaks: Array  # (k + 1,) m
    touched: Indices  # (k, w): numbers of the carriers
    coefficients: Array  # (m, powers, k, w): highest power first

    @classmethod
    def from_rows(cls, rows: Sequence[Row], breaks: Array) -> RowPolynomials:
        """Polynomials of any number of rows that all have the same carriers and these breaks (k + 1,) in m."""
        interval = np.arange(len(breaks) - 1)
        if not rows:
            return cls(breaks, np.zeros((len(interval), 0), np.int64), np.zeros((0, 1, len(interval), 0)))
        degree, n = same_degree(*(row.coefficients for row in rows)), rows[0].carriers.shape[0]
        touching = [interval[:, None] * n + row.touched for row in rows]
        different, place, touched = columns_by_interval(np.concatenate(touching, axis=None), n, len(interval))
        coefficients = np.zeros((len(rows), len(degree[0]), *touched.shape))
        for of_row, c, numbers in zip(coefficients, degree, touching, strict=True):
            at = place[np.searchsorted(different, numbers)]
            for l in range(at.shape[1]):
                of_row[:, interval, at[:, l]] += c[:, :, l]
        return cls(breaks, touched, coefficients)

    def times(self, X: Array) -> PPoly:
        """Table C(s) V with values (m, c) for c vectors V, whose values U V on the carriers are X (K, c)."""
        m, powers, k, w = self.coefficients.shape
        blocks = self.coefficients.transpose(2, 0, 1, 3).reshape(k, m * powers, w)
        c = (blocks @ np.ascontiguousarray(X)[self.touched]).reshape(k, m, powers, X.shape[1])
        return PPoly(np.ascontiguousarray(c.transpose(2, 0, 1, 3)), self.breaks)

    def quadratic_form(self, R: Array) -> PPoly:
        """Table C(s) Q C(s)^T = b(s) R b(s)^T with values (m, m), of a symmetric matrix Q on the coordinates.

        R = U Q U^T (K, K) has the values of Q between the carriers U.  On each interval the rows touch w carriers; only
        the entries (w, w) of R between these are used.
        """
        m, powers, k, w = self.coefficients.shape
        if not m:
            return PPoly(np.zeros((1, k, 0, 0)), self.breaks)
        blocks = self.coefficients.transpose(2, 1, 0, 3).reshape(k, powers * m, w)
        result, some = np.zeros((2 * powers - 1, k, m, m)), max(1, AT_ONCE // w**2)
        for j in range(0, k, some):
            at, b = self.touched[j : j + some], blocks[j : j + some]
            R_at = R.take(at[:, :, None] * len(R) + at[:, None])  # half of the time of an index along each axis
            product = (b @ R_at @ b.swapaxes(1, 2)).reshape(len(b), powers, m, powers, m)
            for p in range(powers):
                result[p : p + powers, j : j + some] += product[:, p].transpose(2, 0, 1, 3)
        return PPoly((result + result.swapaxes(2, 3)) / 2.0, self.breaks)


@dataclass(frozen=True)
class StraightRows:
    """Two rows, called `names`, that hold a planar beam straight between a fixed point and a moving one.

    The fixed point is at `end` in m.
    """

    end: float
    names: tuple[str, str]

    def rows(self, point: Row) -> list[Row]:
        """Rows w(p) + (s - p) w'(p) - w(s) and (s - p) w'(s) - w(s) + w(p), in this order, with p = `end`.

        `point` is the row w(s) of the deflection at the moving point.  The first row is the gap at s between the
        tangent at p and the beam; the second is the gap at p between the beam and the tangent at s.  Both results are
        exact piecewise polynomials in s, with the breaks and the degree of `point`.  Their names are `names`.
        """
        j = max(int(np.searchsorted(point.breaks, self.end, side="right")) - 1, 0)
        j = min(j, len(point.breaks) - 2)
        along = PPoly(point.coefficients, point.breaks)
        w, slope, rates = along(self.end), along(self.end, 1), along.derivative().c
        ahead = (point.breaks[:-1] - self.end)[:, None]  # s - p where an interval begins
        constant = np.zeros_like(point.coefficients)
        constant[-1] = w
        sloping = constant.copy()
        sloping[-2] += slope
        sloping[-1] += ahead * slope
        changing = np.zeros_like(point.coefficients)  # (s - p) w'(s)
        changing[:-1] += rates
        changing[1:] += ahead * rates
        touched = np.hstack([point.touched, np.broadcast_to(point.touched[j], point.touched.shape)])
        parts = [(-point.coefficients, sloping), (changing - point.coefficients, constant)]
        return [
            replace(point, name=name, touched=touched, coefficients=np.concatenate(part, axis=2))
            for name, part in zip(self.names, parts, strict=True)
        ]
