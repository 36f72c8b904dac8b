from __future__ import annotations

import numpy as np
import pytest

from pmr.compare.errors import band_limit, error_below_frequency

STEP = 1e-3
T = np.arange(2000) * STEP


def tone(frequency: float, amplitude: float = 1.0) -> np.ndarray:
    """With a whole number of periods."""
    return amplitude * np.sin(2.0 * np.pi * frequency * T)[:, None]


def test_what_two_signals_have_above_a_frequency_does_not_count() -> None:
    one, other = tone(5.0) + tone(80.0), 1.1 * tone(5.0) + tone(80.0, 3.0)
    assert error_below_frequency(one, other, STEP, 20.0) == pytest.approx(0.1 / 1.1, rel=1e-9)
    assert error_below_frequency(one, other, STEP, 1e3) == pytest.approx(
        np.hypot(0.1, 2.0) / np.hypot(1.1, 3.0), rel=1e-9
    )


def test_the_band_ends_where_a_hundredth_is_left() -> None:
    for amplitude, highest in ((0.5, 60.0), (0.001, 10.0)):
        found = band_limit(tone(10.0) + tone(60.0, amplitude), STEP)
        assert highest <= found <= highest + 3.0 / (len(T) * STEP)  # the window's width
    assert band_limit(np.zeros((10, 2)), STEP) == 0.0
