"""Figures beside published ones: how far apart they are, and a mark that says so without colour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pmr.report.numbers import MINUS, SPACE, significant

TOLERANCE = 0.05  # relative deviation up to which two figures count as the same


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
        return bool(deviating_rows(self.rows))


def mark_for(value: float, published: float, is_error: bool = True) -> Mark:
    """The verdict on a figure beside the published one.

    Both ends of the 5 % count as within.  An error is better when it is smaller; a displacement is neither better
    nor worse.
    """
    deviation = _deviation(value, published)
    if abs(deviation) <= TOLERANCE * (1.0 + 1e-9):
        return WITHIN
    if not is_error:
        return DIFFERENT
    return BETTER if deviation < 0.0 else WORSE


def verdicts(table: Sequence[Row]) -> dict[str, int]:
    """How many rows carry which mark, the best first, without those that none was published for."""
    marks = [row.mark for row in table if row.mark]
    return {mark.text: marks.count(mark) for mark in RANKED if mark in marks}


def deviating_rows(table: Sequence[Row]) -> list[Row]:
    """Rows that differ from the published figure by more than 5 %."""
    return [row for row in table if row.mark not in (None, WITHIN)]


def _deviation(value: float, published: float) -> float:
    """Relative deviation; any figure is infinitely far from a published zero, but for zero itself."""
    if published == 0.0:
        return 0.0 if value == 0.0 else float("inf")
    return (value - published) / published


def signed_deviation(value: float, published: float) -> str:
    """Relative deviation from the published figure, with its sign, in per cent."""
    deviation = _deviation(value, published)
    if abs(deviation) == float("inf"):
        return "–"
    return f"{MINUS if deviation < 0.0 else '+'}{significant(100.0 * abs(deviation), 2)}{SPACE}%"
