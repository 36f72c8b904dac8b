"""Factors that do not fit into memory.
A factor on each rank, and columns on their way to it and back.
"""

import logging
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest
import scipy.sparse as sp
from distributed import laplacian

from pmr import InputError
from pmr.fem import factor, serial
from pmr.fem.compat import MPI, PETSc
from pmr.fem.factor import (
    Exchange,
    Factor,
    NotDefiniteError,
    ReplicatedFactor,
    SequentialFactor,
    SparseFactor,
    TooLargeError,
    factor_for_columns,
    factor_for_steps,
    refusal,
)

pytestmark = pytest.mark.mpi
SIDE = 220


@pytest.mark.slow
def test_a_factor_that_does_not_fit_is_kept_in_files_and_solves_as_well(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, tmp_path, capfd
) -> None:
    A = laplacian(SIDE)
    g = np.asfortranarray(np.random.default_rng(1).normal(size=(A.getLocalSize()[0], 5)))
    within = Factor(A, "K")
    whole = within._factor.getMumpsInfog(16)
    beside = within._factor.getMumpsInfog(26)
    assert beside < whole - 2  # or the bound below would mean nothing
    expected = within.solve_columns(g.copy(order="F"))
    within.destroy()
    assert not caplog.records
    monkeypatch.setattr(factor, "free_memory", lambda comm: (whole + 2 * beside) // 3)
    with caplog.at_level(logging.WARNING):
        outside = Factor(A, "K")
    assert outside._factor.getMumpsInfog(1) == 0 and outside._factor.getMumpsIcntl(22) == 1
    if MPI.COMM_WORLD.rank == 0:
        assert f"the factor of K takes {whole} MB" in caplog.text and "kept in files" in caplog.text
    np.testing.assert_allclose(outside.solve_columns(g), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    outside.destroy()


@pytest.mark.slow
def test_a_factor_that_does_not_even_fit_with_files_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(factor, "free_memory", lambda comm: 1)
    with pytest.raises(InputError, match=r"the factor of K takes \d+ MB.*a coarser mesh or more memory is allowed"):
        Factor(laplacian(SIDE), "K")


@pytest.mark.slow
def test_files_that_can_not_be_written_are_said_to_be(monkeypatch: pytest.MonkeyPatch, capfd) -> None:
    A = laplacian(SIDE)
    within = Factor(A, "K")
    whole, beside = (within._factor.getMumpsInfog(i) for i in (16, 26))
    within.destroy()
    monkeypatch.setattr(factor, "free_memory", lambda comm: (whole + 2 * beside) // 3)
    monkeypatch.setenv("MUMPS_OOC_TMPDIR", "/nowhere/at/all")
    with pytest.raises(InputError, match=r"can't be kept in files \(MUMPS -90\); a folder in MUMPS_OOC_TMPDIR"):
        Factor(A, "K")


@pytest.mark.parametrize("code", [-5, -7, -8, -9, -13, -17, -19, -20])
def test_no_memory_is_told_from_a_matrix_without_a_factor(code: int) -> None:
    said = refusal("K", code)
    assert not isinstance(said, NotDefiniteError) and f"no memory for the factor of K (MUMPS {code})" in str(said)


def test_no_memory_for_steps_is_no_matrix_without_a_factor(monkeypatch: pytest.MonkeyPatch) -> None:
    """CHOLMOD ends with the status -2, SuperLU in an error of Python or one of its own: an empty K was blamed."""
    A = laplacian(SIDE)
    failures = [PETSc.Error(76), RuntimeError("SUPERLU_MALLOC fails for buf in intCalloc()"), MemoryError()]
    for failure in failures:
        preconditioner = SimpleNamespace(setUp=Mock(side_effect=failure))
        monkeypatch.setattr(factor, "cholesky", lambda A, package, pc=preconditioner: pc)
        monkeypatch.setattr(factor, "splu", Mock(side_effect=failure))
        with pytest.raises(InputError, match=r"no memory for the factor of K \(.+\); a coarser mesh or more memory"):
            SequentialFactor(A, "K") if failure is failures[0] else SparseFactor(serial.Mat(sp.eye(3).tocsr()), "K")


def test_a_singular_matrix_is_refused() -> None:
    A = laplacian(SIDE)
    A.zeroRowsColumns([0] if MPI.COMM_WORLD.rank == 0 else [], diag=0.0)
    with pytest.raises(NotDefiniteError, match="positive definite"):
        Factor(A, "K")


@pytest.mark.slow
def test_whoever_solves_for_steps_says_the_same() -> None:
    A = laplacian(SIDE)
    g = np.asfortranarray(np.random.default_rng(6).normal(size=(A.getLocalSize()[0], 3)))
    plain, stepping = Factor(A, "S"), factor_for_steps(A, "S")
    expected = plain.solve_columns(g)
    np.testing.assert_allclose(stepping.solve_columns(g), expected, rtol=0.0, atol=1e-10 * np.abs(expected).max())
    right, answer = A.createVecs()
    right.getArray()[:] = g[:, 1]
    stepping.solve(right, answer)
    np.testing.assert_allclose(answer.getArray(), expected[:, 1], rtol=0.0, atol=1e-10 * np.abs(expected).max())
    assert MPI.COMM_WORLD.size == 1 or not isinstance(stepping, SequentialFactor)
    plain.destroy()
    stepping.destroy()


SIDE_REPLICATED = 100


@pytest.mark.parametrize("count", [0, 1, 5, 2 * factor.BLOCK + 3])
def test_columns_come_back_as_rows(count: int) -> None:
    comm = MPI.COMM_WORLD
    ends = np.arange(comm.size + 1) * (comm.size + 6) // comm.size
    exchange, whole = Exchange(comm, ends), np.arange(ends[-1] * count, dtype=float).reshape(ends[-1], count)
    mine = slice(*ends[comm.rank : comm.rank + 2])
    columns = exchange.columns(np.asfortranarray(whole[mine]))
    assert np.array_equal(np.hstack(comm.allgather(columns)), whole)
    back = np.full(whole[mine].shape, np.nan, order="F")
    exchange.write_rows(columns, back)
    assert np.array_equal(back, whole[mine])


@pytest.mark.slow
@pytest.mark.numerical
def test_each_rank_answers_its_share_as_all_together_do() -> None:
    A, rng = laplacian(SIDE_REPLICATED), np.random.default_rng(3)
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
    A = laplacian(SIDE_REPLICATED)
    assert isinstance(factor_for_columns(A, "K"), Factor if MPI.COMM_WORLD.size == 1 else ReplicatedFactor)
    monkeypatch.setattr(factor, "COPIES", 1e-12)
    with pytest.raises(TooLargeError):
        ReplicatedFactor(A, "K")
    with caplog.at_level(logging.WARNING):
        assert isinstance(factor_for_columns(A, "K"), Factor)
    said = MPI.COMM_WORLD.size > 1 and MPI.COMM_WORLD.rank == 0
    assert ("the factor of K takes " in caplog.text) == ("spread over the ranks" in caplog.text) == said


def test_a_singular_matrix_is_refused_on_all_ranks() -> None:
    A = laplacian(SIDE_REPLICATED)
    A.zeroRowsColumns([0] if MPI.COMM_WORLD.rank == 0 else [], diag=0.0)
    with pytest.raises(NotDefiniteError, match="positive definite"):
        ReplicatedFactor(A, "K")
