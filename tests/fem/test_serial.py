"""What SciPy stands in for is what PETSc does, on one rank."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from pmr.fem import serial
from pmr.fem.compat import MPI, PETSc
from pmr.fem.factor import NotDefiniteError, SparseFactor

N = 12


def matrix(home: Any, A: sp.csr_matrix) -> Any:
    comm = MPI.COMM_SELF if home is PETSc else serial.WORLD
    sizes = tuple((n, n) for n in A.shape)
    made = home.Mat().createAIJ(sizes, csr=(A.indptr, A.indices, A.data), comm=comm)
    made.assemble()
    return made


def dense(A: Any) -> np.ndarray:
    indptr, indices, entries = A.getValuesCSR()
    return sp.csr_matrix((entries, indices, indptr), shape=A.getSize()).toarray()


@pytest.fixture
def given() -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """A positive definite matrix and a tall one."""
    X, P = (sp.random(N, m, 0.3, format="csr", random_state=m) for m in (N, 5))
    return sp.csr_matrix(X @ X.T + sp.eye(N)), P


def found(home: Any, A: sp.csr_matrix, tall: sp.csr_matrix) -> dict[str, Any]:
    """What operations leave, each on a matrix of its own."""
    new = matrix(home, A)
    x, y = new.createVecs()
    x.getArray()[:] = np.arange(N)
    result: dict[str, Any] = {"diagonal": new.getDiagonal().getArray(), "largest": new.getDiagonal().max()}
    new.mult(x, y)
    result["mult"] = y.getArray().copy()
    z = y.duplicate()
    new.multAdd(x, y, z)
    result["multAdd"] = z.getArray()
    result["row"] = dict(zip(*new.getRow(3), strict=True))
    result["norm"] = new.norm(home.NormType.NORM_INFINITY)
    result["PtAP"] = dense(new.PtAP(matrix(home, tall)))
    rows = home.IS().createGeneral(np.array([4, 1, 7], dtype=home.IntType), comm=new.comm)
    result["createSubMatrix"] = dense(new.createSubMatrix(rows, rows))
    held, scaled, grown = (new.copy(), new.duplicate(copy=True), new.copy())
    held.zeroRowsColumns(np.array([0, 5], dtype=home.IntType), diag=3.0)
    scaled.scale(-2.0)
    grown.axpy(0.5, matrix(home, sp.eye(N, format="csr")), structure=home.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    result |= {"zeroRowsColumns": dense(held), "scale": dense(scaled), "axpy": dense(grown), "unchanged": dense(new)}
    B, C = (home.Mat().createDense(((N, N), (home.DECIDE if home is PETSc else 2, 2)), comm=new.comm) for _ in "BC")
    for one in (B, C):
        one.setUp()
        one.assemble()
    B.getDenseArray()[:] = np.arange(2 * N).reshape(N, 2)
    new.matMult(B, C)
    result |= {"matMult": C.getDenseArray().copy(), "sizes": new.getSizes(), "share": new.getOwnershipRange()}
    return result


def test_operations_are_those_of_petsc(given: tuple[sp.csr_matrix, sp.csr_matrix]) -> None:
    expected = found(PETSc, *given)
    for name, value in found(serial.PETSc, *given).items():
        if name == "row":
            assert {k: v for k, v in value.items() if v} == pytest.approx(
                {k: v for k, v in expected[name].items() if v}
            )
        else:
            np.testing.assert_allclose(value, expected[name], rtol=1e-13, atol=1e-13, err_msg=name)


def test_a_factor_solves_and_refuses_what_is_not_definite(given: tuple[sp.csr_matrix, sp.csr_matrix]) -> None:
    A, rhs = given[0], np.random.default_rng(2).normal(size=(N, 3))
    factor = SparseFactor(serial.Mat(A), "A")
    np.testing.assert_allclose(A @ factor.solve_columns(rhs), rhs, rtol=0.0, atol=1e-12)
    answer = serial.Vec(np.zeros(N))
    factor.solve(serial.Vec(rhs[:, 0]), answer)
    np.testing.assert_allclose(A @ answer.getArray(), rhs[:, 0], rtol=0.0, atol=1e-12)
    factor.destroy()
    for B in (A - 3.0 * sp.eye(N), sp.diags([0.0, *np.ones(N - 1)], format="csr"), sp.csr_matrix(np.fliplr(np.eye(N)))):
        with pytest.raises(NotDefiniteError, match="A: a positive definite matrix"):
            SparseFactor(serial.Mat(sp.csr_matrix(B)), "A")
