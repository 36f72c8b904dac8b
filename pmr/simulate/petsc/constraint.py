"""Multipliers of the moving rows and what they do to the body: the Schur complement of the effective matrix."""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.errors import SimulationError
from pmr.fem.compat import MPI
from pmr.fem.factor import BLOCK, AnyFactor
from pmr.fullmodel.model import FullModel
from pmr.simulate.native.rows import SINGULAR
from pmr.simulate.native.start import dependence
from pmr.simulate.petsc.rows import Course, PathCompliance, PathRows, StoredAnswers, VisitedCarriers

Array = NDArray[np.float64]

#: Bytes a rank may spend on S^{-1} E, which saves the second solve of a step: 560 loads of the reference boom's pads at
#: up to 240,000 coordinates a rank.
STORED_BYTES = 2**30


class Constraint:
    r"""All rows over a course, with a factor of S; collective.

    .. math:: (dq\, C S^{-1} C^T + 1/k)\, \lambda = C q_{free}
    """

    def __init__(self, model: FullModel, factor: AnyFactor, q_gain: float, course: Course, step: int) -> None:
        self._q_gain, self._factor = q_gain, factor
        self._all_rows, self._pads = model.rows, np.diag(model.rows.compliance)
        shared, share = model.rows.shared, slice(*model.M.getOwnershipRange())
        numbers = course.touched(shared.rows)
        visited = VisitedCarriers(numbers, shared.carriers[numbers][:, share])
        self.rows = PathRows(shared.rows, course, visited, step)
        stored = 8 * len(numbers) * model.comm.allreduce(share.stop - share.start, op=MPI.MAX) <= STORED_BYTES
        P, answers = _answers(factor, visited.local, model.comm, stored)
        self._compliance = PathCompliance(P, self.rows)
        self._stored = StoredAnswers(answers, self.rows) if stored else None
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
                C = self._all_rows.at(float(s))[:failed]
                raise SimulationError(dependence(C[:, np.unique(C.indices)].toarray(), self._all_rows.names))
            self._position = s

    def multipliers(self, motion: Array) -> Array:
        """Multipliers (m,) in N from how the rows would move without them, C q_free (m,)."""
        if not len(motion):
            return motion
        return np.asarray(scipy.linalg.cho_solve((self._cholesky, True), motion, check_finite=False))

    def correction(self, multipliers: Array) -> Array:
        """This rank's rows (n_local,) of S^{-1} C^T lambda."""
        if self._stored is not None:
            return self._stored.correction(self.rows, multipliers)
        self._right.getArray()[:] = self.rows.transposed(multipliers)
        self._factor.solve(self._right, self._answer)
        return np.asarray(self._answer.getArray())


def _answers(factor: AnyFactor, E: sp.csr_matrix, comm: MPI.Comm, stored: bool) -> tuple[Array, Array]:
    """P = E^T S^{-1} E (p, p), the same on every rank, and this rank's rows of S^{-1} E if they are stored.

    E is given as this rank's columns of its transpose, (p, n_local).
    """
    p, n = E.shape
    P, answers = np.zeros((p, p)), np.zeros((n, p if stored else 0), order="F")
    for k in range(0, p, BLOCK):
        block = factor.solve_columns(E[k : k + BLOCK].toarray().T)
        P[:, k : k + BLOCK] = E @ block
        if stored:
            answers[:, k : k + BLOCK] = block
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
