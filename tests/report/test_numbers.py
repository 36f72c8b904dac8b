from __future__ import annotations

import pytest

from pmr.report import numbers
from pmr.report.numbers import SPACE, Unit


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.0, 3, "0"),
        (0.7127, 3, "0.713"),
        (0.9999, 3, "1.00"),
        (47.8586, 4, "47.86"),
        (-12.0, 2, "−12"),
        (153.0, 2, "150"),
        (1.234e-7, 2, "1.2\u00a0·\u00a010⁻⁷"),
        (2.5e9, 2, "2.5\u00a0·\u00a010⁹"),
        (float("nan"), 3, "not finite"),
    ],
)
def test_significant(value: float, digits: int, text: str) -> None:
    assert numbers.significant(value, digits) == text


@pytest.mark.parametrize(
    ("largest", "base", "unit"),
    [
        (0.0, "m", Unit(1.0, "m")),
        (0.0478, "m", Unit(1e-3, "mm")),
        (0.99999, "m", Unit(1.0, "m")),  # would print as 1000 mm
        (2500.0, "m", Unit(1.0, "m")),
        (2500.0, "N", Unit(1e3, "kN")),
        (564e3, "N m", Unit(1e3, "kN m")),
        (2500.0, "N/m", Unit(1.0, "N/m")),
        (3e-20, "J", Unit(1e-12, "pJ")),
        (-0.002, "J", Unit(1e-3, "mJ")),
    ],
)
def test_units_suit_the_largest_value(largest: float, base: str, unit: Unit) -> None:
    assert numbers.unit_for(largest, base) == unit


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (5.0, "5"),
        (1.25, "1.25"),
        (-0.5, "−0.5"),
        (2e7, "20\u202f000\u202f000"),
        (1e-12, "10⁻¹²"),
        (3e12, "3\u00a0·\u00a010¹²"),
    ],
)
def test_plain(value: float, text: str) -> None:
    assert numbers.format_input(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0007127, "0.713\u00a0mm"), (0.0478586, "47.9\u00a0mm"), (1.5, "1.50\u00a0m"), (2e-6, "2.00\u00a0µm")],
)
def test_length(value: float, text: str) -> None:
    assert numbers.format_length(value) == text


@pytest.mark.parametrize(("largest", "step"), [(10.4, 10.0), (9.99, 5.0), (0.02, 0.02), (0.5, 0.5), (0.3, 0.2)])
def test_round_number_is_not_above(largest: float, step: float) -> None:
    assert numbers.round_number(largest) == pytest.approx(step, rel=1e-12)


@pytest.mark.parametrize(
    ("kappa", "text"),
    [
        (0.999986, "κ(20) = 0.999986"),
        (1.0 - 2e-9, "1 − κ(20) = 2.0\u00a0·\u00a010⁻⁹"),
        (1.0, "1 − κ(20) < 10⁻¹⁵"),
    ],
)
def test_share_captured(kappa: float, text: str) -> None:
    assert numbers.share_captured(kappa, 20) == text


@pytest.mark.parametrize(("true", "said"), [(1e-3, "1.25 times the true error"), (4e-9, ""), (0.0, ""), (None, "")])
def test_an_estimate_is_compared_with_an_error_above_round_off_only(true: float | None, said: str) -> None:
    assert numbers.times_the_true_error(1.25e-3, true) == said


def test_a_share_that_is_round_off_has_no_digits() -> None:
    assert numbers.format_percent(6.71e-12) == f"less than 10⁻⁶{SPACE}%"
    assert (
        numbers.format_percent(0.0) == f"0{SPACE}%"
        and numbers.format_percent(1.2e-8) == f"1.20{SPACE}·{SPACE}10⁻⁶{SPACE}%"
    )
