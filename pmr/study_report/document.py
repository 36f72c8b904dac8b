"""The report of studies: one self-contained HTML page and the same as PDF."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2

from pmr.report.document import ReportFiles
from pmr.report.figures.vector import FONT, words
from pmr.report.fonts import embedded
from pmr.report.numbers import SPACE, quantity
from pmr.report.provenance import Table
from pmr.study_report.content import Grid
from pmr.study_report.finished import FinishedStudy, studies_in
from pmr.study_report.page import Section, section

_log = logging.getLogger(__name__)


def write_report(folder: Path) -> ReportFiles:
    """Write report.html and report.pdf of what `pmr study` left in `folder`, into it."""
    import weasyprint  # takes a second to load, which only those who write a PDF should wait for

    files = ReportFiles(folder / "report.html", folder / "report.pdf")
    text = page(folder)
    files.html.write_text(text, encoding="utf-8")
    weasyprint.HTML(string=text).write_pdf(files.pdf)
    _log.info("report written to %s", folder)
    return files


def page(folder: Path) -> str:
    """The report as HTML: it holds its figures, fonts and styles, and asks for nothing from outside.

    The same results give the same page, byte by byte.
    """
    summary, studies = studies_in(folder)
    parts = [section(study, f"study-{number}") for number, study in enumerate(studies, start=1)]
    return render(str(summary["title"]), parts, summary, studies)


def render(
    title: str, sections: Sequence[Section], summary: Mapping[str, Any], studies: Sequence[FinishedStudy]
) -> str:
    """The page as HTML."""
    environment = jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader("pmr.study_report"), jinja2.PackageLoader("pmr.report")]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    drawings = (d for s in sections for block in s.content.blocks for row in block.rows for d in row)
    text = "".join(words(drawing.svg) for drawing in drawings)
    return environment.get_template("study_report.html").render(
        title=title,
        sections=sections,
        font=embedded(FONT, "".join(sorted(set(text)))),
        machine=_machine(summary),
        effort=_effort(studies),
        software=[f"{name}{SPACE}{version}" for name, version in summary["versions"].items()],
    )


def _machine(summary: Mapping[str, Any]) -> Table:
    rows = [(name, str(value)) for name, value in summary["machine"].items()]
    if summary["commit"]:
        rows.append(("commit", str(summary["commit"])))
    return Table("Machine", tuple(rows))


def _effort(studies: Sequence[FinishedStudy]) -> Grid:
    rows = []
    for study in studies:
        seconds = sum(run.seconds.get("task", 0.0) for run in study.results.runs)
        rows.append((study.title, str(len(study.results.runs)), quantity(seconds, "s")))
    return Grid("Runs, and the time that all workers together spent in them.", ("study", "runs", "time"), tuple(rows))
