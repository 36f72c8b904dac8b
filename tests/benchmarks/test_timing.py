"""Ways taken in turn, their least and median times, and the exponent of a power law."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.timing import Times, exponent, side_by_side


def test_ways_take_turns_and_may_say_how_long_they_took() -> None:
    order: list[str] = []
    values = iter([3.0, 1.0, 2.0])

    def one() -> float:
        order.append("one")
        return next(values)

    def other() -> None:
        order.append("other")
        np.linalg.svd(np.ones((60, 60)))

    times = side_by_side({"one": one, "other": other}, repeats=3)
    assert order == ["one", "other"] * 3
    assert times["one"] == Times((3.0, 1.0, 2.0))
    assert times["one"].summary() == {"min": 1.0, "median": 2.0, "repeats": 3}
    assert times["other"].least > 0.0
    assert times["one"].times(10.0).least == 10.0


def test_the_exponent_of_a_power_law() -> None:
    size = np.array([10.0, 100.0, 1000.0])
    assert exponent(size, 3.0 * size**1.7) == pytest.approx(1.7)
