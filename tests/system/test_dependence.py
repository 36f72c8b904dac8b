from __future__ import annotations

import numpy as np
import pytest

from pmr.system.definite import dependence_of_flexibility, dependence_of_rows

NAMES = ("a", "b", "c", "d")


def rows(angle: float) -> np.ndarray:
    """b deviates from twice a by the angle; c and d are independent, but not orthogonal."""
    a, e = np.array([1.0, 2.0, 0.0, 0.0, 0.0]), np.array([2.0, -1.0, 0.0, 0.0, 0.0])
    b = 2.0 * (np.cos(angle) * a + np.sin(angle) * e)
    return np.stack([a, b, [0.0, 0.0, 3.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0, 2.0]])


def test_only_rows_that_take_part_are_named() -> None:
    found = dependence_of_rows(rows(1e-5), NAMES)
    assert found.names == ("a", "b")
    assert found.measure == pytest.approx(1e-5 / np.sqrt(2.0), rel=1e-4)  # of the eigenvalue 1 - cos for unit vectors
    G = rows(1e-3) @ rows(1e-3).T
    assert dependence_of_flexibility(G, NAMES).names == ("a", "b")
    assert dependence_of_flexibility(G, NAMES).measure == pytest.approx(0.5e-6, rel=1e-3)


def test_independent_rows_have_a_measure_of_one() -> None:
    assert dependence_of_rows(np.diag([1.0, 5.0, 1e-3, 7.0]), NAMES).measure == pytest.approx(1.0)
    assert dependence_of_flexibility(np.diag([1.0, 5.0, 1e-3, 7.0]), NAMES).measure == pytest.approx(1.0)


def test_a_row_that_vanishes_is_named() -> None:
    C = rows(0.5)
    C[2] = 0.0
    for found in (dependence_of_rows(C, NAMES), dependence_of_flexibility(C @ C.T, NAMES)):
        assert (found.measure, found.names) == (0.0, ("c",))


def test_more_rows_than_coordinates_depend_on_each_other() -> None:
    assert dependence_of_rows(rows(0.5)[:, [0, 1, 3]], NAMES).measure == 0.0
