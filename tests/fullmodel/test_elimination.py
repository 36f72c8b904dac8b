from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import gather, sparse
from pmr.fullmodel.assembly import share
from pmr.fullmodel.build import full_model
from pmr.fullmodel.eigensolvers import DependentRowsError, eliminate

RNG = np.random.default_rng(3)


def test_every_z_satisfies_the_rows_and_nothing_else_is_lost() -> None:
    C = sp.random(4, 30, density=0.3, random_state=5, format="csr")
    T = eliminate(C, "abcd").to_scipy()
    assert T.shape == (30, 26)
    assert np.abs(C @ T.toarray()).max() < 1e-14
    assert np.linalg.matrix_rank(T.toarray()) == 26


def test_a_unit_row_deletes_its_coordinate() -> None:
    C = sp.csr_matrix(([1.0], ([0], [2])), shape=(1, 5))
    assert np.array_equal(eliminate(C, ["slider"]).to_scipy().toarray(), np.delete(np.eye(5), 2, axis=1))


def test_dependent_rows_are_named() -> None:
    C = sp.csr_matrix(np.array([[1.0, 2.0, 0.0], [0.0, 1.0, 1.0], [1.0, 4.0, 2.0]]))
    with pytest.raises(DependentRowsError, match="slider"):
        eliminate(C, ["support", "other", "slider"])


def test_rows_of_very_different_size_are_no_less_independent() -> None:
    C = sp.csr_matrix(np.array([[1.0, 0.5, 0.0], [0.0, 1e-12, 1e-12]]))
    assert np.abs(C @ eliminate(C, "ab").to_scipy().toarray()).max() < 1e-24


@pytest.mark.mpi
@pytest.mark.parametrize("s", [0.1, 1.27, 2.5, 5.0])
def test_the_distributed_matrix_is_the_same(load_scene, s: float) -> None:
    model = full_model(load_scene())
    elimination = eliminate(model.rows.at(s), model.rows.names)
    T = gather(elimination.to_petsc(model.M))
    if MPI.COMM_WORLD.rank == 0:
        assert np.array_equal(T.toarray(), elimination.to_scipy().toarray())


@pytest.mark.mpi
def test_the_condensed_matrix_is_the_product_with_the_pivots_on_its_diagonal() -> None:
    n, comm = 40, MPI.COMM_WORLD
    A = sp.random(n, n, density=0.2, random_state=8)
    K = sp.csr_matrix(A @ A.T + sp.eye(n))
    C = sp.vstack([sp.random(3, n, density=0.3, random_state=9), sp.csr_matrix(([1.0], ([0], [17])), (1, n))])
    elimination = eliminate(sp.csr_matrix(C), "abcd")
    first, last = share(n, comm)
    like = PETSc.Mat().createAIJ(((last - first, n), (last - first, n)), comm=comm)
    condensed = gather(elimination.condense(sparse(K[first:last], like, columns=int(last - first))))
    if comm.rank == 0:
        T, free = elimination.to_scipy(), elimination.free
        expected = K.diagonal().max() * np.eye(n)
        expected[np.ix_(free, free)] = (T.T @ K @ T).toarray()
        assert condensed.toarray() == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())
