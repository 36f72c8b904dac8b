"""Static solves with one factorisation: MUMPS on the distributed stiffness, or LAPACK on rank 0."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pmr.dolfinx_compat import PETSc
from pmr.errors import ConvergenceError
from pmr.operators import FullModel, gather
from pmr.parallel import tall
from pmr.sliding import Row, Rows
from pmr.snapshots.eigensolvers import is_dense
from pmr.snapshots.elimination import Elimination, eliminate

Array = NDArray[np.float64]

_SINGULAR = "the stiffness is singular on the fixed supports although all rigid-body modes are held: {}"


class StaticSolver(Protocol):
    """x = T (T^T K T)^-1 T^T g, with T spanning the motions that the held rows allow."""

    def solve(self, g: Array) -> Array:
        """This rank's rows (n_local, k) of the answers to loads given likewise; collective."""
        ...


def static_solver(model: FullModel, held: Sequence[Row], choice: str = "auto") -> StaticSolver:
    """``"dense"``, ``"slepc"`` (MUMPS) or ``"auto"``, as for the eigenmodes.

    The `held` rows must leave no rigid motion.

    Raises
    ------
    ConvergenceError
        If they do.
    DependentRowsError
        If they depend on each other.
    """
    rows = Rows(tuple(held), model.size)
    elimination = eliminate(rows.at(rows.domain[0]) if held else rows.at(0.0), rows.names)
    return (_Dense if is_dense(model, choice) else _Mumps)(model, elimination)


class _Dense:
    def __init__(self, model: FullModel, elimination: Elimination) -> None:
        self._comm, self._share = model.comm, slice(*model.K.getOwnershipRange())
        self._T = elimination.matrix()
        K, failure = gather(model.K), None
        if K is not None:
            try:
                self._factor = scipy.linalg.cho_factor((self._T.T @ K @ self._T).toarray(), lower=True)
            except np.linalg.LinAlgError as error:
                failure = str(error)
        if failure := self._comm.bcast(failure):
            raise ConvergenceError(_SINGULAR.format(failure))

    def solve(self, g: Array) -> Array:
        shares, x = self._comm.gather(g), None
        if shares is not None:
            x = self._T @ scipy.linalg.cho_solve(self._factor, self._T.T @ np.concatenate(shares))
        return np.ascontiguousarray(self._comm.bcast(x)[self._share])


class _Mumps:
    def __init__(self, model: FullModel, elimination: Elimination) -> None:
        self._T = elimination.petsc(model.K)
        K = model.K.PtAP(self._T)
        K.setOption(PETSc.Mat.Option.SPD, True)
        self._ksp = PETSc.KSP().create(comm=K.comm)
        self._ksp.setOperators(K)
        self._ksp.setType("preonly")
        pc = self._ksp.getPC()
        pc.setType("cholesky")
        pc.setFactorSolverType("mumps")
        try:
            self._ksp.setUp()
        except PETSc.Error as error:
            raise ConvergenceError(_SINGULAR.format(error)) from None
        self._factor = pc.getFactorMatrix()
        self._transposed = self._T.transpose(PETSc.Mat())

    def solve(self, g: Array) -> Array:
        load = tall(g, self._T)
        right = self._transposed.matMult(load)
        z = right.duplicate()
        self._factor.matSolve(right, z)
        answer = self._T.matMult(z)
        result = np.array(answer.getDenseArray())
        for matrix in (load, right, z, answer):
            matrix.destroy()
        return result
