from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import PPoly

from pmr.constraints.polynomials import evaluate, stacked
from pmr.constraints.rows import Row, Rows, fixed_row

RNG = np.random.default_rng(1)


def random_row(name: str = "slider", breaks=(0.0, 0.4, 1.0, 2.0), size: int = 12) -> Row:
    k = len(breaks) - 1
    dofs = np.array([RNG.choice(size, 4, replace=False) for _ in range(k)])
    return Row(name, np.array(breaks), dofs, RNG.standard_normal((4, k, 4)))


def dense(row: Row, s: float, derivative: int, size: int = 12) -> np.ndarray:
    result = np.zeros(size)
    dofs, entries = row.at(s, derivative)
    result[dofs] = entries
    return result


def test_entries_are_the_polynomial_of_their_interval() -> None:
    row = random_row()
    x = 0.7 - 0.4
    expected = sum(row.coefficients[p, 1] * x ** (3 - p) for p in range(4))
    dofs, entries = row.at(0.7)
    assert dofs.tolist() == row.dofs[1].tolist() and entries == pytest.approx(expected)
    slope = sum((3 - p) * row.coefficients[p, 1] * x ** (2 - p) for p in range(3))
    assert row.at(0.7, derivative=1)[1] == pytest.approx(slope)


def test_apply_is_the_row_times_each_state() -> None:
    row, s = random_row(), np.array([0.0, 0.4, 0.9, 2.0])
    q = RNG.standard_normal((4, 12))
    for derivative in (0, 1):
        expected = [dense(row, at, derivative) @ state for at, state in zip(s, q, strict=True)]
        assert row.apply(s, q, derivative) == pytest.approx(expected)


def test_projection_is_the_row_times_the_basis_whole_or_in_shares() -> None:
    row, V = random_row(), RNG.standard_normal((12, 5))
    whole = row.project(V)
    shares = [row.project(V[:5], 0), row.project(V[5:5], 5), row.project(V[5:], 5)]
    for s in np.linspace(0.0, 2.0, 21):
        assert whole(s) == pytest.approx(dense(row, s, 0) @ V)
        assert sum(share(s) for share in shares) == pytest.approx(whole(s))


def test_stacked_rows_keep_their_values_on_common_breaks() -> None:
    V = RNG.standard_normal((12, 3))
    first, second = random_row("a"), random_row("b", (-0.5, 0.3, 1.4, 1.9))
    fixed = fixed_row("c", [4, 7], [1.0, -2.0], (0.0, 3.0))
    table = stacked([row.project(V) for row in (first, second, fixed)], Rows((first, second, fixed), 12).domain)
    assert (table.x[0], table.x[-1]) == (0.0, 1.9) and set(np.round(table.x, 9)) == {0.0, 0.3, 0.4, 1.0, 1.4, 1.9}
    for s in np.linspace(0.0, 1.9, 39):
        for i, row in enumerate((first, second, fixed)):
            for derivative in range(3):
                expected = dense(row, s, derivative) @ V
                assert evaluate(table, s, derivative)[i] == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_breaks_that_differ_by_round_off_are_one() -> None:
    rows = [PPoly(np.ones((2, 2, 1)), [0.0, 0.5, 1.0]), PPoly(np.ones((2, 2, 1)), [0.0, 0.5 + 1e-15, 1.0])]
    assert len(stacked(rows, (0.0, 1.0)).x) == 3


def test_rows_make_a_sparse_matrix() -> None:
    rows = Rows((fixed_row("pin", 3, 1.0, (0.0, 2.0)), random_row()), 12)
    C = rows.at(0.7)
    assert C.shape == (2, 12) and C.nnz == 5 and rows.names == ("pin", "slider")
    assert C.toarray()[1] == pytest.approx(dense(rows.rows[1], 0.7, 0))
    assert rows.at(0.7, derivative=1).toarray()[0] == pytest.approx(np.zeros(12))


@pytest.mark.parametrize("s", [-0.1, 2.1, np.nan])
def test_outside_the_path_there_is_no_row(s: float) -> None:
    row = random_row()
    with pytest.raises(ValueError, match="allowed are 0 to 2 m"):
        row.at(s)
    with pytest.raises(ValueError, match="allowed are 0 to 2 m"):
        row.apply(np.array([1.0, s]), np.zeros((2, 12)))
    assert np.array_equal(row.at(2.0 + 1e-12)[1], row.at(2.0)[1])
