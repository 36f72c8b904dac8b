"""Damage of histories whose cycles are known."""

from __future__ import annotations

import numpy as np
import pytest

from pmr.errors import InputError
from pmr.results.fatigue import SNLine, damage


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
