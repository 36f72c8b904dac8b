"""Report of a study or a collection, from the files that `pmr study` left in a folder: HTML, and the same page as PDF.

No new values are computed.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pmr.files.arrays import Summary
from pmr.report import scene_tables
from pmr.report.blocks import Block, Chapter, Grid, Notices, Table
from pmr.report.document import ReportFiles, render, with_date, write_page
from pmr.report.numbers import format_quantity
from pmr.report.studies import chart, runs
from pmr.report.studies.finished import FinishedStudy, comparison, studies_in
from pmr.report.studies.tables import run_name

#: Functions that build the chapter about a study, by the kind of study; studies of other kinds have a chapter about
#: their runs.
CHAPTERS = {"chart": chart.build_chapter}


def write_report(folder: Path) -> ReportFiles:
    """Write report.html and report.pdf of a study or a collection into its folder, and return their paths."""
    return write_page(render_studies(folder), folder)


def render_studies(folder: Path) -> str:
    """Render the report of the study or collection in `folder` as HTML.

    The page holds its figures, fonts and styles, and loads nothing from outside.  Equal results give equal pages, byte
    by byte.
    """
    summary = json.loads((folder / "summary.json").read_text())
    studies = studies_in(folder, summary)
    chapters = [study_chapter(study, f"study-{number}") for number, study in enumerate(studies, start=1)]
    chapters.append(_provenance_chapter(summary, studies))
    return render(
        "study_report.html", str(summary["title"]), chapters, kind=with_date("Study report", [summary]), introduction=()
    )


def _provenance_chapter(summary: Summary, studies: Sequence[FinishedStudy]) -> Chapter:
    """Build the chapter with the number and time of all runs of `studies`, the machine and the software."""
    effort = []
    for study in studies:
        seconds = sum(run.seconds.get("task", 0.0) for run in study.results.runs)
        effort.append((study.title, str(len(study.results.runs)), format_quantity(seconds, "s")))
    caption = "Runs, and the time that all workers together spent in them."
    machine = Table("Machine", tuple(scene_tables.origin_rows(summary)))
    blocks = (
        Block("Effort", grids=(Grid(caption, ("study", "runs", "time"), tuple(effort)),)),
        Block("Machine and software", tables=[machine], software=scene_tables.software_versions(summary)),
    )
    return Chapter(anchor="provenance", title="Provenance", blocks=blocks)


def study_chapter(study: FinishedStudy, anchor: str) -> Chapter:
    """Build the chapter about a study; if a run has no result yet, the chapter is about the runs that have one.

    `anchor` begins all identifiers in the chapter.
    """
    build = CHAPTERS.get(study.kind, runs.build_chapter)
    content = (runs.build_chapter if study.unfinished_runs else build)(study, anchor)
    published = comparison(study)
    if published.rows and not any(block.errors for block in content.blocks):
        content = replace(content, blocks=[*content.blocks, Block("Beside the publication", errors=published)])
    unfinished = [f"{run_name(run)} ({run.status}: {run.reason})" for run in study.unfinished_runs]
    warnings = [warning.line(len(study.results.runs)) for warning in study.results.warnings]
    return replace(content, notices=Notices((), [*study.summary.get("hints", ()), *warnings], unfinished))
