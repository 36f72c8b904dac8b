"""Errors beside published figures: how far apart they are, and a mark that says so without colour."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from typing import Any

from pmr.report.numbers import MINUS, SPACE, length, percent, quantity, significant
from pmr.results import RunResult
from pmr.scene import Published

TOLERANCE = 0.05  # relative deviation up to which two figures count as the same
NAMES = {"full": "full", "ancf": "ANCF", "reduced": "reduced"}
ORDER = ("reduced_vs_full", "reduced_vs_ancf", "full_vs_ancf")
PLACES = {"tip": "tip", "beam": "beam", "pad_force": "pad forces"}


@dataclass(frozen=True)
class Mark:
    """A verdict on a figure: `kind` names it for style sheets, `symbol` tells it without colour."""

    kind: str
    symbol: str
    text: str
    explained: str


BETTER = Mark("better", "▲", "better", "better, the error is smaller")
SAME = Mark("within", "=", "same when rounded", "same when rounded as published")
WITHIN = Mark("within", "≈", f"within 5{SPACE}%", f"within 5{SPACE}% of the published figure")
DIFFERENT = Mark("different", "≠", "different", "different, neither better nor worse")
WORSE = Mark("worse", "▼", "worse", "worse, the error is larger")
RANKED = (BETTER, SAME, WITHIN, DIFFERENT, WORSE)  # from the best to the worst


@dataclass(frozen=True)
class Row:
    """A line of the error table, as text; `mark` and `published` are absent where nothing was published."""

    comparison: str
    place: str
    here: str
    published: str | None = None
    deviation: str | None = None
    mark: Mark | None = None
    absolute: str | None = None


@dataclass(frozen=True)
class ErrorTable:
    """Lines, what they are of, and what has to be said about them; columns that all of them leave empty don't show."""

    caption: str
    rows: Sequence[Row]
    reasons: Sequence[str] = ()

    @property
    def published(self) -> bool:
        """Whether any figure is published."""
        return any(row.published for row in self.rows)

    @property
    def deviations(self) -> bool:
        """Whether any figure is so many per cent from a published one."""
        return any(row.deviation for row in self.rows)

    @property
    def norms(self) -> bool:
        """Whether any line has the norm of its difference."""
        return any(row.absolute for row in self.rows)

    @property
    def marks(self) -> list[Mark]:
        """Marks that occur, the best first."""
        return [mark for mark in RANKED if any(row.mark is mark for row in self.rows)]

    @property
    def apart(self) -> bool:
        """Whether any figure differs from the published one by more than 5 %."""
        return bool(apart(self.rows))


def mark_for(here: float, published: float, is_error: bool = True) -> Mark:
    """The verdict on a figure beside the published one.

    Both ends of the 5 % count as within.  An error is better when it is smaller; a displacement is neither better
    nor worse.
    """
    deviation = _deviation(here, published)
    if abs(deviation) <= TOLERANCE * (1.0 + 1e-9):
        return WITHIN
    if not is_error:
        return DIFFERENT
    return BETTER if deviation < 0.0 else WORSE


def error_table(result: RunResult) -> ErrorTable:
    """The error table of a run, with notes on it."""
    found, published = rows(result), result.scene.published
    forces = " and pad forces" if any(row.place == PLACES["pad_force"] for row in found) else ""
    source = f"; published: {published.source}" if published else ""
    return ErrorTable(
        f"Normalised RMS errors of transverse displacements{forces}, and largest values{source}.",
        found,
        reasons(result, found),
    )


def rows(result: RunResult) -> list[Row]:
    """Lines of the error table: normalised errors, then the largest displacement, difference and stress."""
    return [*_errors(result), *_missing(result), *_lengths(result), *_stresses(result)]


def verdicts(table: Sequence[Row]) -> dict[str, int]:
    """How many rows carry which mark, the best first, without those that none was published for."""
    marks = [row.mark for row in table if row.mark]
    return {mark.text: marks.count(mark) for mark in RANKED if mark in marks}


def apart(table: Sequence[Row]) -> list[Row]:
    """Rows that differ from the published figure by more than 5 %."""
    return [row for row in table if row.mark not in (None, WITHIN)]


def reasons(result: RunResult, table: Sequence[Row]) -> list[str]:
    """Why figures differ from the published ones by more than 5 %, and other notes of the run."""
    found = [
        f"{row.comparison}, {row.place}: the published {row.published} is a rounded figure; "
        f"{row.here} rounds to it, so the two agree as far as is known."
        for row in table
        if row.mark is SAME
    ]
    notes = [str(note) for note in result.summary.get("notes", ())]
    if not notes and len(apart(table)) > len(found):
        notes = [f"No reason {'for the other figures ' if found else ''}is recorded with this result."]
    return [*found, *notes]


def _errors(result: RunResult) -> Iterator[Row]:
    published = result.scene.published
    decimals = _decimals(published) if published else 0
    printed: Mapping[str, Any] = published.model_dump()["errors"] if published else {}
    errors: Mapping[str, Mapping[str, Any]] = result.summary.get("errors", {})
    for pair in (*(p for p in ORDER if p in errors), *(p for p in errors if p not in ORDER)):
        first, _, second = pair.partition("_vs_")
        comparison = f"{NAMES.get(first, first)} against {NAMES.get(second, second)}"
        for place, called in PLACES.items():
            if place not in errors[pair]:
                continue
            here = float(errors[pair][place])
            other = printed.get(pair, {}).get(place)
            row = Row(comparison, called, percent(here))
            if other is not None:
                row = _compared(comparison, called, here, other, decimals)
            absolute = result.summary.get("absolute_errors", {}).get(pair, {}).get(place)
            norm = None if absolute is None else _norm(place, float(absolute))
            yield replace(row, absolute=norm)


def _missing(result: RunResult) -> Iterator[Row]:
    """References that were asked for and can't be trusted; why, the run's warnings say."""
    for name in result.summary.get("no_reference", {}):
        yield Row(f"reduced against {NAMES.get(name, name)}", "", "no reference")


def _norm(place: str, value: float) -> str:
    """The norm of a difference with its unit: forces have one of their own."""
    return quantity(value, "N") if place == "pad_force" else length(value, 3)


def _stresses(result: RunResult) -> Iterator[Row]:
    largest: Mapping[str, float] = result.summary.get("max_von_mises", {})
    for name in ("reduced", "full"):
        if name in largest:
            yield Row("largest von Mises stress", NAMES[name], quantity(largest[name], "Pa", 4))
    if {"full", "reduced"} <= set(largest) and largest["full"] > 0.0:
        apart = signed_deviation(largest["reduced"], largest["full"])
        yield Row("largest von Mises stress", "reduced to full", apart)


def _compared(comparison: str, place: str, here: float, other: float, decimals: int) -> Row:
    """An error beside the published one, which is printed in per cent with so many decimals."""
    printed, deviation = f"{100.0 * other:.{decimals}f}{SPACE}%", signed_deviation(here, other)
    rounded = abs(here - other) <= 0.5 * 10.0 ** -(decimals + 2) * (1.0 + 1e-9)
    mark = mark_for(here, other)
    if rounded and mark is not WITHIN:
        mark = SAME
    return Row(comparison, place, percent(here), printed, deviation, mark)


def _lengths(result: RunResult) -> Iterator[Row]:
    published = result.scene.published
    for name, comparison, is_error in (
        ("max_displacement", "largest transverse displacement", False),
        ("max_error", "largest difference, reduced to full", True),
    ):
        here = result.summary.get(name)
        if here is None:
            continue
        other = getattr(published, name) if published else None
        if other is None:
            yield Row(comparison, "", length(here, 4))
            continue
        deviation = signed_deviation(here, other)
        mark = mark_for(here, other, is_error)
        yield Row(comparison, "", length(here, 4), length(other, _digits(other)), deviation, mark)


def _deviation(here: float, published: float) -> float:
    """Relative deviation; any figure is infinitely far from a published zero, but for zero itself."""
    if published == 0.0:
        return 0.0 if here == 0.0 else float("inf")
    return (here - published) / published


def signed_deviation(here: float, published: float) -> str:
    """Relative deviation from the published figure, with its sign, in per cent."""
    deviation = _deviation(here, published)
    if abs(deviation) == float("inf"):
        return "–"
    return f"{MINUS if deviation < 0.0 else '+'}{significant(100.0 * abs(deviation), 2)}{SPACE}%"


def _decimals(published: Published) -> int:
    """Decimals, in per cent, to which a publication states its errors: the most that any of them shows."""
    exponents = [
        Decimal(repr(value)).normalize().as_tuple().exponent
        for pair in published.errors.values()
        for value in pair.values()
    ]
    return max((max(-int(exponent) - 2, 0) for exponent in exponents), default=0)


def _digits(value: float) -> int:
    return len(Decimal(repr(value)).normalize().as_tuple().digits)
