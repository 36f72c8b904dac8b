"""Expressions of a study file: arithmetic, and nothing else."""

from __future__ import annotations

import math

import pytest

from pmr.studies.further_limits import compile_expression

AT = {"load": 3.0, "force": {"fly tail top": -4.0, "ring": 2.0}}


def of(text: str) -> float:
    return compile_expression(text, ("load",), ("force",))(AT)


def test_arithmetic_is_that_of_python() -> None:
    assert of("2 * load ** 2 - 1 / 4") == 17.75
    assert of('max(abs(force["fly tail top"]), force["ring"], -load)') == 4.0
    assert of('hypot(load, force["fly tail top"]) + sqrt(4) + cos(0)') == 8.0
    assert of("-min(load, 1e-3) + sin(load)") == pytest.approx(math.sin(3.0) - 1e-3)


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')",
        "load.__class__",
        "(lambda: 1)()",
        "[load for load in force]",
        "force",
        'force["ring"].real',
        'open("file")',
        "load if load else 1",
        "load < 1",
        "True",
        "'text'",
        "abs()",
        "max(1, key=abs)",
        "other",
        "load +",
        "1\n2",
        "(" * 300 + "1" + ")" * 300,
        "-" * 999 + "1",
        "1 + " * 400 + "1",
        "load\0",
        "9" * 400,
        "load + 9e999",
        "-(" + "9" * 400 + ")",
    ],
)
def test_what_is_no_arithmetic_over_what_is_known_is_refused_in_one_line(text: str) -> None:
    with pytest.raises(ValueError, match=r".") as refused:
        of(text)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("text", ["9 ** 9 ** 9", "1 / 0", 'force["none"]', "(-1) ** 0.5"])
def test_what_has_no_value_fails_at_once(text: str) -> None:
    with pytest.raises((ArithmeticError, KeyError, ValueError)):
        of(text)
