r"""The lowest modes at many path coordinates with one factorisation: rows are a change of low rank.

With F = K + sigma M factorised once, rows C(s) that give way by 1/k (or by nothing, if they are rigid) make of it

.. math::
    \bigl(F + C^T k\, C\bigr)^{-1} = F^{-1} - F^{-1} C^T \bigl(1/k + C F^{-1} C^T\bigr)^{-1} C F^{-1}

(Woodbury; for 1/k = 0 its limit, in which C phi = 0), which is what block Lanczos asks for.  A position costs m solves
with F and those of the sequence.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pmr.fem.compat import PETSc
from pmr.fem.distributed import freed, inner, subtract
from pmr.fem.factor import factor_of
from pmr.fullmodel.block_lanczos import BLOCK, largest
from pmr.fullmodel.elimination import eliminate
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.modes import Modes, check_count, clustered, finished

Array = NDArray[np.float64]


class OneFactorEigenSolver:
    """Block Lanczos with shift-and-invert on one factor; fulfils `pmr.fullmodel.eigensolvers.EigenSolver`."""

    def __init__(self, model: FullModel) -> None:
        self._model, self._sigma = model, model.reference_frequency**2
        F = model.K.copy()
        F.axpy(self._sigma, model.M, structure=PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        self._factor = factor_of(F, "K + sigma M")
        freed(F)

    def lowest(self, s: float, count: int) -> Modes:
        """As there; collective.

        Raises
        ------
        DependentRowsError, ConvergenceError
            If rigid rows depend on each other, or fewer than `count` modes exist or converge.
        """
        model, factor, C = self._model, self._factor, self._model.rows.at(s)
        rigid = np.flatnonzero(model.rows.compliance == 0.0)
        dimension = model.size - len(eliminate(C[rigid], [model.rows.names[i] for i in rigid]).pivots)
        check_count(count, dimension)
        Ct = np.asfortranarray(C[:, model.share].T.toarray())
        answers = factor.solve_columns(Ct)
        system = inner(Ct, answers, model.comm) + np.diag(model.rows.compliance)
        held = scipy.linalg.cho_factor((system + system.T) / 2.0) if len(system) else None

        def apply(g: Array) -> Array:
            x = factor.solve_columns(g)
            if held is not None:
                subtract(x, answers, scipy.linalg.cho_solve(held, inner(Ct, x, model.comm)))
            return x

        loads = np.random.default_rng(7).uniform(-1.0, 1.0, (model.size, BLOCK))[model.share]
        wanted = min(count + 1, dimension)  # one more tells whether the last one belongs to a cluster
        found = largest(apply, model.M, apply(np.asfortranarray(loads)), wanted, dimension)
        omega2 = 1.0 / found.theta - self._sigma
        cut = len(omega2) > count and clustered(omega2[count - 1], omega2[count])
        return finished(model, s, omega2[:count], np.asfortranarray(found.vectors[:, :count]), cut)
