"""The report of studies: one self-contained HTML page and the same as PDF."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2

from pmr.environment import needed
from pmr.files.swap import fresh
from pmr.report.document import REPORT_FILES, ReportFiles, readable
from pmr.report.figures.vector import FONT, words
from pmr.report.fonts import embedded
from pmr.report.numbers import SPACE, quantity
from pmr.report.provenance import Table
from pmr.report.studies.content import Grid
from pmr.report.studies.finished import FinishedStudy, studies_in
from pmr.report.studies.page import Section, section

_log = logging.getLogger(__name__)


def write_report(folder: Path) -> ReportFiles:
    """Write report.html and report.pdf of what `pmr study` left in `folder`, into it."""
    text = page(folder)
    with fresh(folder, REPORT_FILES) as new:
        (new / "report.html").write_text(text, encoding="utf-8")
        needed("weasyprint").HTML(string=text).write_pdf(new / "report.pdf")  # takes a second to load
    _log.info("report written to %s", folder)
    return ReportFiles(folder / "report.html", folder / "report.pdf")


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
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader("pmr.report.studies"), jinja2.PackageLoader("pmr.report")]),
        autoescape=True,
        finalize=readable,
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
