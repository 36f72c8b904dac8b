"""Building blocks of a page: text, markup and plain data, ready for the templates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pmr.report.numbers import MINUS, SPACE, significant

TOLERANCE = 0.05  # relative deviation up to which a value counts as within 5 % of the published one


@dataclass(frozen=True)
class Mark:
    """Verdict on a value compared with a published one.

    `kind` names its style, and `symbol` tells the verdict without colour.  `text` is the word for the verdict in the
    table, `explanation` is its text in the legend.
    """

    kind: str
    symbol: str
    text: str
    explanation: str


BETTER = Mark("better", "▲", "better", "better, the error is smaller")
SAME = Mark("within", "=", "same when rounded", "same when rounded as published")
WITHIN = Mark("within", "≈", f"within 5{SPACE}%", f"within 5{SPACE}% of the published figure")
DIFFERENT = Mark("different", "≠", "different", "different, neither better nor worse")
WORSE = Mark("worse", "▼", "worse", "worse, the error is larger")
RANKED = (BETTER, SAME, WITHIN, DIFFERENT, WORSE)  # from the best to the worst


@dataclass(frozen=True)
class Row:
    """Row of the error table, as text: an error or another value of this run, with the published value.

    `comparison` says which models are compared, `place` names the quantity, and `value` is this run's value.
    `deviation` is the relative deviation of the value from the published one, and `mark` is the verdict on the
    deviation.  `difference` is the largest difference of the models with its unit.  An entry is None if its column does
    not apply to the row.
    """

    comparison: str
    place: str
    value: str
    published: str | None = None
    deviation: str | None = None
    mark: Mark | None = None
    difference: str | None = None


def deviating_rows(table: Sequence[Row]) -> list[Row]:
    """Rows of an error table whose value differs from the published one by more than 5 %.

    A row is included even if its value rounds to the published one (`SAME`).
    """
    return [row for row in table if row.mark not in (None, WITHIN)]


@dataclass(frozen=True)
class ErrorTable:
    """Error table: rows, the caption above them and the sentences below them.

    A column that is empty in all rows is not shown.
    """

    caption: str
    rows: Sequence[Row]
    reasons: Sequence[str] = ()  # sentences below the table

    @property
    def marks(self) -> list[Mark]:
        """Verdicts that occur in the table, in the order from the best to the worst."""
        return [mark for mark in RANKED if any(row.mark is mark for row in self.rows)]


def mark_for(value: float, published: float, is_error: bool = True) -> Mark:
    """Return the verdict on a value compared with the published one: `WITHIN`, `BETTER`, `WORSE` or `DIFFERENT`.

    A deviation of exactly 5 % still counts as within 5 %.  If `is_error`, a smaller value is better.  Any other value,
    such as a displacement, can be neither better nor worse than the published one.  `SAME` is never returned, as it
    depends on the digits of the published value, which this function does not know.
    """
    deviation = _deviation(value, published)
    if abs(deviation) <= TOLERANCE * (1.0 + 1e-9):
        return WITHIN
    if not is_error:
        return DIFFERENT
    return BETTER if deviation < 0.0 else WORSE


def _deviation(value: float, published: float) -> float:
    """Relative deviation (value - published) / published.

    If `published` is 0, the deviation is 0 for a value of 0, and infinite for any other value.
    """
    if published == 0.0:
        return 0.0 if value == 0.0 else float("inf")
    return (value - published) / published


def signed_deviation(value: float, published: float) -> str:
    """Format the relative deviation from the published value in per cent with its sign; a dash if it is infinite."""
    deviation = _deviation(value, published)
    if abs(deviation) == float("inf"):
        return "–"
    return f"{MINUS if deviation < 0.0 else '+'}{significant(100.0 * abs(deviation), 2)}{SPACE}%"


#: Comments around the parts of a drawing that are shown only under a pointer; these parts are cut out for the PDF.
SCREEN, END_OF_SCREEN = "<!--screen-->", "<!--end of screen-->"

#: Names of the files of a report: the page and the PDF.
REPORT_FILES = ("report.html", "report.pdf")


@dataclass(frozen=True)
class ReportFiles:
    """Paths of the two files of a report."""

    html: Path
    pdf: Path


@dataclass(frozen=True)
class KeyNumber:
    """A number that sums up a run, as text, with a label and a note, for instance the value to compare it with."""

    value: str
    label: str
    note: str = ""


@dataclass(frozen=True)
class Table:
    """Table of rows (name, text) with a title.

    `bars` maps names of rows to the lengths of their bars, as shares of the full length; the full length is divided
    into `marks` equal parts.  `headings` maps the names of some rows to a small heading above the row.
    """

    title: str
    rows: tuple[tuple[str, str], ...]
    bars: Mapping[str, float] = field(default_factory=dict)
    marks: int = 1
    note: str = ""  # sentence below the table; empty for none
    headings: Mapping[str, str] = field(default_factory=dict)


#: Longest entry of a column of numbers, which may have units and the time and place where they occur.
LONGEST_NUMBER = 48


@dataclass(frozen=True)
class Grid:
    """Table with column headings; the first column names the subject of each row."""

    caption: str
    head: tuple[str, ...]  # (c,): headings of the columns
    rows: tuple[tuple[str, ...], ...]  # texts of c cells each
    narrow: Literal["scrolls", "blocks", "small"] = "scrolls"  # in a narrow window; each row may be a block of lines

    @property
    def alignments(self) -> list[str]:
        """Style class (c,) of the columns: ``"number"``, or ``"text"`` if an entry is longer than `LONGEST_NUMBER`."""
        columns = zip(self.head, *self.rows, strict=True)
        return ["text" if max(map(len, column)) > LONGEST_NUMBER else "number" for column in columns]


@dataclass(frozen=True)
class Drawing:
    """Vector figure of a page: its identifier, its ``<svg>`` element and the caption below it."""

    name: str
    svg: str
    caption: str
    half: bool = False  # whether the figure is half as wide as a page
    hint: str = ""  # sentence behind the caption that a screen shows, for the pointer
    fits: bool = False  # whether a second ``<svg>`` element follows, which a narrow window shows in place of the first


@dataclass(frozen=True)
class Picture:
    """Raster picture of a page: its identifier, its size in px, the PNG in base64 and the caption below it."""

    name: str
    width: int
    height: int
    data: str
    caption: str


@dataclass(frozen=True)
class Player:
    """Animation of a page: `data` is the input of the script that plays it, ready for JSON."""

    data: dict[str, Any]
    caption: str


@dataclass(frozen=True)
class Block:
    """Content below one heading: text, errors, animation, drawings, pictures, grids and tables, in this order.

    If `grids_first` is true, grids stand before the drawings: their rows fill the end of a page on which no drawing has
    room.  Two drawings of half a page's width stand side by side.  `software` lists names with versions.

    `columns` is the number of columns in which the `tables` stand on paper.  If it is 1, a table is as wide as the
    page, also on a screen.
    """

    heading: str
    drawings: Sequence[Drawing] = ()
    text: str = ""
    grids: tuple[Grid, ...] = ()
    errors: ErrorTable | None = None
    player: Player | None = None
    pictures: tuple[Picture, ...] = ()
    tables: Sequence[Table] = ()
    columns: int = 3
    software: Sequence[str] = ()
    grids_first: bool = False


@dataclass(frozen=True)
class Verdict:
    """Sentences on limits, the first thing on a page; `is_exceeded` says whether a value is above its limit.

    `notes` are sentences in small type below the text, on what has no limit or is not checked.
    """

    text: str = ""
    notes: Sequence[str] = ()
    is_exceeded: bool = False


@dataclass(frozen=True)
class Notices:
    """Notices that stand before the results of a chapter.

    `verdict` is on limits, `warnings` are what a user has to know before sizing a machine by the results, and
    `unfinished` are names of runs without a result.
    """

    verdict: Verdict = Verdict()
    warnings: Sequence[str] = ()
    unfinished: Sequence[str] = ()


@dataclass(frozen=True, kw_only=True)
class Chapter:
    """A run or a study as a chapter of a page.

    Attributes
    ----------
    headline : str
        One sentence, for the table of contents and below the key numbers.
    opening : str
        Text at the top of the chapter that describes the system.  `sketch` shows the system, and the short tables
        `first` hold the main results.
    """

    anchor: str  # identifier, with which all identifiers in the chapter begin
    title: str
    headline: str = ""
    opening: str = ""
    key_numbers: Sequence[KeyNumber] = ()
    sketch: Drawing | None = None
    first: Sequence[Table] = ()
    paragraphs: Sequence[str] = ()
    notices: Notices = Notices()
    blocks: Sequence[Block] = ()
