"""The report: one self-contained HTML page and the same as PDF."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2

from pmr.environment import needed
from pmr.files.swap import fresh
from pmr.report import planar, space
from pmr.report.case import Case
from pmr.report.figures.vector import FONT, words
from pmr.report.fonts import embedded
from pmr.results import RunResult
from pmr.scene import StructureScene
from pmr.text import visible

#: Names of all that a report consists of.
REPORT_FILES = ("report.html", "report.pdf")

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class ReportFiles:
    """The two files of a report."""

    html: Path
    pdf: Path


def write_report(results: Sequence[RunResult], folder: Path) -> ReportFiles:
    """Write report.html and report.pdf for one or several runs into `folder`, which is made if need be.

    The page holds its figures, fonts, styles and scripts; it asks for nothing from outside.  The same results
    give the same page, byte by byte.

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
    return write([case(result, f"case-{number}") for number, result in enumerate(results, start=1)], folder)


def write(cases: Sequence[Case], folder: Path) -> ReportFiles:
    """Write both files from what the templates need."""
    page = render(cases)
    with fresh(folder, REPORT_FILES) as new:
        (new / "report.html").write_text(page, encoding="utf-8")
        needed("weasyprint").HTML(string=page).write_pdf(new / "report.pdf")  # takes a second to load
    _log.info("report of %d case(s) written to %s", len(cases), folder)
    return ReportFiles(folder / "report.html", folder / "report.pdf")


def case(result: RunResult, anchor: str) -> Case:
    """Everything that the report says about one run."""
    kind = space if isinstance(result.scene, StructureScene) else planar
    return kind.case(result, anchor)


def readable(value: Any) -> Any:
    """Text that is no markup of our own, with characters that would steer the page spelled out."""
    return visible(value) if type(value) is str else value


def render(cases: Sequence[Case]) -> str:
    """The page as HTML."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("pmr.report"),
        autoescape=True,
        finalize=readable,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    text = "".join(words(drawing.svg) for one in cases for drawing in one.drawings.values())
    title = cases[0].title if len(cases) == 1 else "Reduced sliding structures"
    font = embedded(FONT, "".join(sorted(set(text))))
    headings = list(dict.fromkeys(number.label for one in cases for number in one.key_numbers))
    return environment.get_template("report.html").render(title=title, cases=cases, headings=headings, font=font)
