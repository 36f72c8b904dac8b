"""The report: one self-contained HTML page and the same as PDF."""

from __future__ import annotations

import ctypes.util
import logging
import re
from base64 import b64encode
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import jinja2

from pmr.errors import InputError
from pmr.errors.environment import needed
from pmr.errors.text import visible
from pmr.files.whole import fresh
from pmr.report.blocks import END_OF_SCREEN, REPORT_FILES, SCREEN, Chapter, Figures, ReportFiles
from pmr.report.figures.canvas import FONT, font_face_rule, words
from pmr.report.sections import chapter, figures_of
from pmr.results import RunResult

KIND = "Simulation report"

_log = logging.getLogger(__name__)


def write_report(results: Sequence[RunResult], folder: Path, figures: Sequence[Figures] = ()) -> ReportFiles:
    """Write report.html and report.pdf for one or several runs into `folder`, which is made if need be.

    The page holds its figures, fonts, styles and scripts; it asks for nothing from outside.  The same results
    give the same page, byte by byte.  What `draw_figures` made of each of them needn't be drawn again.

    Raises
    ------
    ValueError
        If there is no result, or one without a response of the reduced model.
    """
    if not results:
        raise ValueError("a report needs at least one result")
    for result in results:
        if "reduced" not in result.responses:
            raise ValueError(f"{result.scene.title}: a report needs the response of the reduced model")
    figures = figures or [draw_figures(result, number) for number, result in enumerate(results, start=1)]
    pairs = zip(results, figures, strict=True)
    chapters = [
        chapter(result, _anchor(number), drawn_figures) for number, (result, drawn_figures) in enumerate(pairs, start=1)
    ]
    return write(page(chapters, with_date(KIND, [result.summary for result in results])), folder)


def draw_figures(result: RunResult, number: int) -> Figures:
    """Draw the figures of the result with a number in its report, from 1 on: they take longest."""
    return figures_of(result, _anchor(number))


def _anchor(number: int) -> str:
    return f"case-{number}"


def write(text: str, folder: Path) -> ReportFiles:
    """Write a page as both files."""
    with fresh(folder, REPORT_FILES) as new:
        (new / "report.html").write_text(text, encoding="utf-8")
        print_page(text, new / "report.pdf")
    _log.info("report written to %s", folder)
    return ReportFiles.within(folder)


def with_date(kind: str, summaries: Sequence[Mapping[str, Any]]) -> str:
    """A kind of report with the dates of what it is about, from the first to the last."""
    dates = sorted({str(summary["date"]) for summary in summaries if summary.get("date")})
    return f"{kind} · {' to '.join(dict.fromkeys([dates[0], dates[-1]]))}" if dates else kind


def page(chapters: Sequence[Chapter], kind: str = KIND) -> str:
    """The report of runs as HTML."""
    title = chapters[0].title if len(chapters) == 1 else "Reduced sliding structures"
    headings = list(dict.fromkeys(number.label for chapter in chapters for number in chapter.key_numbers))
    return render("report.html", title, chapters, kind=kind, headings=headings)


def render(template: str, title: str, chapters: Sequence[Chapter], **more: Any) -> str:
    """A page as HTML from one of the templates, which get what else is named."""
    blocks = [block for chapter in chapters for block in chapter.blocks]
    drawn = [drawing for block in blocks for drawing in block.drawings] + [
        chapter.sketch for chapter in chapters if chapter.sketch
    ]
    text = "".join(words(drawing.svg) for drawing in drawn)
    return (
        templates()
        .get_template(template)
        .render(
            title=title,
            chapters=chapters,
            font=font_face_rule(FONT, "".join(sorted(set(text)))),
            players=sorted({block.player.kind for block in blocks if block.player}),
            **more,
        )
    )


@cache
def templates() -> jinja2.Environment:
    """All templates, each of which is compiled when it is first asked for."""
    return jinja2.Environment(
        loader=jinja2.PackageLoader("pmr.report"),
        autoescape=True,
        finalize=readable,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )


def readable(value: Any) -> Any:
    """Text that is no markup of our own, with characters that would steer the page spelled out."""
    return visible(value) if type(value) is str else value


def print_page(text: str, file: Path) -> None:
    """Write a page of HTML as PDF."""
    weasyprint().HTML(string=_without_screen(text)).write_pdf(file)


def weasyprint() -> Any:
    """The package, which loads Pango and other libraries.

    It asks for each by several names.  Under those of other systems the compiler, the linker and the list of libraries
    would be asked too, in some fifty processes.  So they are asked only where no name is that of a file.
    """
    name, find = "weasyprint", ctypes.util.find_library

    def nowhere(name: str) -> str | None:
        return None

    ctypes.util.find_library = nowhere
    try:
        return needed(name)
    except InputError:
        ctypes.util.find_library = find
        return needed(name)
    finally:
        ctypes.util.find_library = find


def _without_screen(text: str) -> str:
    """The page without what only a screen shows or a script reads, and with figures as images that stand in it whole.

    As parts of the page each of their lines would be read, and given styles, by what was made for pages: half the time
    that a PDF takes.
    """

    def embed_figure(match: re.Match[str]) -> str:
        style, drawn = match.groups()
        if style is not None:
            return re.sub(r"\bsvg(?= \{)", "embed", style)
        image = f'<svg xmlns="http://www.w3.org/2000/svg"{drawn}'
        return f'<embed type="image/svg+xml" src="data:image/svg+xml;base64,{b64encode(image.encode()).decode()}">'

    text = re.sub(rf"{SCREEN}.*?{END_OF_SCREEN}|<script\b.*?</script>", "", text, flags=re.DOTALL)
    return re.sub(r"(<style\b.*?</style>)|<svg\b(.*?</svg>)", embed_figure, text, flags=re.DOTALL)
