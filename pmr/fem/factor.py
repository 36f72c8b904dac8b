"""Symmetric positive definite matrices, factorised once by MUMPS and solved with ever after."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.fem.compat import PETSc
from pmr.fem.distributed import freed, view

Array = NDArray[np.float64]

#: Right-hand sides solved at once: a column then costs a sixth of what it costs alone (18,000 coordinates).
BLOCK = 64


class Factor:
    """L L^T of a distributed matrix.

    Raises
    ------
    InputError
        If the matrix, called `name`, is not positive definite.
    """

    def __init__(self, A: PETSc.Mat, name: str) -> None:
        A.setOption(PETSc.Mat.Option.SPD, True)
        pc = PETSc.PC().create(comm=A.comm)
        pc.setOperators(A)
        pc.setType("cholesky")
        pc.setFactorSolverType("mumps")
        pc.setFactorSetUpSolverType()
        pc.setUp()
        self._factor = pc.getFactorMatrix()
        pc.destroy()  # and with it its hold on A: the factor alone solves
        self._factor.setMumpsIcntl(27, BLOCK)  # so many at once within MUMPS too, not its 32: an eighth faster
        if self._factor.getMumpsInfog(1) < 0:
            raise InputError("body", name, None, "a positive definite matrix is allowed")

    def solve(self, right: PETSc.Vec, answer: PETSc.Vec) -> None:
        """Answer to one right-hand side."""
        self._factor.solve(right, answer)

    def solve_columns(self, columns: Array) -> Array:
        """Answers, this rank's rows (n_local, k), to a few right-hand sides given likewise.

        Right-hand sides in Fortran's order are not copied; the result is in that order.
        """
        result = np.empty(columns.shape, order="F")
        for k in range(0, columns.shape[1], BLOCK):
            right = view(np.asfortranarray(columns[:, k : k + BLOCK]), self._factor)
            answer = view(result[:, k : k + BLOCK], self._factor)
            self._factor.matSolve(right, answer)
            freed(right, answer)
        return result

    def destroy(self) -> None:
        """Give the factor's memory back."""
        self._factor.destroy()


def product(A: PETSc.Mat, x: Array) -> Array:
    """This rank's rows of A x, x (n_local,) given likewise."""
    right, result = A.createVecs()
    right.getArray()[:] = x
    A.mult(right, result)
    found = np.array(result.getArray())
    right.destroy()  # at once: what is only dropped is kept until all ranks clean up together
    result.destroy()
    return found
