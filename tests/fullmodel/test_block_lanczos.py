"""Block Lanczos against closed forms, where eigenvalues are many times the same."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from pmr.errors import ConvergenceError
from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import inner, sparse, times
from pmr.fem.factor import Factor
from pmr.fullmodel import modes
from pmr.fullmodel.assembly import share
from pmr.fullmodel.modes import largest_eigenpairs

pytestmark = pytest.mark.mpi


def distributed(A: sp.spmatrix) -> PETSc.Mat:
    first, last = share(A.shape[0], MPI.COMM_WORLD)
    like = PETSc.Mat().createAIJ(((last - first, A.shape[0]), (last - first, A.shape[0])), comm=MPI.COMM_WORLD)
    return sparse(sp.csr_matrix(A)[first:last], like, columns=int(last - first))


def cube(n: int) -> tuple[sp.csr_matrix, np.ndarray]:
    """Laplacian of n^3 points, whose eigenvalues come up to six times over, and all of them in ascending order."""
    chain = sp.diags([-np.ones(n - 1), 2.0 * np.ones(n), -np.ones(n - 1)], [-1, 0, 1])
    line = 4.0 * np.sin(np.arange(1, n + 1) * np.pi / (2 * n + 2)) ** 2
    values = (line[:, None, None] + line[:, None] + line).ravel()
    return sp.csr_matrix(sp.kronsum(sp.kronsum(chain, chain), chain)), np.sort(values)


def start(n: int, columns: int) -> np.ndarray:
    first, last = share(n, MPI.COMM_WORLD)
    return np.asfortranarray(np.random.default_rng(3).normal(size=(n, columns))[first:last])


@pytest.mark.parametrize("heavy", [1.0, 7.0])
def test_equal_eigenvalues_are_all_found(heavy: float) -> None:
    A, expected = cube(9)
    K, M = distributed(A), distributed(heavy * sp.eye(729))
    factor = Factor(K, "K")
    found = largest_eigenpairs(factor.solve_columns, M, factor.solve_columns(start(729, 8)), 17, 729)
    assert heavy / found.theta == pytest.approx(expected[:17], rel=1e-11)
    X, comm = found.vectors, MPI.COMM_WORLD
    assert inner(X, times(M, X), comm) == pytest.approx(np.eye(17), abs=1e-12)
    assert times(K, X) == pytest.approx(times(M, X) / found.theta, abs=1e-10)
    factor.destroy()


def test_a_space_that_ends_gives_what_it_has() -> None:
    A, expected = cube(3)
    K, M = distributed(A), distributed(sp.eye(27))
    factor = Factor(K, "K")
    found = largest_eigenpairs(factor.solve_columns, M, factor.solve_columns(start(27, 8)), 40, 27)
    assert 1.0 / found.theta == pytest.approx(expected, rel=1e-12)
    factor.destroy()


def test_what_does_not_converge_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(modes, "STEPS", 2)
    K, M = distributed(cube(9)[0]), distributed(sp.eye(729))
    factor = Factor(K, "K")
    with pytest.raises(ConvergenceError, match="not all of 17 eigenpairs"):
        largest_eigenpairs(factor.solve_columns, M, factor.solve_columns(start(729, 8)), 17, 729)
    factor.destroy()
