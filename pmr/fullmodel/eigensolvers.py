"""Lowest modes of the full model with its rows held at one path coordinate: dense LAPACK, SLEPc or block Lanczos.

A mode phi with the circular frequency omega satisfies K phi = omega^2 M phi with the stiffness K and the mass M.  All
solvers solve (K + sigma M) phi = (omega^2 + sigma) M phi with a small sigma > 0, and look for the largest values of 1 /
(omega^2 + sigma).  Rigid-body modes are then no special case.  The low modes, which are the dominant ones of this
problem, get full relative accuracy; LAPACK does not give them that if it solves for the eigenvalues of (K, M).

The dense and the SLEPc solver eliminate the rigid constraint rows C: with a matrix T, q = T z satisfies C q = 0 for
every z.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from pmr.errors import InputError
from pmr.fem.compat import HAS_PETSC, PETSc
from pmr.fem.distributed import free_objects, gather, inner, sparse, subtract, times
from pmr.fem.factor import cholesky, factor_of
from pmr.files.arrays import Array, Indices
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.modes import (
    BLOCK,
    Modes,
    SolvedModes,
    are_clustered,
    check_count,
    finish_modes,
    largest_eigenpairs,
    lowest_mode_solver,
    solve_modes,
)


class DependentRowsError(InputError):
    """A rigid row is a combination of other rows.

    For example, a slider sits on a support, or two pads on a beam are opposite one another.  `names` are the names of
    the dependent rows.
    """

    def __init__(self, names: Sequence[str]) -> None:
        """Compose the message from the `names` of the dependent rows."""
        allowed = (
            f"the rigid rows {', '.join(names)} hold what others hold already: their forces are not determined; "
            "fewer rigid supports, sliders and pads, or pads with a stiffness, are allowed"
        )
        super().__init__("scene", "", None, allowed)


@dataclass(frozen=True)
class Elimination:
    """Solution of C q = 0 for c pivot coordinates; the other coordinates are free.

    The solution is ``q[pivots] = -factors @ q[coupled]``.  `size` is the number n of coordinates q.  `pivots` (c,) and
    `coupled` (k,) are numbers of coordinates, `factors` is (c, k).  The matrix T (n, n - c) gives q = T z from the free
    coordinates z.
    """

    size: int
    pivots: Indices
    coupled: Indices
    factors: Array

    @property
    def free(self) -> Indices:
        """Numbers (n - c,) of the free coordinates, ascending."""
        return np.setdiff1d(np.arange(self.size), self.pivots)

    def to_scipy(self) -> sp.csr_matrix:
        """The matrix T (n, n - c) of q = T z as a SciPy matrix; z are the `free` coordinates in their order."""
        free = self.free
        column = np.full(self.size, -1)
        column[free] = np.arange(len(free))
        at, other = np.nonzero(self.factors)
        rows = np.concatenate([free, self.pivots[at]])
        columns = np.concatenate([column[free], column[self.coupled[other]]])
        entries = np.concatenate([np.ones(len(free)), -self.factors[at, other]])
        return sp.csr_matrix((entries, (rows, columns)), shape=(self.size, len(free)))

    def to_petsc(self, template: PETSc.Mat) -> PETSc.Mat:
        """The matrix T of q = T z as a PETSc matrix, with its rows spread over ranks as those of `template`.

        z are the coordinates that are no pivots; the number of columns of T on a rank is its number of such
        coordinates.  Collective.
        """
        first, last = template.getOwnershipRange()
        pivots = np.count_nonzero((self.pivots >= first) & (self.pivots < last))
        return sparse(self.to_scipy()[first:last], template, columns=last - first - pivots)


def eliminate(C: sp.csr_matrix, names: Sequence[str]) -> Elimination:
    """Solve C q = 0 for one coordinate per row, by Gauss-Jordan elimination with complete pivoting.

    Parameters
    ----------
    C : (m, n) sparse matrix
        Constraint rows C.  A slider on a node is a unit row, whose elimination deletes the node's coordinate.
    names : sequence of str
        Names of the rows, for the error.

    Raises
    ------
    DependentRowsError
        If a row is zero or depends on the others.
    """
    touched = np.unique(C.indices[C.data != 0.0])
    A = C[:, touched].toarray()
    scale = np.abs(A).max(axis=1, initial=0.0)
    if not scale.all():
        raise DependentRowsError([names[i] for i in np.flatnonzero(scale == 0.0)])
    open_rows, pivots = list(range(len(A))), {}
    while open_rows:
        block = np.abs(A[open_rows]) / scale[open_rows, None]
        row, column = np.unravel_index(int(block.argmax()), block.shape)
        if block[row, column] < 1e-10:
            raise DependentRowsError([names[i] for i in open_rows])
        i = open_rows.pop(int(row))
        A[i] /= A[i, column]
        for other in set(range(len(A))) - {i}:
            A[other] -= A[other, column] * A[i]
        pivots[i] = int(column)
    columns = np.array([pivots[i] for i in range(len(A))], np.int64)
    remaining = np.setdiff1d(np.arange(len(touched)), columns)
    return Elimination(
        C.shape[1], touched[columns].astype(np.int64), touched[remaining].astype(np.int64), A[:, remaining]
    )


DENSE_UP_TO = 1500  # coordinates; above, sparse factors are the automatic choice


def eigensolver(model: FullModel, choice: str) -> EigenSolver:
    """Eigensolver of a model by `choice`: ``"dense"``, ``"slepc"``, or ``"auto"``.

    ``"auto"`` is dense up to `DENSE_UP_TO` coordinates.  The method `lowest(s, count)` of the solver computes the
    lowest modes with the rows held at path coordinate s (m); collective.  `lowest` raises a `DependentRowsError` if
    rigid rows depend on each other at s, and a `ConvergenceError` if fewer modes exist or converge.  If some rows have
    a compliance, or SLEPc is not installed, ``"slepc"`` means block Lanczos with one factor for all path coordinates.
    """
    if is_dense(model, choice):
        return DenseEigenSolver(model)
    if np.any(model.rows.compliance) or not HAS_PETSC:
        return OneFactorEigenSolver(model)
    return SlepcEigenSolver(model)


def is_dense(model: FullModel, choice: str) -> bool:
    """Whether `choice`, ``"dense"``, ``"slepc"`` or ``"auto"``, means LAPACK for a model of this size."""
    return choice == "dense" or (choice == "auto" and model.size <= DENSE_UP_TO)


class DenseEigenSolver:
    """Eigensolver that computes all modes by LAPACK on rank 0, and returns the lowest: reproducible, but O(n^3)."""

    def __init__(self, model: FullModel) -> None:
        self._model = model
        self._sigma = model.reference_frequency**2
        self._M, self._K = (None if A is None else A.toarray() for A in map(gather, (model.M, model.K)))

    def lowest(self, s: float, count: int) -> Modes:
        """Compute the `count` lowest modes with the rows held at path coordinate `s` (m); collective.

        Raises a `DependentRowsError` if rigid rows depend on each other, and a `TooManyModesError` if fewer modes
        exist.
        """
        model = self._model
        C, compliance = model.rows.at(s), model.rows.compliance
        rigid, soft = np.flatnonzero(compliance == 0.0), np.flatnonzero(compliance)
        elimination = eliminate(C[rigid], [model.rows.names[i] for i in rigid])
        check_count(count, model.size - len(elimination.pivots))
        phi, omega2, cut = np.empty((model.size, count)), np.empty(count), False
        if self._M is not None and self._K is not None:
            springs = (C[soft].T @ sp.diags(1.0 / compliance[soft]) @ C[soft]).toarray() if len(soft) else 0.0
            T = elimination.to_scipy()
            M, K = (T.T @ A @ T for A in (self._M, self._K + springs))
            mu, z = scipy.linalg.eigh(M, K + self._sigma * M)
            all_omega2 = 1.0 / mu[::-1] - self._sigma
            omega2, phi = all_omega2[:count], T @ z[:, ::-1][:, :count]
            cut = len(all_omega2) > count and are_clustered(all_omega2[count - 1], all_omega2[count])
        omega2, phi, cut = model.comm.bcast((omega2, phi, cut))
        return finish_modes(model, s, omega2, np.ascontiguousarray(phi[model.share]), cut)


class SlepcEigenSolver:
    """Eigensolver by Krylov-Schur with shift-and-invert on factors by MUMPS, which misses no mode.

    A single Krylov sequence finds only one vector of each multiple eigenvalue, so modes may be missing at first.  By
    Sylvester's law of inertia, the number of negative pivots of K - x M is the number of modes with omega^2 below x.
    If fewer modes were found, the solver runs again in the complement of the modes found.
    """

    def __init__(self, model: FullModel) -> None:
        self._model = model
        self._sigma = model.reference_frequency**2

    def lowest(self, s: float, count: int) -> Modes:
        """Compute the `count` lowest modes with the rows held at path coordinate `s` (m); collective.

        All rows are taken as rigid, so the model must have no row with a compliance.  Raises a `DependentRowsError` if
        rows depend on each other, and a `ConvergenceError` if fewer modes exist or converge.
        """
        model = self._model
        elimination = eliminate(model.rows.at(s), model.rows.names)
        dimension = model.size - len(elimination.pivots)
        check_count(count, dimension)
        T = elimination.to_petsc(model.M)
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

    def _solve(self, M: PETSc.Mat, K: PETSc.Mat, count: int, deflation: list[PETSc.Vec]) -> SolvedModes:
        """Eigenvalues omega^2 and modes of the `count` lowest modes of (K, M); collective.

        The modes are the lowest of all modes that are M-orthogonal to the vectors `deflation`.
        """
        eps = lowest_mode_solver(K, M, self._sigma, count)
        pc = eps.getST().getKSP().getPC()
        pc.setType("cholesky")
        pc.setFactorSolverType("mumps")
        free_objects(pc)  # a name that outlives the solver would keep the factor
        if deflation:
            eps.setDeflationSpace(deflation)
        return solve_modes(eps, count)


class OneFactorEigenSolver:
    r"""Eigensolver by block Lanczos with shift-and-invert, on one factor for all path coordinates.

    The matrix F = K + sigma M is factorised once.  The m rows C(s) change it by a low rank.  The rows' compliances are
    the diagonal matrix 1/k, which is zero for rigid rows.  The inverse that is applied to vectors is

    .. math::
        \bigl(F + C^T k\, C\bigr)^{-1} = F^{-1} - F^{-1} C^T \bigl(1/k + C F^{-1} C^T\bigr)^{-1} C F^{-1}

    (Woodbury's formula; for 1/k = 0 its limit, in which C phi = 0).  One path coordinate costs m solves with F and the
    solves of the Lanczos iteration.
    """

    def __init__(self, model: FullModel) -> None:
        """Factorise K + sigma M of the model, with sigma from its reference frequency; collective."""
        self._model, self._sigma = model, model.reference_frequency**2
        F = model.K.copy()
        F.axpy(self._sigma, model.M, structure=PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN)
        self._factor = factor_of(F, "K + sigma M")
        free_objects(F)

    def lowest(self, s: float, count: int) -> Modes:
        """Compute the `count` lowest modes with the rows held at path coordinate `s` (m); collective.

        Raises a `DependentRowsError` if rigid rows depend on each other, and a `ConvergenceError` if fewer modes exist
        or converge.
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
            """Return the inverse in the class's docstring times the columns of `g`, in the shape of `g`."""
            x = factor.solve_columns(g)
            if held is not None:
                subtract(x, answers, scipy.linalg.cho_solve(held, inner(Ct, x, model.comm)))
            return x

        loads = np.random.default_rng(7).uniform(-1.0, 1.0, (model.size, BLOCK))[model.share]
        pairs = min(count + 1, dimension)  # one more tells whether the last one belongs to a cluster
        spectrum = largest_eigenpairs(apply, model.M, apply(np.asfortranarray(loads)), pairs, dimension)
        omega2 = 1.0 / spectrum.theta - self._sigma
        cut = len(omega2) > count and are_clustered(omega2[count - 1], omega2[count])
        return finish_modes(model, s, omega2[:count], np.asfortranarray(spectrum.vectors[:, :count]), cut)


EigenSolver = DenseEigenSolver | SlepcEigenSolver | OneFactorEigenSolver


def lowest_frequencies(model: FullModel, s: Array, count: int, solver: str) -> Array:
    """Lowest circular frequencies (S, f) in rad/s with the rows held at each path coordinate `s` (S,) m; collective.

    The number f of frequencies is `count`, but at most the number of coordinates minus the number of rows, including
    rows with a compliance.  `solver` is the choice of `eigensolver`, whose errors are raised.
    """
    solver_of_model = eigensolver(model, solver)
    count = min(count, model.size - len(model.rows.names))
    return np.array([solver_of_model.lowest(float(at), count).omega for at in s])


def _inertia(M: PETSc.Mat, K: PETSc.Mat, below: float) -> int:
    """Number of eigenvalues omega^2 of (K, M) that are less than `below` in (rad/s)^2; collective.

    The result is the number of negative pivots of K - `below` M (Parlett 1998, section 3.3).
    """
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
