"""Read a finished study for its report: tables of its runs, its values, and published values."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

from pmr.files.arrays import Summary
from pmr.report.blocks import DIFFERENT, SAME, ErrorTable, Mark, Row, mark_for, signed_deviation
from pmr.report.numbers import SPACE, decimals_of, format_in_unit, format_input, significant
from pmr.studies.study import RunRecord, Statement, StudyResults
from pmr.studies.tasks import Scalar, cell_number


@dataclass(frozen=True)
class FinishedStudy:
    """Content of a study's folder: its summary, and the results of its runs."""

    name: str  # of the folder, by which links refer to the study's chapter
    summary: Summary  # content of summary.json, without the runs
    results: StudyResults  # the runs and their arrays

    @classmethod
    def load(cls, folder: Path) -> FinishedStudy:
        """Read a study's folder."""
        summary = json.loads((folder / "summary.json").read_text())
        return cls(folder.name, {k: v for k, v in summary.items() if k != "runs"}, StudyResults.load(folder))

    @property
    def kind(self) -> str:
        """Kind of the study, such as ``chart``."""
        return str(self.summary["kind"])

    @property
    def title(self) -> str:
        """Title of the study."""
        return str(self.summary["title"])

    @property
    def study_file(self) -> Summary:
        """Content of the study file, without the names of files in it."""
        return dict(self.summary["asked"])

    @property
    def figures(self) -> Mapping[str, Scalar]:
        """Values that are computed from all runs together, by name; empty as long as a run has no result."""
        return dict(self.summary["figures"])

    @property
    def published(self) -> list[Statement]:
        """Published statements that the study file names for comparison."""
        return [Statement.model_validate(entry) for entry in self.summary["published"]]

    @property
    def unfinished_runs(self) -> list[RunRecord]:
        """Runs without a result."""
        return [run for run in self.results.runs if run.status != "done"]


def studies_in(folder: Path, summary: Summary) -> list[FinishedStudy]:
    """Return the only study in a folder, or all studies of a collection; `summary` is the content of summary.json."""
    return [FinishedStudy.load(folder / name) for name in summary.get("studies", ("",))]


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
    """Format a value by the kind of its quantity (``ratio``, ``share``, ``length``, ``energy`` or ``seconds``)."""
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

    The deviation is None if either of the two is a text, or if the value rounds to the published one.
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
