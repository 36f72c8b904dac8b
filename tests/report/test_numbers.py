from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from pmr import RunResult
from pmr.report import numbers
from pmr.report.blocks import (
    BETTER,
    DIFFERENT,
    RANKED,
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
from pmr.report.numbers import SPACE, Unit, format_input, format_quantity, format_time


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


@pytest.mark.parametrize(
    ("here", "published", "mark"),
    [
        (0.01, 0.01, WITHIN),
        (0.0105, 0.01, WITHIN),  # both ends count as within
        (0.0095, 0.01, WITHIN),
        (0.00021, 0.0002, WITHIN),
        (0.0105001, 0.01, WORSE),
        (0.0094999, 0.01, BETTER),
        (0.0, 0.01, BETTER),
        (0.0, 0.0, WITHIN),
        (1e-9, 0.0, WORSE),
        (math.nextafter(0.0105, 1.0), 0.01, WITHIN),  # rounding decides nothing
    ],
)
def test_marks_of_errors(here: float, published: float, mark: Mark) -> None:
    assert mark_for(here, published) is mark


@pytest.mark.parametrize(("here", "mark"), [(0.105, WITHIN), (0.106, DIFFERENT), (0.094, DIFFERENT)])
def test_a_displacement_is_neither_better_nor_worse(here: float, mark: Mark) -> None:
    assert mark_for(here, 0.1, is_error=False) is mark


def test_marks_differ_in_symbol_word_and_class() -> None:
    marks = (WITHIN, SAME, BETTER, WORSE, DIFFERENT)
    assert len({mark.symbol for mark in marks}) == len({mark.text for mark in marks}) == len(marks)
    assert len({mark.kind for mark in marks}) == 4  # what rounds to the published figure is coloured as within


def test_rows_stand_in_the_order_of_interest(whole: RunResult) -> None:
    assert [row.comparison for row in rows(whole)][::2] == [
        "reduced against full",
        "reduced against ANCF",
        "full against ANCF",
        "largest transverse displacement",
    ]


def test_only_published_figures_are_marked(whole: RunResult) -> None:
    table = {(row.comparison, row.place): row for row in rows(whole)}
    unpublished = table["reduced against ANCF", "tip"]
    assert (unpublished.published, unpublished.deviation, unpublished.mark) == (None, None, None)
    marks = [row.mark for row in rows(whole)]
    assert [marks.count(mark) for mark in (WITHIN, SAME, BETTER, WORSE)] == [2, 1, 1, 1]


def test_published_figures_keep_the_decimals_of_their_publication(whole: RunResult) -> None:
    printed = [row.published for row in rows(whole) if row.published and "%" in row.published]
    assert printed == ["1.00\u00a0%", "2.00\u00a0%", "0.07\u00a0%"]


def test_a_figure_that_rounds_to_the_published_one_is_explained(whole: RunResult) -> None:
    first, *others = error_notes(whole, rows(whole))
    assert first.startswith(
        "full against ANCF, tip: the published 0.07\u00a0% is a rounded figure; 0.0740\u00a0% rounds"
    )
    assert others == ["The published value rests on another step size."]


def test_an_unexplained_difference_is_said_to_be_so(make_result) -> None:
    published = {"source": "a paper", "errors": {"reduced_vs_full": {"tip": 0.02}}}
    summary = {"errors": {"reduced_vs_full": {"tip": 0.01}}}
    result = make_result(published=published, summary=summary)
    assert error_notes(result, rows(result)) == ["No reason is recorded with this result."]
    close = make_result(published=published, summary={"errors": {"reduced_vs_full": {"tip": 0.0201}}})
    assert error_notes(close, rows(close)) == [] and deviating_rows(rows(close)) == []


def test_a_run_without_reference_has_no_error_to_show(make_result) -> None:
    result = make_result(responses=("reduced",), summary={"errors": {}, "max_displacement": 0.05, "max_error": None})
    assert [row.comparison for row in rows(result)] == ["largest transverse displacement"]


def test_columns_that_all_lines_leave_empty_are_left_out() -> None:
    full = Row("a", "b", "1", "2", "+3", WITHIN, "4 m")
    words = replace(full, deviation=None, mark=None, absolute=None)
    for lines, heads in (([words, full], ["here", "norm", "published", "deviation"]), ([words], ["here", "published"])):
        block = Block("Errors", errors=ErrorTable("", lines))
        page = render_runs([Chapter(anchor="case-1", title="Case", blocks=[block])])
        assert re.findall(r'<th scope="col" class="number[^"]*">([^<]*)</th>', page) == heads


def test_marks_stand_in_the_order_of_their_worth() -> None:
    found = {mark: Row(mark.kind, "", "", "1", mark=mark) for mark in RANKED}
    table = ErrorTable("", [found[mark] for mark in sorted(RANKED, key=lambda mark: mark.symbol)])
    words = [mark.text for mark in table.marks]
    assert words == ["better", "same when rounded", "within 5\u00a0%", "different", "worse"]


def test_times_volumes_and_large_inputs_have_no_more_digits_than_they_need() -> None:
    assert (format_time(0.0042), format_time(0.9996), format_time(22.6241)) == (
        "0.004\u00a0s",
        "1\u00a0s",
        "22.62\u00a0s",
    )
    assert format_quantity(1.25e-3, "m^3/s") == "75.0\u00a0l/min" and format_quantity(3.29e-3, "m^3") == "3.29\u00a0l"
    assert format_quantity(0.739, "kg") == "0.739\u00a0kg"
    assert format_input(1e9, "N") == "10⁹\u00a0N" and format_input(-2.5e11) == "−2.5\u00a0·\u00a010¹¹"
    assert format_input(123456789.0) == "123\u202f456\u202f789"


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
