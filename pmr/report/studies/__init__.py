"""Report of a study or a collection, from the files that `pmr study` left in a folder: HTML, and the same page as PDF.

No new values are computed.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple, Protocol

from pmr.files.arrays import Summary
from pmr.report import scene_tables
from pmr.report.blocks import (
    DIFFERENT,
    SAME,
    Block,
    Chapter,
    ErrorTable,
    Grid,
    Mark,
    Notices,
    Row,
    Table,
    mark_for,
    signed_deviation,
)
from pmr.report.document import ReportFiles, render, with_date, write_page
from pmr.report.numbers import SPACE, decimals_of, format_in_unit, format_input, format_quantity, significant
from pmr.report.studies import chart, runs
from pmr.report.studies.tables import FinishedStudy, run_name
from pmr.studies.study import Statement
from pmr.studies.tasks import Scalar, cell_number

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
    studies = [FinishedStudy.load(folder / name) for name in summary.get("studies", ("",))]
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
    caption = "Number of runs, and the sum of their times."
    machine = Table("Machine", tuple(scene_tables.origin_rows(summary)))
    blocks = (
        Block("Effort", grids=(Grid(caption, ("study", "runs", "time"), tuple(effort)),)),
        Block("Machine and software", tables=[machine], software=scene_tables.software_versions(summary)),
    )
    return Chapter(anchor="provenance", title="Provenance", blocks=blocks)


def study_chapter(study: FinishedStudy, anchor: str) -> Chapter:
    """Build the chapter about a study; `anchor` begins all identifiers in it.

    While a run has no result yet, the chapter is that of a list of runs (`pmr.report.studies.runs.build_chapter`),
    whatever the kind of the study.  It shows the runs that have a result.  The table that compares the study with
    published statements comes last.  It is left out if another block has an error table.
    """
    build = CHAPTERS.get(study.kind, runs.build_chapter)
    content = (runs.build_chapter if study.unfinished_runs else build)(study, anchor)
    published = comparison(study)
    if published.rows and not any(block.errors for block in content.blocks):
        content = replace(content, blocks=[*content.blocks, Block("Beside the publication", errors=published)])
    count, by_reason = len(study.results.runs), dict[str, list[str]]()
    for run in study.unfinished_runs:
        by_reason.setdefault(f"{run.status}: {run.reason}", []).append(run_name(run))
    unfinished = [
        f"{names[0] if len(names) == 1 else f'{len(names)} of {count} runs'} ({reason})"
        for reason, names in by_reason.items()
    ]
    warnings = [warning.line(count) for warning in study.results.warnings]
    warnings = [*study.summary.get("hints", ()), *warnings]
    return replace(content, notices=Notices(content.notices.verdict, warnings, unfinished))


class HasPublishedValues(Protocol):
    """Values of a study or an experiment, and what is published about these values."""

    @property
    def figures(self) -> Mapping[str, Scalar]: ...
    @property
    def published(self) -> Sequence[Statement]: ...
    @property
    def summary(self) -> Summary: ...


def comparison(study: HasPublishedValues) -> ErrorTable:
    """Build the table that compares the study's values with published statements.

    Statements about values that the study does not have are left out.
    """
    rows, reasons = [], list[str]()
    for statement in study.published:
        figure = study.figures.get(statement.figure)
        if figure is None:
            continue
        rows.append(_comparison_row(statement, figure))
        if statement.why and statement.why not in reasons:
            reasons.append(statement.why)
    source = str(study.summary["source"]) or "publication"
    return ErrorTable(f"Published: {source}.", rows, [*reasons, *study.summary["remarks"]])


def format_figure(value: Scalar, kind: str) -> str:
    """Format a value by the kind of its quantity (``ratio``, ``share``, ``length``, ``energy`` or ``seconds``).

    A value of another kind is formatted as a plain number, and a text by `format_combination`.
    """
    if isinstance(value, str):
        return format_combination(value)
    if kind == "ratio":
        return f"{significant(cell_number(value), 2)}{SPACE}×"
    units = {"share": "%", "length": "m", "energy": "J", "seconds": "s"}
    return (
        format_in_unit(cell_number(value), units[kind]) if kind in units else format_input(round(cell_number(value), 9))
    )


def format_combination(key: str) -> str:
    """Format a text `key` such as ``"5x6"`` as (5,6); texts of another form are returned unchanged."""
    first, _, second = key.partition("x")
    return f"({first},{second})" if first.isdigit() and second.isdigit() else key


def _comparison_row(statement: Statement, value: Scalar) -> Row:
    """Build the row of the table that compares the study's `value` with a published statement.

    The row has a deviation and a mark only if the statement has a value.
    """
    shown = format_figure(value, statement.quantity)
    if statement.value is None:
        return Row(statement.text, "", shown, statement.words or None)
    printed = statement.words or format_figure(statement.value, statement.quantity)
    mark, deviation = _verdict(statement, value)
    return Row(statement.text, "", shown, printed, deviation, mark)


class Verdict(NamedTuple):
    """Verdict on a value compared with a published one, and the relative deviation of the value as text.

    The deviation is None if the value or the published one is a text, or if the value rounds to the published one.
    """

    mark: Mark
    deviation: str | None


def _verdict(statement: Statement, figure: Scalar) -> Verdict:
    """Compare a value with the published one: verdict, and relative deviation as `Verdict` describes it."""
    if isinstance(statement.value, str) or isinstance(figure, str):
        return Verdict(SAME if figure == statement.value else DIFFERENT, None)
    published, value = cell_number(statement.value), cell_number(figure)
    if value == published or not statement.words and round(value, decimals_of(published)) == published:
        return Verdict(SAME, None)
    return Verdict(mark_for(value, published, statement.is_error), signed_deviation(value, published))
