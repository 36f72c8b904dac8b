"""What a page consists of: everything in it is text, markup or plain data, ready for the templates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pmr.report.marks import ErrorTable

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
    columns: Sequence[Sequence[Table]] = ()
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


def drawing(name: str, draw: Callable[..., Figure], caption: str, *arguments: Any) -> Drawing:
    """Draw a figure in the report's style; `name` is unique in the page."""
    from pmr.report.figures.canvas import HALF, style  # sentences are wanted where matplotlib is not
    from pmr.report.figures.vector import svg

    with style():
        figure = draw(*arguments)
        return Drawing(name, svg(figure, name, caption), caption, half=figure.get_figwidth() <= HALF)
