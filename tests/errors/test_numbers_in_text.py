"""Numbers in sentences."""

from __future__ import annotations

import numpy as np

from pmr.errors.text import two_digits, two_digits_below


def test_large_numbers_are_decimals() -> None:
    assert [two_digits(x) for x in (122.0, 9870.0, 100.0, 0.061, 2.0, 0.0, 470.4)] == (
        ["120", "9900", "100", "0.061", "2", "0", "470"]
    )


def test_what_is_small_enough_is_not_rounded_up() -> None:
    assert [two_digits_below(x) for x in (0.0028525, 0.000286, 0.29, 1.0, 2e-3, 1e-3, 0.1, 0.3)] == (
        ["0.0028", "0.00028", "0.29", "1", "0.002", "0.001", "0.1", "0.3"]
    )
    for value in 10.0 ** np.random.default_rng(0).uniform(-9.0, 9.0, 1000):
        assert 0.9 * value < float(two_digits_below(value)) <= value * (1.0 + 1e-11)
