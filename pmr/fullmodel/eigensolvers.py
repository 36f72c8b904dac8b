"""The lowest modes of the full model with its rows held at one path coordinate: block Lanczos, SLEPc, or dense LAPACK.

All solve (K + sigma M) phi = (omega^2 + sigma) M phi with a small sigma > 0 for the largest 1 / (omega^2 + sigma).
That keeps rigid-body modes harmless and, in contrast to asking LAPACK for eigenvalues of (K, M), gives the low modes
to full relative accuracy: they are then the dominant ones.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.fem.compat import HAS_PETSC, PETSc
from pmr.fem.distributed import free_objects, inner, subtract, times
from pmr.fem.factor import cholesky, factor_of
from pmr.fem.matrices import gather
from pmr.fullmodel.block_lanczos import BLOCK, largest
from pmr.fullmodel.elimination import eliminate
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.modes import Modes, are_clustered, check_count, finish_modes, lowest_of, solve_modes

Array = NDArray[np.float64]
DENSE_UP_TO = 1500  # coordinates; above, sparse factors are the automatic choice


def eigensolver(model: FullModel, choice: str) -> EigenSolver:
    """``"dense"``, ``"slepc"``, or ``"auto"``: dense up to `DENSE_UP_TO` coordinates.

    Its `lowest(s, count)` are the lowest modes with the rows held at s (m); collective.  It raises a
    `DependentRowsError` if rigid rows depend on each other there, and a `ConvergenceError` if fewer modes exist or
    converge.  Rows that give way are springs, and take one factor for all positions, as all rows do without SLEPc.
    """
    if is_dense(model, choice):
        return DenseEigenSolver(model)
    if np.any(model.rows.compliance) or not HAS_PETSC:
        return OneFactorEigenSolver(model)
    return SlepcEigenSolver(model)


def is_dense(model: FullModel, choice: str) -> bool:
    """Whether ``"dense"``, ``"slepc"`` or ``"auto"`` means LAPACK for a model of this size."""
    return choice == "dense" or (choice == "auto" and model.size <= DENSE_UP_TO)


class DenseEigenSolver:
    """All modes by LAPACK on rank 0: the reproducible path, O(n^3)."""

    def __init__(self, model: FullModel) -> None:
        self._model = model
        self._sigma = model.reference_frequency**2
        self._M, self._K = (None if A is None else A.toarray() for A in map(gather, (model.M, model.K)))

    def lowest(self, s: float, count: int) -> Modes:
        model = self._model
        C, compliance = model.rows.at(s), model.rows.compliance
        rigid, soft = np.flatnonzero(compliance == 0.0), np.flatnonzero(compliance)
        elimination = eliminate(C[rigid], [model.rows.names[i] for i in rigid])
        check_count(count, model.size - len(elimination.pivots))
        phi, omega2, cut = np.empty((model.size, count)), np.empty(count), False
        if self._M is not None and self._K is not None:
            springs = (C[soft].T @ sp.diags(1.0 / compliance[soft]) @ C[soft]).toarray() if len(soft) else 0.0
            M, K = elimination.project_dense(self._M), elimination.project_dense(self._K + springs)
            mu, z = scipy.linalg.eigh(M, K + self._sigma * M)
            all_omega2 = 1.0 / mu[::-1] - self._sigma
            omega2, phi = all_omega2[:count], elimination.matrix() @ z[:, ::-1][:, :count]
            cut = len(all_omega2) > count and are_clustered(all_omega2[count - 1], all_omega2[count])
        omega2, phi, cut = model.comm.bcast((omega2, phi, cut))
        first, last = model.M.getOwnershipRange()
        return finish_modes(model, s, omega2, np.ascontiguousarray(phi[first:last]), cut)


class SlepcEigenSolver:
    """Krylov-Schur with shift-invert; MUMPS factorises.  Sylvester's law of inertia proves that no mode was missed.

    A single Krylov sequence sees one vector of each multiple eigenvalue.  The inertia of K - x M counts the modes
    below x; where some are missing, the solver runs again in the complement of those found.
    """

    def __init__(self, model: FullModel) -> None:
        self._model = model
        self._sigma = model.reference_frequency**2

    def lowest(self, s: float, count: int) -> Modes:
        model = self._model
        elimination = eliminate(model.rows.at(s), model.rows.names)
        dimension = model.size - len(elimination.pivots)
        check_count(count, dimension)
        T = elimination.petsc(model.M)
        M, K = model.M.PtAP(T), model.K.PtAP(T)
        pairs = min(count + 1, dimension)  # one more tells whether the last one belongs to a cluster
        omega2, z = self._solve(M, K, pairs, [])
        for _ in range(pairs):
            below = (
                omega2[count - 1] * (1.0 - 1e-5) - self._sigma * 1e-5
                if len(omega2) == count or are_clustered(omega2[count - 1], omega2[count])
                else (omega2[count - 1] + omega2[count]) / 2.0
            )
            missing = _inertia(M, K, below) - int(np.sum(omega2 < below))
            if missing <= 0:
                break
            more_omega2, more = self._solve(M, K, missing, z)
            omega2, z = np.concatenate([omega2, more_omega2]), z + more
            order = np.argsort(omega2, kind="stable")[:pairs]
            omega2, z = omega2[order], [z[i] for i in order]
        cut = len(omega2) > count and are_clustered(omega2[count - 1], omega2[count])
        phi = times(T, np.column_stack([vector.getArray() for vector in z[:count]]))
        free_objects(T, M, K, *z)
        return finish_modes(model, s, omega2[:count], phi, cut)

    def _solve(
        self, M: PETSc.Mat, K: PETSc.Mat, count: int, deflation: list[PETSc.Vec]
    ) -> tuple[Array, list[PETSc.Vec]]:
        eps = lowest_of(K, M, self._sigma, count)
        pc = eps.getST().getKSP().getPC()
        pc.setType("cholesky")
        pc.setFactorSolverType("mumps")
        free_objects(pc)  # a name that outlives the solver would keep the factor
        if deflation:
            eps.setDeflationSpace(deflation)
        return solve_modes(eps, count)


class OneFactorEigenSolver:
    r"""Block Lanczos with shift-and-invert on one factor for all positions, of which rows are a change of low rank.

    With F = K + sigma M, rows C(s) that give way by 1/k (or by nothing, if they are rigid) make of it

    .. math::
        \bigl(F + C^T k\, C\bigr)^{-1} = F^{-1} - F^{-1} C^T \bigl(1/k + C F^{-1} C^T\bigr)^{-1} C F^{-1}

    (Woodbury; for 1/k = 0 its limit, in which C phi = 0).  A position costs m solves with F and those of the sequence.
    """

    def __init__(self, model: FullModel) -> None:
        self._model, self._sigma = model, model.reference_frequency**2
        F = model.K.copy()
        F.axpy(self._sigma, model.M, structure=PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        self._factor = factor_of(F, "K + sigma M")
        free_objects(F)

    def lowest(self, s: float, count: int) -> Modes:
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
        pairs = min(count + 1, dimension)  # one more tells whether the last one belongs to a cluster
        spectrum = largest(apply, model.M, apply(np.asfortranarray(loads)), pairs, dimension)
        omega2 = 1.0 / spectrum.theta - self._sigma
        cut = len(omega2) > count and are_clustered(omega2[count - 1], omega2[count])
        return finish_modes(model, s, omega2[:count], np.asfortranarray(spectrum.vectors[:, :count]), cut)


EigenSolver = DenseEigenSolver | SlepcEigenSolver | OneFactorEigenSolver


def lowest_frequencies(model: FullModel, s: Array, count: int, solver: str) -> Array:
    """The `count` lowest (S, f) in rad/s, or all there are, with the sliders at s (S,) m; collective.

    Raises a `ConvergenceError` if SLEPc finds too few.
    """
    solver_of_model = eigensolver(model, solver)
    count = min(count, model.size - len(model.rows.names))
    return np.array([solver_of_model.lowest(float(at), count).omega for at in s])


def _inertia(M: PETSc.Mat, K: PETSc.Mat, below: float) -> int:
    """Number of eigenvalues omega^2 < `below`: the negative pivots of K - below M (Parlett 1998, section 3.3)."""
    shifted = K.copy()
    shifted.axpy(-below, M, structure=PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
    shifted.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    pc = cholesky(shifted, "mumps")
    factor = pc.getFactorMatrix()
    factor.setMumpsIcntl(24, 1)  # null pivots are looked for: MUMPS counts no inertia without
    pc.setUp()
    negative = int(factor.getInertia()[0])
    free_objects(factor, pc, shifted)
    return negative
