from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import PPoly

from pmr.system.polynomials import apply_table, evaluate

LENGTH = 5.0


def table(powers: int, m: int, r: int) -> PPoly:
    rng = np.random.default_rng(7 * powers + m + r)
    breaks = np.sort(np.concatenate([[0.0, LENGTH], rng.uniform(0.0, LENGTH, 9)]))
    return PPoly(rng.standard_normal((powers, 10, m, r)), breaks)


#: Forwards, backwards, at rest, onto breaks and ends, and from one end to the other at once.
PATH = np.concatenate(
    [np.linspace(0.0, LENGTH, 40), np.linspace(LENGTH, 0.0, 23), [2.0, 2.0, 2.0, LENGTH, 0.0, LENGTH]]
)


@pytest.mark.parametrize(("powers", "m", "r"), [(4, 3, 20), (7, 1, 1), (1, 2, 3), (4, 0, 5), (4, 2, 0)])
def test_it_is_the_product_with_the_values(powers: int, m: int, r: int) -> None:
    """To u times the sum of what adds up: r terms, each a polynomial by Horner's rule."""
    one = table(powers, m, r)
    path = np.concatenate([PATH, one.x, one.x[::-1]])
    x = np.random.default_rng(0).standard_normal((len(path), r))
    limit = np.finfo(float).eps * (r + 2 * powers) * np.abs(one.c).sum(axis=(0, 3)).max(initial=0.0) * LENGTH**powers
    for derivative in (0, 1):
        values = evaluate(one, path, derivative)
        found = apply_table(one, path, x, derivative)
        np.testing.assert_allclose(found, np.einsum("tmr,tr->tm", values, x), rtol=0.0, atol=powers * limit * 3.0)


def test_nan_stays_visible() -> None:
    one, x = table(4, 2, 3), np.ones((4, 3))
    x[2, 1] = np.nan
    assert np.isnan(apply_table(one, np.full(4, 1.3), x)).any(axis=1).tolist() == [False, False, True, False]


def test_beyond_the_path_nothing_is_said() -> None:
    with pytest.raises(ValueError, match="outside the path"):
        apply_table(table(4, 1, 2), np.array([1.0, LENGTH + 0.1]), np.ones((2, 2)))
    with pytest.raises(ValueError, match="outside the path"):
        apply_table(table(4, 1, 2), np.array([np.nan, 1.0]), np.ones((2, 2)))
