"""The moving rows C(s) of sliders, exact in the path coordinate s.

A slider at the beam coordinate s holds the interpolated displacement there, C(s) q = 0.  Between two nodes the row
consists of the shape functions of one element, so it is a polynomial in s; over the whole beam it is a piecewise
polynomial, C1-continuous for cubic Hermite elements.  `Row` keeps it sparse for the full model; `Row.project` gives
the dense piecewise polynomial of a reduced model.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PPoly

from pmr.constraints.polynomials import interval_around, rebased, within_domain

Array = NDArray[np.float64]


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
        s = within_domain(s, self.breaks[0], self.breaks[-1], self.name)
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
        return replace(
            self, breaks=finer.x, dofs=self.dofs[interval_around(finer.x, self.breaks)], coefficients=finer.c
        )


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
