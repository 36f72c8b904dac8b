"""The report of studies: one self-contained HTML page and the same as PDF."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2

from pmr.report.document import ReportFiles
from pmr.report.figures.vector import FONT, words
from pmr.report.fonts import embedded
from pmr.report.numbers import SPACE, quantity
from pmr.report.provenance import Table
from pmr.study_report.finished import FinishedStudy, studies_in
from pmr.study_report.page import Section, section

_log = logging.getLogger(__name__)


def write_report(folder: Path) -> ReportFiles:
    """Write report.html and report.pdf of what `pmr study` left in `folder`, into it.

    The page holds its figures, fonts and styles; it asks for nothing from outside.
    """
    import weasyprint  # takes a second to load, which only those who write a PDF should wait for

    summary, studies = studies_in(folder)
    parts = [section(study, f"study-{number}") for number, study in enumerate(studies, start=1)]
    page = render(str(summary["title"]), parts, summary, studies)
    files = ReportFiles(folder / "report.html", folder / "report.pdf")
    files.html.write_text(page, encoding="utf-8")
    weasyprint.HTML(string=page).write_pdf(files.pdf)
    _log.info("report of %d studies written to %s", len(parts), folder)
    return files


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
        provenance=[list(column) for column in _provenance(summary, studies)],
        software=[f"{name}{SPACE}{version}" for name, version in summary["versions"].items()],
    )


def _provenance(summary: Mapping[str, Any], studies: Sequence[FinishedStudy]) -> Iterator[Sequence[Table]]:
    machine = [(name, str(value)) for name, value in summary["machine"].items()]
    if summary["commit"]:
        machine.append(("commit", str(summary["commit"])))
    yield [Table("Machine", tuple(machine))]
    yield [Table("Runs", tuple((study.title, str(len(study.results.runs))) for study in studies))]
    effort = [(study.title, sum(run.seconds.get("task", 0.0) for run in study.results.runs)) for study in studies]
    yield [Table("Time in runs, all workers", tuple((title, quantity(seconds, "s")) for title, seconds in effort))]
