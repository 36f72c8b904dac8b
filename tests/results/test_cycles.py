from __future__ import annotations

import numpy as np
import pytest

from pmr.results.fatigue import SMALLEST, rainflow_cycles


def test_the_example_of_the_standard() -> None:
    """ASTM E1049-85, figure 6: half cycles of 3, 4, 8, 9, 8, 6 and a whole one of 4."""
    history = np.array([-2.0, 1.0, -3.0, 5.0, -1.0, 3.0, -4.0, 4.0, -2.0])
    found = rainflow_cycles(np.arange(9.0), history)
    assert sorted(map(tuple, found[:, [0, 2]].tolist())) == [
        (3.0, 0.5), (4.0, 0.5), (4.0, 1.0), (6.0, 0.5), (8.0, 0.5), (8.0, 0.5), (9.0, 0.5),
    ]  # fmt: skip
    assert np.all(np.diff(found[:, 0]) <= 0.0)
    for size, mean, _, begin, end in found:
        one, other = history[int(begin)], history[int(end)]
        assert (size, mean) == (abs(one - other), (one + other) / 2.0)


def test_a_sine_of_ten_periods_has_ten_cycles_of_its_double_amplitude() -> None:
    t = np.linspace(0.0, 10.0, 4001)
    found = rainflow_cycles(t, 3.0 + 50.0 * np.sin(2.0 * np.pi * t))
    whole = found[found[:, 0] > 99.0]
    assert whole[:, 2].sum() == pytest.approx(9.5)  # it begins and ends at a zero: a quarter at either end is missing
    assert np.allclose(whole[:, 0], 100.0, rtol=1e-4) and np.allclose(whole[:, 1], 3.0, atol=1e-2)


def test_what_is_tiny_beside_the_largest_is_left_out() -> None:
    history = np.array([0.0, 100.0, 100.0 - 99.0 * SMALLEST, 100.0, 100.0 - 101.0 * SMALLEST, 100.0, 0.0])
    assert sorted(rainflow_cycles(np.arange(7.0), history)[:, 0]) == pytest.approx([101.0 * SMALLEST, 100.0, 100.0])
    assert rainflow_cycles(np.arange(5.0), np.ones(5)).shape == (0, 5)
