"""Static solves with one factorisation: MUMPS on the distributed stiffness, or LAPACK on rank 0."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pmr.constraints.rows import Row, Rows
from pmr.errors import InputError
from pmr.fem.compat import PETSc
from pmr.fem.distributed import free_objects
from pmr.fem.factor import NotDefiniteError
from pmr.fem.matrices import gather
from pmr.fem.replicated import factor_for_columns
from pmr.fullmodel.eigensolvers import is_dense
from pmr.fullmodel.elimination import Condensed, Elimination, eliminate
from pmr.fullmodel.model import FullModel

Array = NDArray[np.float64]


class SingularError(InputError):
    """A stiffness resists nothing along some motion, or has a negative eigenvalue, where all rigid motions are held."""

    def __init__(self) -> None:
        allowed = (
            "a stiffness that resists all but rigid motions is allowed: on the supports, which hold these, it is "
            "singular; parts of the body are loose, or its matrix has negative eigenvalues, by rounding or by itself"
        )
        super().__init__("scene", "body", None, allowed)


class StaticSolver(Protocol):
    """x = T (T^T K T)^-1 T^T g, with T spanning the motions that the held rows allow."""

    def solve(self, g: Array) -> Array:
        """This rank's rows (n_local, k) of the answers to loads given likewise and maybe overwritten; collective."""

    def destroy(self) -> None:
        """Give the factor's memory back; collective."""


def static_solver(model: FullModel, held: Sequence[Row], choice: str = "auto") -> StaticSolver:
    """``"dense"``, ``"slepc"`` (MUMPS) or ``"auto"``, as for the eigenmodes.

    The `held` rows must leave no rigid motion.

    Raises
    ------
    SingularError
        If they do, and where the stiffness does not resist another motion.
    DependentRowsError
        If they depend on each other.
    InputError
        If the factor takes more memory than there is.
    """
    rows = Rows(tuple(held), model.size)
    elimination = eliminate(rows.at(rows.domain[0]) if held else rows.at(0.0), rows.names)
    return solver_of(model.K, elimination, is_dense(model, choice))


def solver_of(K: PETSc.Mat, elimination: Elimination, dense: bool) -> StaticSolver:
    """Make the static solver of a stiffness (n, n), dense or sparse."""
    return (_Dense if dense else _Mumps)(K, elimination)


class _Dense:
    def __init__(self, stiffness: PETSc.Mat, elimination: Elimination) -> None:
        self._comm, self._share = stiffness.comm.tompi4py(), slice(*stiffness.getOwnershipRange())
        self._T = elimination.matrix()
        K, failed = gather(stiffness), False
        if K is not None:
            try:
                self._factor = scipy.linalg.cho_factor((self._T.T @ K @ self._T).toarray(), lower=True)
            except np.linalg.LinAlgError:
                failed = True
        if self._comm.bcast(failed):
            raise SingularError()

    def solve(self, g: Array) -> Array:
        shares, x = self._comm.gather(g), None
        if shares is not None:
            x = self._T @ scipy.linalg.cho_solve(self._factor, self._T.T @ np.concatenate(shares))
        return np.ascontiguousarray(self._comm.bcast(x)[self._share])

    def destroy(self) -> None:
        self.__dict__.pop("_factor", None)


class _Mumps:
    def __init__(self, stiffness: PETSc.Mat, elimination: Elimination) -> None:
        self._condensed = Condensed(elimination, stiffness)
        K = elimination.condensed(stiffness)
        try:
            self._factor = factor_for_columns(K, "stiffness")
        except NotDefiniteError:
            raise SingularError() from None
        finally:
            free_objects(K)

    def solve(self, g: Array) -> Array:
        self._condensed.restrict(g)
        x = self._factor.solve_columns(g)
        self._condensed.extended(x)
        return x

    def destroy(self) -> None:
        self._factor.destroy()
