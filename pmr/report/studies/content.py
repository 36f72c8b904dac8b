"""What a study says in a report: everything in it is text, markup or plain data."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

from matplotlib.figure import Figure

from pmr.report.figures import Drawing
from pmr.report.figures.canvas import style
from pmr.report.figures.vector import svg
from pmr.report.marks import Row
from pmr.report.provenance import Table
from pmr.report.sentences import KeyNumber


@dataclass(frozen=True)
class Grid:
    """A table with a head; its first column says what a row is about."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Block:
    """Figures below a heading, each row of one or two; then tables."""

    heading: str
    rows: tuple[tuple[Drawing, ...], ...] = ()
    text: str = ""
    grids: tuple[Grid, ...] = ()


@dataclass(frozen=True)
class Content:
    """What a study says.

    Attributes
    ----------
    headline : str
        One sentence, for the index.
    key_numbers : sequence of KeyNumber
    paragraphs : sequence of str
    blocks : sequence of Block
    rows, reasons
        The comparison with what is published, where the kind has one of its own; None takes the study's statements.
    parameters : sequence of columns of Table
    """

    headline: str
    key_numbers: Sequence[KeyNumber] = ()
    paragraphs: Sequence[str] = ()
    blocks: Sequence[Block] = ()
    rows: list[Row] | None = None
    reasons: list[str] | None = None
    parameters: Sequence[Sequence[Table]] = field(default=())


def drawing(name: str, draw: Callable[..., Figure], caption: str, *arguments: Any) -> Drawing:
    """Draw a figure in the report's style; `name` is unique in the page."""
    with style():
        return Drawing(name, svg(draw(*arguments), name, caption), caption)


def case_name(scene: str) -> str:
    """A scene's file as it is called in a sentence: ``paper_evolved`` is the evolved case."""
    name = scene.removeprefix("paper_").replace("_", " ")
    return f"{name} case" if scene.startswith("paper_") else name


def listed(words: Iterable[str]) -> str:
    """``a, b and c``."""
    *most, last = words
    return f"{', '.join(most)} and {last}" if most else last
