"""The moving rows C(s) of sliders, exact in the path coordinate s.

A slider at the beam coordinate s holds the interpolated displacement there, C(s) q = 0.  Between two nodes the row
consists of the shape functions of one element, so it is a polynomial in s; over the whole beam it is a piecewise
polynomial, C1-continuous for cubic Hermite elements.  `Row` keeps it sparse for the full model; `Row.project` gives
the dense piecewise polynomial of a reduced model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PPoly

Array = NDArray[np.float64]

#: Positions may leave the path's domain by this share of its length (round-off of a signal).
DOMAIN_TOLERANCE = 1e-9


def _checked(s: ArrayLike, low: float, high: float, what: str) -> Array:
    """`s` as an array within [low, high], or a ValueError that says by how much it lies outside."""
    s = np.asarray(s, dtype=float)
    slack = DOMAIN_TOLERANCE * (high - low)
    if not np.all((s >= low - slack) & (s <= high + slack)):
        worst = s.flat[np.argmax(np.maximum(low - s, s - high))] if np.all(np.isfinite(s)) else np.nan
        raise ValueError(f"{what}: s = {worst:g} m lies outside the path, allowed are {low:g} to {high:g} m")
    return np.clip(s, low, high)


@dataclass(frozen=True)
class Row:
    """One constraint row of the full model as a sparse piecewise polynomial in s.

    On ``[breaks[j], breaks[j + 1]]`` the row's entries are
    ``C(s)[dofs[j, l]] = sum_p coefficients[p, j, l] (s - breaks[j])**(degree - p)``.

    Attributes
    ----------
    name : str
        Shown wherever the row is spoken of.
    breaks : (k + 1,) array, m
    dofs : (k, d) integer array
        Columns that the row touches in each interval.
    coefficients : (degree + 1, k, d) array
        Highest power first, as in `scipy.interpolate.PPoly`.
    compliance : float, m/N
        1/k of a pad that gives way, C q = lambda / k; 0 for a rigid one.
    clearance : float, m, or None
        Of a row that only pushes: how far C q may go before it holds.  None where the row holds both ways.
    """

    name: str
    breaks: Array
    dofs: NDArray[np.int64]
    coefficients: Array
    compliance: float = 0.0
    clearance: float | None = None

    @cached_property
    def _polynomial(self) -> PPoly:
        return PPoly(self.coefficients, self.breaks)

    def at(self, s: ArrayLike, derivative: int = 0) -> tuple[NDArray[np.int64], Array]:
        """Columns and entries, both ``s.shape + (d,)``, of the row at s or of its derivative with respect to s.

        Raises
        ------
        ValueError
            If s lies outside the path.
        """
        s = _checked(s, self.breaks[0], self.breaks[-1], self.name)
        j = np.clip(np.searchsorted(self.breaks, s, side="right") - 1, 0, len(self.breaks) - 2)
        return self.dofs[j], self._polynomial(s, nu=derivative)

    def apply(self, s: Array, q: Array, derivative: int = 0) -> Array:
        """C(s) q at each time, (T,), for s (T,) and q (T, n); or with the row's derivative."""
        dofs, entries = self.at(s, derivative)
        return np.einsum("td,td->t", entries, np.take_along_axis(q, dofs, axis=1))

    @property
    def moves(self) -> bool:
        """Whether the row depends on s."""
        return len(self.breaks) > 2 or len(self.coefficients) > 1

    @property
    def held(self) -> int | None:
        """The coordinate that the row holds at zero, where that is all it does."""
        alone = self.dofs.size == 1 and len(self.coefficients) == 1 and self.coefficients.flat[0] == 1.0
        return int(self.dofs.flat[0]) if alone and self.fixed else None

    @property
    def fixed(self) -> bool:
        """Whether the row always holds, in one place: a support, whose meaning a basis may hold once and for all."""
        return self.compliance == 0.0 and self.clearance is None and not self.moves

    def project(self, V: Array, first: int = 0) -> PPoly:
        """C(s) V as a piecewise polynomial with values (r,).

        `V` may be a rank's share of the basis, the rows ``first`` to ``first + len(V)``; the shares' coefficients
        then add up to those of the whole.
        """
        owned = (self.dofs >= first) & (self.dofs < first + len(V))
        entries = np.where(owned[..., None], V[np.where(owned, self.dofs - first, 0)], 0.0) if len(V) else 0.0
        c = np.einsum("pkd,kdr->pkr", self.coefficients, entries * np.ones((*self.dofs.shape, V.shape[1])))
        return PPoly(c, self.breaks)

    def refined(self, breaks: Array) -> Row:
        """The same row on finer breaks, which hold all of its own within their range: exact."""
        finer = rebased(self._polynomial, breaks)
        return replace(self, breaks=finer.x, dofs=self.dofs[_around(finer.x, self.breaks)], coefficients=finer.c)


def fixed_row(name: str, dofs: ArrayLike, entries: ArrayLike, domain: tuple[float, float]) -> Row:
    """A row that does not move: a support, or a slider that stays where it is."""
    columns, values = np.atleast_1d(np.asarray(dofs, np.int64)), np.atleast_1d(np.asarray(entries, float))
    return Row(name, np.array(domain, float), columns[None, :], values[None, None, :])


@dataclass(frozen=True)
class Rows:
    """All constraint rows of a full model, shape (m, n) at each s."""

    rows: tuple[Row, ...]
    size: int

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(row.name for row in self.rows)

    @property
    def compliance(self) -> Array:
        """1/k of each row's pad, (m,) in m/N; 0 where it is rigid."""
        return np.array([row.compliance for row in self.rows])

    @property
    def clearance(self) -> Array:
        """Clearance of each row that only pushes, (m,) in m; NaN where it holds both ways."""
        return np.array([np.nan if row.clearance is None else row.clearance for row in self.rows])

    @property
    def moving(self) -> list[int]:
        """Numbers of the rows that depend on s: the sliders."""
        return [i for i, row in enumerate(self.rows) if row.moves]

    @property
    def domain(self) -> tuple[float, float]:
        """Path coordinates at which every row is defined, in m."""
        return max(row.breaks[0] for row in self.rows), min(row.breaks[-1] for row in self.rows)

    def at(self, s: float, derivative: int = 0) -> sp.csr_matrix:
        """C(s) as a sparse matrix (m, n), or its derivative with respect to s."""
        if not self.rows:
            return sp.csr_matrix((0, self.size))
        parts = [row.at(s, derivative) for row in self.rows]
        counts = np.cumsum([0] + [len(dofs) for dofs, _ in parts])
        columns = np.concatenate([dofs for dofs, _ in parts])
        entries = np.concatenate([values for _, values in parts])
        return sp.csr_matrix((entries, columns, counts), shape=(len(parts), self.size))


def stack(rows: Sequence[PPoly], domain: tuple[float, float]) -> PPoly:
    """Rows with their own breaks as one piecewise polynomial with values (m, r) on common breaks within `domain`."""
    breaks = common_breaks(rows, domain)
    degree = max(len(row.c) for row in rows) - 1
    return PPoly(np.stack([rebased(row, breaks, degree).c for row in rows], axis=2), breaks)


def common_breaks(tables: Sequence[PPoly], domain: tuple[float, float]) -> Array:
    """Breaks (k + 1,) in m within `domain`, such that every table is a polynomial between two of them."""
    low, high = domain
    inner = np.concatenate([table.x for table in tables])
    breaks = np.unique(np.concatenate([[low, high], inner[(inner > low) & (inner < high)]]))
    apart = np.concatenate([[True], np.diff(breaks) > 1e-12 * (high - low)])
    apart[-1] = True
    return np.asarray(breaks[apart])


def rebased(table: PPoly, breaks: Array, degree: int | None = None) -> PPoly:
    """The same piecewise polynomial on finer breaks, its degree raised to `degree`: exact."""
    source = _around(breaks, table.x)
    c = table.c[:, source].copy()
    x = (breaks[:-1] - table.x[source]).reshape(-1, *[1] * (c.ndim - 2))
    # Taylor shift by repeated synthetic division (Knuth, TAOCP 2, 4.6.4).
    for last in range(len(c), 1, -1):
        for p in range(1, last):
            c[p] += c[p - 1] * x
    missing = 0 if degree is None else degree + 1 - len(c)
    return PPoly(np.concatenate([np.zeros((missing, *c.shape[1:])), c]), breaks)


def contributions(table: PPoly) -> Array:
    """Coefficients (p, k, ...) times their interval's length to the matching power: the most that each adds."""
    powers = np.arange(len(table.c) - 1, -1, -1)
    size = np.diff(table.x)[None, :] ** powers[:, None]
    return np.asarray(table.c * size.reshape(*size.shape, *[1] * (table.c.ndim - 2)))


def _around(fine: Array, coarse: Array) -> NDArray[np.int64]:
    """Number (k,) of the coarse interval around each of k finer ones."""
    middle = (fine[1:] + fine[:-1]) / 2.0
    return np.clip(np.searchsorted(coarse, middle, side="right") - 1, 0, len(coarse) - 2)


def evaluate(table: PPoly, s: ArrayLike, derivative: int = 0, what: str = "slider") -> Array:
    """Values of a piecewise polynomial at s, refused outside its domain; shape ``s.shape + table.c.shape[2:]``."""
    return np.asarray(table(_checked(s, table.x[0], table.x[-1], what), nu=derivative))
