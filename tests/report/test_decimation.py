from __future__ import annotations

import numpy as np
import pytest

from pmr.report.columns import envelope_indices, extreme_indices, interpolate, spread_indices


def test_peak_of_a_single_sample_stays() -> None:
    signal = np.zeros(15_001)
    signal[7_123], signal[7_124] = 1.0, -2.0
    kept = extreme_indices(signal, 300)
    assert {7_123, 7_124} <= set(kept)


def test_fast_oscillation_keeps_its_amplitude_everywhere() -> None:
    t = np.linspace(0.0, 15.0, 15_001)
    signal = np.sin(2.0 * np.pi * 97.3 * t)  # far more periods than intervals
    kept = extreme_indices(signal, 300)
    assert len(kept) <= 602
    for start in range(0, 15_000, 500):
        inside = signal[kept[(kept >= start) & (kept < start + 500)]]
        assert inside.max() > 0.9 and inside.min() < -0.9


def test_samples_stay_in_order_with_both_ends() -> None:
    kept = extreme_indices(np.random.default_rng(0).normal(size=5_000), 70)
    assert np.all(np.diff(kept) > 0)
    assert (kept[0], kept[-1]) == (0, 4_999)


@pytest.mark.parametrize("count", [1, 2, 50, 202])
def test_short_signals_are_left_whole(count: int) -> None:
    assert extreme_indices(np.zeros(count), 100).tolist() == list(range(count))


def test_envelope_holds_the_largest_of_each_interval() -> None:
    signal = np.tile([0.0, 3.0, 1.0, 2.0], 250)
    kept = envelope_indices(signal, 100)
    assert len(kept) == 100
    assert np.all(signal[kept] == 3.0)


def test_spread_has_both_ends_and_no_more_than_asked() -> None:
    assert spread_indices(5, 10).tolist() == [0, 1, 2, 3, 4]
    kept = spread_indices(15_001, 1500)
    assert len(kept) == 1500 and (kept[0], kept[-1]) == (0, 15_000)


def test_onto_interpolates_each_column() -> None:
    times = np.array([0.0, 1.0, 2.0])
    values = np.stack([times, 10.0 * times], axis=1)
    assert interpolate(np.array([0.5, 1.5]), times, values).tolist() == [[0.5, 5.0], [1.5, 15.0]]
    assert interpolate(np.array([0.5]), times, values[:, 0]).tolist() == [0.5]
    assert interpolate(times.copy(), times, values) is values
