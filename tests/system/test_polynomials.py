from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import PPoly

from pmr.system.polynomials import (
    add_tables,
    join_columns,
    multiply_matrix,
    multiply_tables,
    select_columns,
    select_rows,
    transpose,
)

RNG = np.random.default_rng(3)
S = np.linspace(0.0, 5.0, 41)


def table(powers: int, *shape: int, breaks: tuple[float, ...] = (0.0, 2.0, 5.0)) -> PPoly:
    return PPoly(RNG.standard_normal((powers, len(breaks) - 1, *shape)), breaks)


def test_products_of_tables_are_those_of_their_values() -> None:
    A, B, weights, X = table(4, 2, 5), table(3, 3, 5), RNG.standard_normal(5), RNG.standard_normal((5, 2))
    found = multiply_tables(A, B, weights)
    assert found.c.shape == (6, 2, 2, 3)
    assert found(S) == pytest.approx(A(S) * weights @ B(S).swapaxes(1, 2), abs=1e-9)
    assert multiply_matrix(A, X)(S) == pytest.approx(A(S) @ X, abs=1e-10)
    assert np.array_equal(transpose(A)(S), A(S).swapaxes(1, 2))


@pytest.mark.parametrize("breaks", [(0.0, 2.0, 5.0), (0.0, 1.0, 3.0, 5.0)])
@pytest.mark.parametrize("powers", [2, 4, 5])
def test_sums_take_any_degrees_and_breaks(powers: int, breaks: tuple[float, ...]) -> None:
    A, B = table(4, 2, 2), table(powers, 2, 2, breaks=breaks)
    before = A(S), B(S)
    assert add_tables(A, B, -0.3)(S) == pytest.approx(A(S) - 0.3 * B(S), abs=1e-9)
    assert np.array_equal(A(S), before[0]) and np.array_equal(B(S), before[1])


def test_a_product_may_have_a_matrix_between_or_nothing() -> None:
    A, B, W = table(4, 2, 5), table(3, 3, 4), RNG.standard_normal((5, 4))
    assert multiply_tables(A, B, W)(S) == pytest.approx(A(S) @ W @ B(S).swapaxes(1, 2), abs=1e-9)
    assert multiply_tables(A, A)(S) == pytest.approx(A(S) @ A(S).swapaxes(1, 2), abs=1e-9)


def test_parts_of_a_table_and_tables_side_by_side() -> None:
    A, B = table(4, 2, 5), table(2, 2, 3, breaks=(0.0, 1.0, 5.0))
    both = join_columns(A, B)
    assert both(S) == pytest.approx(np.concatenate([A(S), B(S)], axis=2), abs=1e-9)
    assert select_columns(both, slice(5, None))(S) == pytest.approx(B(S), abs=1e-9)
    assert select_rows(both, [1])(S) == pytest.approx(both(S)[:, 1:], abs=1e-9)
