"""What a page consists of: everything in it is text, markup or plain data, ready for the templates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

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


#: Around what a drawing shows at a pointer: paper has none, and goes without.
SCREEN, END_OF_SCREEN = "<!--screen-->", "<!--end of screen-->"

#: Names of all that a report consists of.
REPORT_FILES = ("report.html", "report.pdf")


@dataclass(frozen=True)
class ReportFiles:
    """The two files of a report."""

    html: Path
    pdf: Path

    @classmethod
    def within(cls, folder: Path) -> ReportFiles:
        """Files of a report in a folder."""
        return cls(*(folder / name for name in REPORT_FILES))


@dataclass(frozen=True)
class KeyNumber:
    """A key number, what it is, and what it is to be seen beside."""

    value: str
    label: str
    note: str = ""


@dataclass(frozen=True)
class Point:
    """Sentence or two about a topic."""

    topic: str
    text: str


@dataclass(frozen=True)
class Table:
    """A table of two columns with a title; some rows have a bar, which takes a share of as many `marks`."""

    title: str
    rows: tuple[tuple[str, str], ...]
    bars: Mapping[str, float] = field(default_factory=dict)
    marks: int = 1
    note: str = ""


@dataclass(frozen=True)
class Grid:
    """A table with a head; its first column says what a row is about."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Drawing:
    """A figure as it stands in the page: its identifier, an ``<svg>`` element and the sentence below it."""

    name: str
    svg: str
    caption: str
    half: bool = False  # of the width of a page


@dataclass(frozen=True)
class Picture:
    """A picture as it stands in the page: identifier, size in px, PNG in base64 and the sentence below it."""

    name: str
    width: int
    height: int
    data: str
    caption: str


@dataclass(frozen=True)
class Player:
    """A motion to be played: its `kind` names the script, `data` is what that needs, ready for JSON."""

    kind: str
    data: dict[str, Any]
    caption: str


@dataclass(frozen=True)
class Block:
    """Content below a heading: text, errors, a player, pictures, drawings, tables, in this order.

    Each of `rows` holds one drawing or two; `without_scripts` are those of pages on which nothing can be played.
    """

    heading: str
    rows: tuple[tuple[Drawing, ...], ...] = ()
    text: str = ""
    grids: tuple[Grid, ...] = ()
    errors: ErrorTable | None = None
    player: Player | None = None
    without_scripts: tuple[Drawing, ...] = ()
    pictures: tuple[Picture, ...] = ()
    tables: Sequence[Table] = ()  # side by side
    software: Sequence[str] = ()
    page: bool = False  # whether it begins one on paper

    @property
    def drawings(self) -> tuple[Drawing, ...]:
        """Every drawing."""
        return (*self.without_scripts, *(drawing for row in self.rows for drawing in row))


@dataclass(frozen=True)
class Figures:
    """Drawings of a run: the sketch of its first page, and the blocks behind the text about its errors."""

    sketch: Drawing
    blocks: Sequence[Block]


@dataclass(frozen=True, kw_only=True)
class Chapter:
    """A run or a study.

    Attributes
    ----------
    headline : str
        One sentence, for the index and above the rest.
    opening : str
        What it is about, above the key numbers; `sketch` shows it, and `first` says in short tables what counts.
    points : sequence of Point
        What there is to say, topic by topic.
    warnings : sequence of str
        What whoever sizes a machine by these results has to know.
    unfinished : sequence of str
        Runs without a result.
    """

    anchor: str
    title: str
    headline: str = ""
    opening: str = ""
    key_numbers: Sequence[KeyNumber] = ()
    sketch: Drawing | None = None
    first: Sequence[Table] = ()
    points: Sequence[Point] = ()
    paragraphs: Sequence[str] = ()
    warnings: Sequence[str] = ()
    unfinished: Sequence[str] = ()
    blocks: Sequence[Block] = field(default=())
