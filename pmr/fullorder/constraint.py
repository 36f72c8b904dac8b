"""Multipliers of the moving rows and what they do to the body: the Schur complement of the effective matrix."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pmr.dolfinx_compat import MPI
from pmr.errors import SimulationError
from pmr.fullorder.effective import BLOCK, Factor
from pmr.fullorder.rows import Course, KeptAnswers, PathCompliance, PathRows
from pmr.operators import FullModel
from pmr.simulate.march_rows import SINGULAR
from pmr.simulate.march_start import dependence

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Bytes a rank may spend on S^{-1} of the touched coordinates, which save the second solve of a step.
KEPT_BYTES = 2**30


class Constraint:
    r"""All rows over a course, with a factor of S; collective.

    .. math:: (dq\, C S^{-1} C^T + 1/k)\, \lambda = C q_{free}
    """

    def __init__(self, model: FullModel, factor: Factor, q_gain: float, course: Course, step: int) -> None:
        rows, self._q_gain = model.rows.rows, q_gain
        self._names, self._pads = model.rows.names, np.diag(model.rows.compliance)
        share = model.M.getOwnershipRange()
        self.rows = PathRows(rows, course, share, step)
        self._touched = course.touched(rows)
        kept = 8 * len(self._touched) * model.comm.allreduce(share[1] - share[0], op=MPI.MAX) <= KEPT_BYTES
        P, answers = _answers(factor, self._touched, share, model.comm, kept)
        self._compliance = PathCompliance(self._touched, P, self.rows)
        self._kept = KeptAnswers(self._touched, answers, self.rows) if kept else None
        self._factor = factor
        self._right, self._answer = model.M.createVecs()
        self._position, self._cholesky = np.nan, np.zeros((0, 0))

    def move(self, step: int) -> None:
        """Go to a step of the course.

        Raises
        ------
        SimulationError
            If rows depend on each other there.
        """
        self.rows.move(step)
        s = self.rows.course.s[step]
        if s != self._position:
            A = self._q_gain * self._compliance.of_rows(self.rows) + self._pads
            self._cholesky, failed = _factorise(A)
            if failed:
                raise SimulationError(dependence(self.rows.dense(self._touched)[:failed], self._names))
            self._position = s

    def multipliers(self, motion: Array) -> Array:
        """Multipliers (m,) in N from how the rows would move without them, C q_free (m,)."""
        if not len(motion):
            return motion
        return np.asarray(scipy.linalg.cho_solve((self._cholesky, True), motion, check_finite=False))

    def correction(self, multipliers: Array) -> Array:
        """This rank's rows (n_local,) of S^{-1} C^T lambda."""
        if self._kept is not None:
            return self._kept.correction(self.rows, multipliers)
        right = self._right.getArray()
        right[:] = 0.0
        self.rows.add_transposed(multipliers, right)
        self._factor.solve(self._right, self._answer)
        return np.asarray(self._answer.getArray())


def _answers(factor: Factor, touched: Indices, share: tuple[int, int], comm: Any, kept: bool) -> tuple[Array, Array]:
    """P = E^T S^{-1} E (p, p), the same on every rank, and this rank's rows of S^{-1} E if they are kept."""
    first, last = share
    mine = np.flatnonzero((touched >= first) & (touched < last))
    P = np.zeros((len(touched), len(touched)))
    answers = np.zeros((last - first, len(touched) if kept else 0), order="F")
    for k in range(0, len(touched), BLOCK):
        columns = np.arange(k, min(k + BLOCK, len(touched)))
        E = np.zeros((last - first, len(columns)))
        unit = mine[(mine >= columns[0]) & (mine <= columns[-1])]
        E[touched[unit] - first, unit - k] = 1.0
        block = factor.solve_columns(E)
        P[np.ix_(mine, columns)] = block[touched[mine] - first]
        if kept:
            answers[:, columns] = block
    comm.Allreduce(MPI.IN_PLACE, P)
    return (P + P.T) / 2.0, answers


def _factorise(A: Array) -> tuple[Array, int]:
    """Cholesky factor, and 0 or the number from 1 of the first row that depends on those before it."""
    if not len(A):
        return A, 0
    L, info = scipy.linalg.lapack.dpotrf(A, lower=True)
    done = info - 1 if info > 0 else len(A)
    weak = ~(np.diagonal(L)[:done] ** 2 > SINGULAR * np.diagonal(A)[:done])
    return L, int(np.argmax(weak)) + 1 if weak.any() else max(info, 0)
