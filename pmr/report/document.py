"""Write the report of runs: a self-contained HTML page, and the same page as PDF."""

from __future__ import annotations

import io
import logging
import re
from base64 import b64encode
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
import matplotlib as mpl
from fontTools import subset
from fontTools.ttLib import TTFont

from pmr.errors import escape_controls
from pmr.errors.environment import import_package
from pmr.files.whole import replacement_folder
from pmr.report.blocks import END_OF_SCREEN, REPORT_FILES, SCREEN, Chapter, Drawing, ReportFiles
from pmr.report.figures import FONT
from pmr.report.sections import chapter
from pmr.results import RunResult

KIND = "Simulation report"

_log = logging.getLogger(__name__)


def write_report(results: Sequence[RunResult], folder: Path, helper: Executor | None = None) -> ReportFiles:
    """Write report.html and report.pdf of one or several runs into `folder` and return their paths.

    The folder is created if it does not exist.  The page holds its figures, fonts, styles and scripts, and loads
    nothing from outside.  Equal results give equal pages, byte by byte.  A process of `helper`, if there is one, draws
    a part of the figures.

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
    chapters = [chapter(result, f"case-{number}", helper) for number, result in enumerate(results, start=1)]
    return write_page(render_runs(chapters, with_date(KIND, [result.summary for result in results])), folder)


def write_page(text: str, folder: Path) -> ReportFiles:
    """Write a page, given as the text of its HTML, into a folder as report.html and report.pdf; return their paths."""
    with replacement_folder(folder, REPORT_FILES) as new:
        (new / "report.html").write_text(text, encoding="utf-8")
        write_pdf(text, new / "report.pdf")
    _log.info("report written to %s", folder)
    return ReportFiles(*(folder / name for name in REPORT_FILES))


def with_date(kind: str, summaries: Sequence[Mapping[str, object]]) -> str:
    """Return `kind`, the name of a kind of report, with the date of the summaries or the range of their dates.

    If no summary has a date, `kind` is returned alone.
    """
    dates = sorted({str(summary["date"]) for summary in summaries if summary.get("date")})
    return f"{kind} · {' to '.join(dict.fromkeys([dates[0], dates[-1]]))}" if dates else kind


def render_runs(chapters: Sequence[Chapter], kind: str = KIND) -> str:
    """Render the report of runs, a chapter each, as HTML; `kind` is the kind of document, for its head.

    A single run gives the page its title; pages of several runs have a general title.
    """
    title = chapters[0].title if len(chapters) == 1 else "Reduced sliding structures"
    headings = list(dict.fromkeys(number.label for chapter in chapters for number in chapter.key_numbers))
    return render("report.html", title, chapters, kind=kind, headings=headings)


def render(template: str, title: str, chapters: Sequence[Chapter], **more: Any) -> str:
    """Return the HTML of a page: the file `template` in the folder templates, with the variables that it uses.

    The variables are `title`, `chapters`, the rule of the font, whether a block is animated, and those in `more`.
    """
    blocks = [block for chapter in chapters for block in chapter.blocks]
    drawn: list[Drawing | None] = [drawing for block in blocks for drawing in block.drawings]
    drawn += [chapter.sketch for chapter in chapters]
    text = "".join(drawn_text(drawing.svg) for drawing in drawn if drawing)
    return (
        templates()
        .get_template(template)
        .render(
            title=title,
            chapters=chapters,
            font=font_face_rule("".join(sorted(set(text)))),
            is_animated=any(block.player for block in blocks),
            **more,
        )
    )


@cache
def templates() -> jinja2.Environment:
    """Environment of all templates, always the same one; each template is compiled when it is first loaded.

    Plain text is escaped, and a template with a variable that it does not get raises jinja2's UndefinedError.
    """
    return jinja2.Environment(
        loader=jinja2.PackageLoader("pmr.report"),
        autoescape=True,
        finalize=escape_plain_text,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )


def escape_plain_text(value: object) -> object:
    """Replace control characters in plain text by visible escapes.

    Markup, and values of other types than text, are returned unchanged.
    """
    return escape_controls(value) if type(value) is str else value


def write_pdf(text: str, file: Path) -> None:
    """Write the page whose HTML is `text` as a PDF file, without scripts and what is only for screens.

    Raises an InputError if weasyprint can't be imported.
    """
    import_package("weasyprint").HTML(string=_without_screen(text)).write_pdf(file)


def _without_screen(text: str) -> str:
    """Remove from the HTML `text` of a page what only a screen shows, and its scripts; embed each figure as one image.

    Embedded figures halve the time that a PDF takes, as their elements are not matched with the page's styles.
    """

    def embed_figure(match: re.Match[str]) -> str:
        """Return what replaces the element in `match`: an embedded image for an ``<svg>`` element.

        A ``<style>`` element is returned with ``embed`` in place of ``svg``.
        """
        style, drawn = match.groups()
        if style is not None:
            return re.sub(r"\bsvg(?= \{)", "embed", style)
        image = f'<svg xmlns="http://www.w3.org/2000/svg"{drawn}'
        return f'<embed type="image/svg+xml" src="data:image/svg+xml;base64,{b64encode(image.encode()).decode()}">'

    text = re.sub(rf"{SCREEN}.*?{END_OF_SCREEN}|<script\b.*?</script>", "", text, flags=re.DOTALL)
    return re.sub(r"(<style\b.*?</style>)|<svg\b(.*?</svg>)", embed_figure, text, flags=re.DOTALL)


def drawn_text(drawn: str) -> str:
    """All text in the SVG `drawn`; the embedded font is reduced to the characters of this text."""
    return "".join(re.findall(r">([^<]+)<", drawn))


def font_face_rule(characters: str) -> str:
    """CSS rule ``@font-face`` with the font DejaVu Sans, reduced to `characters`, under the name `FONT`."""
    options = subset.Options(layout_features=[], hinting=False, notdef_outline=True)
    options.drop_tables += ["FFTM"]
    font = TTFont(Path(mpl.get_data_path(), "fonts", "ttf", "DejaVuSans.ttf"), recalcTimestamp=False)
    del font["GSUB"], font["GPOS"]  # slow to read: no ligatures are asked for, and "kern" has the same kerning
    subsetter = subset.Subsetter(options)
    subsetter.populate(text=characters + " ")
    subsetter.subset(font)
    buffer = io.BytesIO()
    font.flavor = "woff"
    font.save(buffer)
    data = b64encode(buffer.getvalue()).decode()
    return f'@font-face{{font-family:"{FONT}";src:url(data:font/woff;base64,{data}) format("woff")}}'
