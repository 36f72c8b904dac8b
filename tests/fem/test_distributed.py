"""Products of distributed matrices, and the memory that they give back."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from processes import resident

from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import sparse, times
from pmr.fem.factor import Factor
from pmr.fullmodel.assembly import share


def distributed(A: sp.csr_matrix) -> PETSc.Mat:
    first, last = share(A.shape[0], MPI.COMM_WORLD)
    empty = PETSc.Mat().createAIJ(((last - first, A.shape[0]), (last - first, A.shape[0])), comm=MPI.COMM_WORLD)
    return sparse(sp.csr_matrix(A[first:last]), empty, columns=int(last - first))


def chain(n: int) -> sp.csr_matrix:
    """Stiffness of n masses between walls."""
    return sp.diags([-np.ones(n - 1), 2.0 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1], format="csr")


@pytest.mark.mpi
def test_a_product_is_that_of_the_whole_matrices() -> None:
    rectangular = sp.random(30, 20, 0.3, format="csr", random_state=4)
    first, last = share(30, MPI.COMM_WORLD)
    low, high = share(20, MPI.COMM_WORLD)
    A = sparse(sp.csr_matrix(rectangular[first:last]), distributed(chain(30)), columns=int(high - low))
    X = np.random.default_rng(5).normal(size=(20, 3))
    assert times(A, X[low:high]) == pytest.approx((rectangular @ X)[first:last], abs=1e-14)


@pytest.mark.mpi
def test_products_leave_nothing_behind() -> None:
    A = distributed(chain(40_000))
    X = np.ones((A.getLocalSize()[0], 40))
    times(A, X)
    before = resident()
    for _ in range(10):
        times(A, X)
    assert resident() - before < 0.2 * 10 * 2 * X.nbytes / 2**20


@pytest.mark.slow
@pytest.mark.mpi
def test_a_factor_solves_without_its_matrix_and_goes_when_told() -> None:
    K = sp.csr_matrix(sp.kronsum(chain(100), chain(100)))
    load = K @ np.ones((10_000, 2))
    first, last = share(10_000, MPI.COMM_WORLD)
    before = 0.0
    for repeat in range(12):
        A = distributed(K)
        factor = Factor(A, "K")
        A.destroy()
        assert factor.solve_columns(load[first:last]) == pytest.approx(1.0, abs=1e-9)
        factor.destroy()
        if repeat == 1:
            before = resident()
    # left behind, each of them would take more than 20 numbers a coordinate
    assert resident() - before < 0.3 * 10 * 20 * 8 * 10_000 / 2**20 / MPI.COMM_WORLD.size
