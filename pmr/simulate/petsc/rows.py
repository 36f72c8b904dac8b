r"""The constraint rows over the visited path, and the inverse of the effective matrix on what they touch.

Rows act through the p carriers E^T (p, n) that they touch on the way (`pmr.constraints.rows`).  Between two breaks
C(s) = sum_e x^e Gamma_e E^T with x counted from the lower break, so that with the powers stacked, C = X(x) Gamma E^T,
and

.. math::
    C S^{-1} C^T = X\, (\Gamma P \Gamma^T)\, X^T, \qquad
    S^{-1} C^T \lambda = (S^{-1} E\, \Gamma^T)\, X^T \lambda, \qquad P = E^T S^{-1} E

change from step to step in X alone.  P is kept on every rank; S^{-1} E only where memory allows, and where it does not,
a second solve a step takes its place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.constraints.rows import Row

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Course:
    """Where the path s (T,) m leads the rows: interval of each row at each step, (T, m), and distance into it."""

    s: Array
    interval: Indices
    distance: Array

    @classmethod
    def along(cls, rows: Sequence[Row], s: Array) -> Course:
        """For the given rows, which must be defined at all s."""
        interval, distance = np.zeros((len(s), len(rows)), np.int64), np.zeros((len(s), len(rows)))
        for k, row in enumerate(rows):
            found = np.searchsorted(row.breaks, s, side="right") - 1
            interval[:, k] = np.clip(found, 0, len(row.breaks) - 2)
            distance[:, k] = s - row.breaks[interval[:, k]]
        return cls(s, interval, distance)

    def touched(self, rows: Sequence[Row]) -> Indices:
        """Carriers (p,) that the rows touch somewhere, ascending."""
        visited = [row.touched[np.unique(self.interval[:, k])].ravel() for k, row in enumerate(rows)]
        return np.unique(np.concatenate([np.empty(0, np.int64), *visited]))


@dataclass(frozen=True)
class VisitedCarriers:
    """The p carriers that rows touch on their way: their numbers, and this rank's columns of E^T, (p, n_local)."""

    numbers: Indices
    local: sp.csr_matrix


class Layout:
    """Numbers of m rows' entries (D,) and of their powers (c,), one row after the other."""

    def __init__(self, rows: Sequence[Row]) -> None:
        widths = np.array([row.touched.shape[1] for row in rows], int)
        powers = np.array([len(row.coefficients) for row in rows], int)
        self.count = len(rows)
        self.row_of_entry, self.row_of_power = (
            np.repeat(np.arange(len(rows)), widths),
            np.repeat(np.arange(len(rows)), powers),
        )
        self.exponents = np.concatenate([np.empty(0, int), *(np.arange(p)[::-1] for p in powers)])
        self.entries = [slice(end - width, end) for end, width in zip(np.cumsum(widths), widths, strict=True)]
        self.powers = [slice(end - power, end) for end, power in zip(np.cumsum(powers), powers, strict=True)]


class PathRows:
    """All rows at one step of a course, as one rank sees them.

    Attributes
    ----------
    Gamma : (c, D) array
        Coefficients: one line for each power of each row, one column for each of its entries.
    columns : (D,) integer array
        Which of the p carriers each entry stands for.
    changed : list of int
        Rows that the last `move` brought into another interval.
    """

    def __init__(self, rows: Sequence[Row], course: Course, visited: VisitedCarriers, step: int = 0) -> None:
        self.course, self.layout = course, Layout(rows)
        self._rows, self._visited = rows, visited
        self.Gamma = np.zeros((len(self.layout.row_of_power), len(self.layout.row_of_entry)))
        self.columns = np.zeros(len(self.layout.row_of_entry), np.int64)
        self._interval = np.full(len(rows), -1, np.int64)
        self._E = visited.local[self.columns]
        self.changed: list[int] = []
        self.move(step)

    def move(self, step: int) -> None:
        """Go to a step of the course."""
        interval = self.course.interval[step]
        self.changed = np.flatnonzero(interval != self._interval).tolist()
        for k in self.changed:
            entries, powers, j = self.layout.entries[k], self.layout.powers[k], interval[k]
            self.columns[entries] = np.searchsorted(self._visited.numbers, self._rows[k].touched[j])
            self.Gamma[powers, entries] = self._rows[k].coefficients[:, j]
        if self.changed:
            self._interval = interval
            self._E = self._visited.local[self.columns]
        self.x = self.course.distance[step][self.layout.row_of_power]
        self.X = self.x**self.layout.exponents

    def apply(self, q: Array) -> Array:
        """This rank's part (m,) of C q, q (n_local,) given by this rank's rows."""
        return self._sum(self.X @ self.Gamma, q)

    def apply_derivative(self, q: Array) -> Array:
        """This rank's part (m,) of C'(s) q."""
        exponents = self.layout.exponents
        lowered = exponents * self.x ** np.maximum(exponents - 1, 0)
        return self._sum(lowered @ self.Gamma, q)

    def transposed(self, multipliers: Array) -> Array:
        """This rank's rows (n_local,) of C^T lambda."""
        return np.asarray(self._E.T @ ((self.X @ self.Gamma) * multipliers[self.layout.row_of_entry]))

    def _sum(self, entries: Array, q: Array) -> Array:
        values = entries * (self._E @ q)
        return np.asarray(np.bincount(self.layout.row_of_entry, values, self.layout.count), float)


class PathCompliance:
    """P = E^T S^{-1} E, (p, p), reduced to the powers of the rows at the present step.

    Pairs of rows are always multiplied in the same order, whichever of them moved: an interrupted
    simulation goes on with the same digits.
    """

    def __init__(self, P: Array, rows: PathRows) -> None:
        self._P = P
        self._of_powers = np.zeros((len(rows.layout.row_of_power),) * 2)
        self._update(rows, range(rows.layout.count))

    def of_rows(self, rows: PathRows) -> Array:
        """C S^{-1} C^T, (m, m)."""
        self._update(rows, rows.changed)
        if rows.layout.count == 0:
            return np.zeros((0, 0))
        starts = [powers.start for powers in rows.layout.powers]
        weighted = self._of_powers * (rows.X[:, None] * rows.X)
        A = np.add.reduceat(np.add.reduceat(weighted, starts, axis=0), starts, axis=1)
        return np.asarray((A + A.T) / 2.0)

    def _update(self, rows: PathRows, changed: Sequence[int]) -> None:
        at, entries, powers = rows.columns, rows.layout.entries, rows.layout.powers
        for k, l in {(min(k, l), max(k, l)) for k in changed for l in range(rows.layout.count)}:
            P = self._P[np.ix_(at[entries[k]], at[entries[l]])]
            block = rows.Gamma[powers[k], entries[k]] @ P @ rows.Gamma[powers[l], entries[l]].T
            self._of_powers[powers[k], powers[l]], self._of_powers[powers[l], powers[k]] = block, block.T


class StoredAnswers:
    """This rank's rows of S^{-1} C^T lambda from those of S^{-1} E, (n_local, p)."""

    def __init__(self, answers: Array, rows: PathRows) -> None:
        self._answers = answers
        self._of_powers = np.zeros((len(answers), len(rows.layout.row_of_power)), order="F")
        self._update(rows, range(rows.layout.count))

    def correction(self, rows: PathRows, multipliers: Array) -> Array:
        """For the present rows."""
        self._update(rows, rows.changed)
        return np.asarray(self._of_powers @ (rows.X * multipliers[rows.layout.row_of_power]))

    def _update(self, rows: PathRows, changed: Sequence[int]) -> None:
        for k in changed:
            entries, powers = rows.layout.entries[k], rows.layout.powers[k]
            self._of_powers[:, powers] = self._answers[:, rows.columns[entries]] @ rows.Gamma[powers, entries].T
