r"""The lowest modes at many path coordinates with one factorisation: rows are a change of low rank.

With F = K + sigma M factorised once, rows C(s) that give way by 1/k (or by nothing, if they are rigid) make of it

.. math::
    \bigl(F + C^T k\, C\bigr)^{-1} = F^{-1} - F^{-1} C^T \bigl(1/k + C F^{-1} C^T\bigr)^{-1} C F^{-1}

(Woodbury; for 1/k = 0 its limit, in which C phi = 0), which is what shift-and-invert asks for.  A position costs m
solves with F and those of the Krylov sequence.

The sequence sees one vector of a multiple eigenvalue; a tube with two equal sides has such.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pmr.fem.compat import PETSc
from pmr.fem.distributed import freed, inner
from pmr.fem.factor import Factor
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.modes import Modes, finished, lowest_of, solved

Array = NDArray[np.float64]


class OneFactorEigenSolver:
    """Krylov-Schur with shift-and-invert on one factor; fulfils `pmr.fullmodel.eigensolvers.EigenSolver`."""

    def __init__(self, model: FullModel) -> None:
        self._model, self._sigma = model, model.reference_frequency**2
        F = model.K.copy()
        F.axpy(self._sigma, model.M, structure=PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        self._factor = Factor(F, "K + sigma M")
        freed(F)

    def lowest(self, s: float, count: int) -> Modes:
        """As there; collective.

        Raises
        ------
        ConvergenceError
            If fewer than `count` modes converge.
        """
        model = self._model
        eps = lowest_of(model.K, model.M, self._sigma, count)
        pc = eps.getST().getKSP().getPC()
        pc.setType("python")
        pc.setPythonContext(_Changed(model, self._factor, s))
        freed(pc)  # a name that outlives the solver would keep what it holds
        omega2, vectors = solved(eps, count)
        phi = np.column_stack([vector.getArray() for vector in vectors])
        freed(*vectors)
        return finished(model, s, omega2, phi, cut=False)


class _Changed:
    """The changed inverse, as petsc4py asks for it."""

    def __init__(self, model: FullModel, factor: Factor, s: float) -> None:
        self._factor, self._comm = factor, model.comm
        first, last = model.M.getOwnershipRange()
        self._Ct = model.rows.at(s)[:, first:last].T.toarray()
        self._answers = factor.solve_columns(self._Ct)
        system = inner(self._Ct, self._answers, self._comm) + np.diag(model.rows.compliance)
        self._system = scipy.linalg.cho_factor((system + system.T) / 2.0) if len(system) else None

    def apply(self, pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._factor.solve(x, y)
        if self._system is not None:
            free = y.getArray()
            motion = inner(self._Ct, np.ascontiguousarray(free[:, None]), self._comm)[:, 0]
            free -= self._answers @ scipy.linalg.cho_solve(self._system, motion)
