from __future__ import annotations

import pytest

from pmr.report.blocks import BETTER, DIFFERENT, SAME, WITHIN, WORSE, Mark
from pmr.report.studies.finished import _comparison_row, format_combination, format_figure
from pmr.studies.study import Statement


@pytest.mark.parametrize(
    ("value", "kind", "text"),
    [
        (0.00732, "share", "0.732\u00a0%"),
        (4.56e-4, "length", "0.456\u00a0mm"),
        (5320.0, "energy", "5.32\u00a0kJ"),
        (7.04, "ratio", "7.0\u00a0×"),
        (26, "number", "26"),
        ("5x6", "number", "(5,6)"),
    ],
)
def test_figures_are_printed_as_their_quantity(value: float | str, kind: str, text: str) -> None:
    assert format_figure(value, kind) == text


def test_only_combinations_are_written_as_such() -> None:
    assert (
        format_combination("10x10") == "(10,10)"
        and format_combination("expected") == "expected"
        and format_combination("x") == "x"
    )


@pytest.mark.parametrize(
    ("here", "given", "mark"),
    [
        (0.999986239, {"value": 0.999986}, SAME),
        (26, {"value": 26, "words": "maximum until 25"}, SAME),
        (0.0082, {"value": 0.008, "words": "approximately 0.8 %", "is_error": True}, WITHIN),
        (0.2, {"value": 0.16, "is_error": True}, WORSE),
        (0.1, {"value": 0.16, "is_error": True}, BETTER),
        (0.1, {"value": 0.16}, DIFFERENT),
        ("7x3", {"value": "5x6"}, DIFFERENT),
        ("5x6", {"value": "5x6"}, SAME),
        (0.1, {"words": "a plateau"}, None),
    ],
)
def test_verdicts(here: float | str, given: dict[str, object], mark: Mark | None) -> None:
    row = _comparison_row(Statement.model_validate({"figure": "f", "text": "what"} | given), here)
    assert row.mark is mark


def test_words_go_before_numbers() -> None:
    assert _comparison_row(Statement(figure="f", text="what", value=0.5, words="half"), 0.5).published == "half"
    assert (
        _comparison_row(Statement(figure="f", text="what", value=0.5, quantity="share"), 0.5).published == "50.0\u00a0%"
    )
