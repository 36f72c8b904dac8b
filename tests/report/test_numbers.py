"""Numbers of a report with their units, marks beside published figures, and samples that a figure draws."""

import math
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pmr import RunResult
from pmr.report import numbers
from pmr.report.blocks import (
    BETTER,
    DIFFERENT,
    SAME,
    WITHIN,
    WORSE,
    Block,
    Chapter,
    ErrorTable,
    Mark,
    Row,
    deviating_rows,
    mark_for,
)
from pmr.report.columns import extreme_indices, interpolate, spread_indices
from pmr.report.document import render_runs
from pmr.report.errors import error_notes, rows
from pmr.report.numbers import SPACE, Unit
from pmr.report.studies import _comparison_row, format_figure
from pmr.studies.study import Statement

#: How a function writes numbers: arguments, and text with spaces in place of those that do not break.
WRITTEN: dict[Callable[..., str], list[tuple[tuple, str]]] = {
    numbers.significant: [
        ((0.0, 3), "0"), ((0.7127, 3), "0.713"), ((0.9999, 3), "1.00"), ((47.8586, 4), "47.86"), ((-12.0, 2), "−12"),
        ((153.0, 2), "150"), ((153e3, 3), "153000"), ((1.234e-7, 2), "1.2 · 10⁻⁷"), ((2.5e9, 2), "2.5 · 10⁹"),
        ((math.nan, 3), "not finite"),
    ],
    numbers.format_input: [
        ((5.0,), "5"), ((1.25,), "1.25"), ((-0.5,), "−0.5"), ((2e7,), "20\u202f000\u202f000"), ((1e-12,), "10⁻¹²"),
        ((3e12,), "3 · 10¹²"), ((1e9, "N"), "10⁹ N"), ((-2.5e11,), "−2.5 · 10¹¹"),
        ((123456789.0,), "123\u202f456\u202f789"),
    ],
    numbers.format_length: [
        ((0.0007127,), "0.713 mm"), ((0.0478586,), "47.9 mm"), ((1.5,), "1.50 m"), ((2e-6,), "2.00 µm"),
    ],
    numbers.share_captured: [
        ((0.999986, 20), "κ(20) = 0.999986"), ((1.0 - 2e-9, 20), "1 − κ(20) = 2.0 · 10⁻⁹"),
        ((1.0, 20), "1 − κ(20) < 10⁻¹⁵"),
    ],
    numbers.times_the_true_error: [
        ((1.25e-3, 1e-3), "1.25 times the true error"), ((1.25e-3, 4e-9), ""), ((1.25e-3, 0.0), ""),
        ((1.25e-3, None), ""),
    ],
    numbers.format_percent: [((6.71e-12,), "less than 10⁻⁶ %"), ((0.0,), "0 %"), ((1.2e-8,), "1.20 · 10⁻⁶ %")],
    numbers.format_time: [((0.0042,), "0.004 s"), ((0.9996,), "1 s"), ((22.6241,), "22.62 s")],
    numbers.format_quantity: [
        ((1.25e-3, "m^3/s"), "75.0 l/min"), ((3.29e-3, "m^3"), "3.29 l"), ((0.739, "kg"), "0.739 kg"),
    ],
    format_figure: [
        ((0.00732, "share"), "0.732 %"), ((4.56e-4, "length"), "0.456 mm"), ((5320.0, "energy"), "5.32 kJ"),
        ((7.04, "ratio"), "7.0 ×"), ((26, "number"), "26"), (("5x6", "number"), "(5,6)"),
    ],
}  # fmt: skip


@pytest.mark.parametrize("write", WRITTEN, ids=lambda write: write.__name__)
def test_numbers_have_the_digits_and_units_that_suit_them(write: Callable[..., str]) -> None:
    for given, text in WRITTEN[write]:
        assert write(*given).replace(SPACE, " ") == text.replace(SPACE, " "), given


@pytest.mark.parametrize(
    ("largest", "base", "unit"),
    [
        (0.0, "m", Unit(1.0, "m")), (0.0478, "m", Unit(1e-3, "mm")), (2500.0, "m", Unit(1.0, "m")),
        (0.99999, "m", Unit(1.0, "m")),  # would print as 1000 mm
        (2500.0, "N", Unit(1e3, "kN")), (564e3, "N m", Unit(1e3, "kN m")), (2500.0, "N/m", Unit(1.0, "N/m")),
        (3e-20, "J", Unit(1e-12, "pJ")), (-0.002, "J", Unit(1e-3, "mJ")),
    ],
)  # fmt: skip
def test_units_suit_the_largest_value(largest: float, base: str, unit: Unit) -> None:
    assert numbers.unit_for(largest, base) == unit


@pytest.mark.parametrize(
    ("base", "label"),
    [("N", "Value in kN"), ("%", "Value in %"), ("1", "Value (–)"), ("–", "Value (–)"), ("", "Value (–)")],
)
def test_the_label_of_an_axis_has_a_unit_or_a_dash(base: str, label: str) -> None:
    assert numbers.unit_for(2500.0, base).axis_label("Value") == label


@pytest.mark.parametrize(("largest", "step"), [(10.4, 10.0), (9.99, 5.0), (0.02, 0.02), (0.5, 0.5), (0.3, 0.2)])
def test_round_number_is_not_above(largest: float, step: float) -> None:
    assert numbers.round_number(largest) == pytest.approx(step, rel=1e-12)


@pytest.mark.parametrize(
    ("here", "published", "mark"),
    [
        (0.01, 0.01, WITHIN), (0.0105, 0.01, WITHIN), (0.0095, 0.01, WITHIN), (0.00021, 0.0002, WITHIN),  # both ends
        (0.0105001, 0.01, WORSE), (0.0094999, 0.01, BETTER), (0.0, 0.01, BETTER), (0.0, 0.0, WITHIN),
        (1e-9, 0.0, WORSE), (math.nextafter(0.0105, 1.0), 0.01, WITHIN),  # rounding decides nothing
    ],
)  # fmt: skip
def test_marks_of_errors(here: float, published: float, mark: Mark) -> None:
    assert mark_for(here, published) is mark


@pytest.mark.parametrize(("here", "mark"), [(0.105, WITHIN), (0.106, DIFFERENT), (0.094, DIFFERENT)])
def test_a_displacement_is_neither_better_nor_worse(here: float, mark: Mark) -> None:
    assert mark_for(here, 0.1, is_error=False) is mark


@pytest.mark.parametrize(
    ("here", "given", "mark"),
    [
        (0.999986239, {"value": 0.999986}, SAME), (26, {"value": 26, "words": "maximum until 25"}, SAME),
        (0.0082, {"value": 0.008, "words": "approximately 0.8 %", "is_error": True}, WITHIN),
        (0.2, {"value": 0.16, "is_error": True}, WORSE), (0.1, {"value": 0.16, "is_error": True}, BETTER),
        (0.1, {"value": 0.16}, DIFFERENT), ("7x3", {"value": "5x6"}, DIFFERENT), ("5x6", {"value": "5x6"}, SAME),
        (0.1, {"words": "a plateau"}, None),
    ],
)  # fmt: skip
def test_marks_of_published_statements(here: float | str, given: dict[str, object], mark: Mark | None) -> None:
    row = _comparison_row(Statement.model_validate({"figure": "f", "text": "what"} | given), here)
    assert row.mark is mark and ("words" not in given or row.published == given["words"])


def test_only_published_figures_are_marked(whole: RunResult) -> None:
    table = {(row.comparison, row.place): row for row in rows(whole)}
    unpublished = table["reduced against ANCF", "tip"]
    assert (unpublished.published, unpublished.deviation, unpublished.mark) == (None, None, None)
    marks = [row.mark for row in rows(whole)]
    assert [marks.count(mark) for mark in (WITHIN, SAME, BETTER, WORSE)] == [2, 1, 1, 1]


def test_differences_to_published_figures_are_explained(make_result, whole: RunResult) -> None:
    first, *others = error_notes(whole, rows(whole))
    assert first.startswith(
        f"full against ANCF, tip: the published 0.07{SPACE}% is a rounded figure; 0.0740{SPACE}% rounds"
    )
    assert others == ["The published value rests on another step size."]
    published = {"source": "a paper", "errors": {"reduced_vs_full": {"tip": 0.02}}}
    result = make_result(published=published, summary={"errors": {"reduced_vs_full": {"tip": 0.01}}})
    assert error_notes(result, rows(result)) == ["No reason is recorded with this result."]
    close = make_result(published=published, summary={"errors": {"reduced_vs_full": {"tip": 0.0201}}})
    assert error_notes(close, rows(close)) == [] and deviating_rows(rows(close)) == []


def test_a_run_without_reference_has_no_error_to_show(make_result) -> None:
    result = make_result(responses=("reduced",), summary={"errors": {}, "max_displacement": 0.05, "max_error": None})
    assert [row.comparison for row in rows(result)] == ["largest transverse displacement"]


def test_columns_that_all_lines_leave_empty_are_left_out() -> None:
    full = Row("a", "b", "1", "2", "+3", WITHIN, "4 m")
    words = replace(full, deviation=None, mark=None, difference=None)
    for lines, heads in (([words, full], ["here", "published", "deviation"]), ([words], ["here", "published"])):
        block = Block("Errors", errors=ErrorTable("", lines))
        page = render_runs([Chapter(anchor="case-1", title="Case", blocks=[block])])
        assert re.findall(r'<th scope="col" class="number[^"]*">([^<]*)</th>', page) == heads
        assert ("1 (4 m)" in page) is ("In brackets" in page) is (full in lines)


def test_drawn_samples_keep_peaks_and_fast_oscillations() -> None:
    signal = np.zeros(15_001)
    signal[7_123], signal[7_124] = 1.0, -2.0
    assert {7_123, 7_124} <= set(extreme_indices(signal, 300))
    signal = np.sin(2.0 * np.pi * 97.3 * np.linspace(0.0, 15.0, 15_001))  # far more periods than intervals
    drawn = extreme_indices(signal, 300)
    assert len(drawn) <= 602 and np.all(np.diff(drawn) > 0) and (drawn[0], drawn[-1]) == (0, 15_000)
    for start in range(0, 15_000, 500):
        inside = signal[drawn[(drawn >= start) & (drawn < start + 500)]]
        assert inside.max() > 0.9 and inside.min() < -0.9
    for count in (1, 2, 50, 202):
        assert extreme_indices(np.zeros(count), 100).tolist() == list(range(count))


def test_spread_samples_have_both_ends_and_columns_are_interpolated() -> None:
    assert spread_indices(5, 10).tolist() == [0, 1, 2, 3, 4]
    spread = spread_indices(15_001, 1500)
    assert len(spread) == 1500 and (spread[0], spread[-1]) == (0, 15_000)
    times = np.array([0.0, 1.0, 2.0])
    values = np.stack([times, 10.0 * times], axis=1)
    assert interpolate(np.array([0.5, 1.5]), times, values).tolist() == [[0.5, 5.0], [1.5, 15.0]]
    assert interpolate(np.array([0.5]), times, values[:, 0]).tolist() == [0.5]
    assert interpolate(times.copy(), times, values) is values
