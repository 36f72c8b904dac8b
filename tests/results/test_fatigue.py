"""Damage of histories whose cycles are known."""

import numpy as np
import pytest

from pmr import InputError
from pmr.results.fatigue import RepeatedCycles, SNLine, damage, rainflow_cycles


def test_a_sinusoid_does_the_damage_of_its_cycles() -> None:
    """N cycles of 2 a: N (2 a / reference)^m / 2e6; half and whole cycles add up to N."""
    t = np.linspace(0.0, 50.0, 50 * 40 + 1)
    line = SNLine(slope=3.0, reference=90e6)
    expected = 50 * (2 * 30e6 / 90e6) ** 3 / 2e6
    assert damage(t, 12e6 + 30e6 * np.cos(2.0 * np.pi * t), line) == pytest.approx(expected, rel=1e-9)
    assert damage(t, 30e6 * np.cos(2.0 * np.pi * t), line, times=1e4) == pytest.approx(1e4 * expected, rel=1e-9)


def test_cycles_below_the_cut_off_do_none() -> None:
    t = np.arange(9.0)
    stress = np.array([0.0, 100.0, 60.0, 90.0, 0.0, 100.0, 60.0, 90.0, 0.0]) * 1e6
    both, large = (damage(t, stress, SNLine(5.0, 80e6, cut)) for cut in (0.0, 50e6))
    assert large == pytest.approx(2 * (100 / 80) ** 5 / 2e6, rel=1e-9)
    assert both - large == pytest.approx(2 * (30 / 80) ** 5 / 2e6, rel=1e-6)


@pytest.mark.parametrize("wrong", [{"slope": 0.0}, {"reference": -1.0}, {"cut_off": -1.0}, {"slope": np.nan}])
def test_what_is_no_line_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match=f"S-N line: {next(iter(wrong))}"):
        SNLine(**({"slope": 3.0, "reference": 1e8} | wrong))


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


def test_many_small_cycles_do_their_damage() -> None:
    """A thousand ripples of 0.9 % of one large cycle, on an S-N line of the slope 2, add 8.1 % to its damage."""
    history = np.concatenate([[0.0], np.tile([100e6, 99.1e6], 1000), [100e6, 0.0]])
    expected = (100.0**2 + 1000 * 0.9**2) / 100.0**2 / 2e6
    assert damage(np.arange(len(history)), history, SNLine(2.0, 100e6)) == pytest.approx(expected, rel=1e-9)
    assert rainflow_cycles(np.arange(5.0), np.ones(5)).shape == (0, 5)


def test_a_load_that_is_repeated_closes_its_cycles() -> None:
    """A history from 0 to the reference range is half a cycle; repeated it is a cycle each time but the first."""
    line, t, x = SNLine(3.0, 90e6), np.arange(3.0), np.array([0.0, 45e6, 90e6])
    assert damage(t, x, line) == pytest.approx(0.5 / 2e6)
    assert damage(t, x, line, times=1e5) == pytest.approx((1e5 - 0.5) / 2e6)
    closed, returned = np.arange(4.0), np.append(x, 0.0)
    assert damage(closed, returned, line, times=1e5) == pytest.approx(1e5 / 2e6)


def test_the_cycles_of_a_factor_times_a_history_are_those_of_the_history_times_the_factor() -> None:
    line, t, x = SNLine(3.0, 90e6), np.arange(4.0), np.array([0.0, 45e6, 10e6, 90e6])
    of_history, of_scaled = (RepeatedCycles.count(t, factor * x) for factor in (1.0, 1.7))
    assert of_history.damage(line, 1.7) == pytest.approx(of_scaled.damage(line), rel=1e-12)
