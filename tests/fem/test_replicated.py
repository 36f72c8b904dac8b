"""A factor on each rank, and columns on their way to it and back."""

from __future__ import annotations

import logging

import numpy as np
import pytest
from distributed import laplacian

from pmr.fem import factor
from pmr.fem.compat import MPI
from pmr.fem.factor import Exchange, Factor, NotDefiniteError, ReplicatedFactor, TooLargeError, factor_for_columns

pytestmark = pytest.mark.mpi
SIDE = 100


@pytest.mark.parametrize("count", [0, 1, 5, 2 * factor.BLOCK + 3])
def test_columns_come_back_as_rows(count: int) -> None:
    comm = MPI.COMM_WORLD
    ends = np.arange(comm.size + 1) * (comm.size + 6) // comm.size
    exchange, whole = Exchange(comm, ends), np.arange(ends[-1] * count, dtype=float).reshape(ends[-1], count)
    mine = slice(*ends[comm.rank : comm.rank + 2])
    columns = exchange.columns(np.asfortranarray(whole[mine]))
    assert np.array_equal(np.hstack(comm.allgather(columns)), whole)
    back = np.full(whole[mine].shape, np.nan, order="F")
    exchange.rows(columns, back)
    assert np.array_equal(back, whole[mine])


@pytest.mark.slow
@pytest.mark.numerical
def test_each_rank_answers_its_share_as_all_together_do() -> None:
    A, rng = laplacian(SIDE), np.random.default_rng(3)
    for count in (1, factor.BLOCK * MPI.COMM_WORLD.size + 7):
        g = rng.normal(size=(A.getLocalSize()[0], count))
        spread, held = Factor(A, "K"), ReplicatedFactor(A, "K")
        expected = spread.solve_columns(g)
        np.testing.assert_allclose(held.solve_columns(g.copy(order="C")), expected, rtol=1e-9, atol=1e-9)
        in_place = g.copy(order="F")
        assert held.solve_columns(in_place) is in_place
        np.testing.assert_allclose(in_place, expected, rtol=1e-9, atol=1e-9)
        spread.destroy()
        held.destroy()


def test_what_does_not_fit_on_each_rank_is_spread_over_them_and_said_to_be(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    A = laplacian(SIDE)
    assert isinstance(factor_for_columns(A, "K"), Factor if MPI.COMM_WORLD.size == 1 else ReplicatedFactor)
    monkeypatch.setattr(factor, "COPIES", 1e-12)
    with pytest.raises(TooLargeError):
        ReplicatedFactor(A, "K")
    with caplog.at_level(logging.WARNING):
        assert isinstance(factor_for_columns(A, "K"), Factor)
    said = MPI.COMM_WORLD.size > 1 and MPI.COMM_WORLD.rank == 0
    assert ("the factor of K takes " in caplog.text) == ("spread over the ranks" in caplog.text) == said


def test_a_singular_matrix_is_refused_on_all_ranks() -> None:
    A = laplacian(SIDE)
    A.zeroRowsColumns([0] if MPI.COMM_WORLD.rank == 0 else [], diag=0.0)
    with pytest.raises(NotDefiniteError, match="positive definite"):
        ReplicatedFactor(A, "K")
