"""A finished study as a report reads it: its table, its figures, and what is published of them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any, Protocol

from pmr.report.blocks import DIFFERENT, SAME, ErrorTable, Mark, Row, mark_for, signed_deviation
from pmr.report.numbers import SPACE, in_unit, plain, significant
from pmr.studies.results import RunRecord, StudyResults
from pmr.studies.study import Statement
from pmr.studies.tasks import Scalar, number


@dataclass(frozen=True)
class FinishedStudy:
    """Content of a study's folder.

    Attributes
    ----------
    name : str
        Of its folder; what its part of the report is called in links.
    summary : mapping
        summary.json without the runs.
    results : StudyResults
    """

    name: str
    summary: Mapping[str, Any]
    results: StudyResults

    @classmethod
    def load(cls, folder: Path) -> FinishedStudy:
        """Read a study's folder."""
        summary = json.loads((folder / "summary.json").read_text())
        return cls(folder.name, {k: v for k, v in summary.items() if k != "runs"}, StudyResults.load(folder))

    @property
    def kind(self) -> str:
        return str(self.summary["kind"])

    @property
    def title(self) -> str:
        return str(self.summary["title"])

    @property
    def scenes(self) -> list[str]:
        """Names of the scenes that were run."""
        return list(dict.fromkeys(str(run.parameters["scene"]) for run in self.results.runs))

    @property
    def asked(self) -> Mapping[str, Any]:
        """Keys of the study file, but for names of files."""
        return dict(self.summary["asked"])

    @property
    def figures(self) -> Mapping[str, Scalar]:
        """Figures of all runs together; empty while one of them is missing."""
        return dict(self.summary["figures"])

    @property
    def published(self) -> list[Statement]:
        return [Statement.model_validate(entry) for entry in self.summary["published"]]

    @property
    def unfinished(self) -> list[RunRecord]:
        """Runs without a result."""
        return [run for run in self.results.runs if run.status != "done"]

    def figure(self, name: str) -> float:
        """A figure that is a number."""
        return number(self.figures[name])

    def runs(self, **parameters: Scalar) -> list[RunRecord]:
        """The runs with these parameters."""
        return [run for run in self.results.runs if parameters.items() <= dict(run.parameters).items()]


def studies_in(folder: Path) -> tuple[Mapping[str, Any], list[FinishedStudy]]:
    """Summary of a folder, and its studies: one, or those of a collection."""
    summary = json.loads((folder / "summary.json").read_text())
    if "studies" in summary:
        return summary, [FinishedStudy.load(folder / name) for name in summary["studies"]]
    return summary, [FinishedStudy.load(folder)]


class Compared(Protocol):
    """Figures of a study or an experiment, and what is published of them."""

    @property
    def figures(self) -> Mapping[str, Scalar]: ...
    @property
    def published(self) -> Sequence[Statement]: ...
    @property
    def summary(self) -> Mapping[str, Any]: ...


def comparison(study: Compared) -> ErrorTable:
    """Table of published statements beside the study's figures, without those whose figure the study does not have."""
    rows, reasons = [], list[str]()
    for statement in study.published:
        figure = study.figures.get(statement.figure)
        if figure is None:
            continue
        rows.append(_row(statement, figure))
        if statement.why and statement.why not in reasons:
            reasons.append(statement.why)
    source = str(study.summary["source"]) or "publication"
    return ErrorTable(f"Published: {source}.", rows, [*reasons, *study.summary["remarks"]])


def format_figure(value: Scalar, kind: str) -> str:
    """A figure as its quantity is printed."""
    if isinstance(value, str):
        return combination(value)
    if kind == "ratio":
        return f"{significant(number(value), 2)}{SPACE}×"
    units = {"share": "%", "length": "m", "energy": "J", "seconds": "s"}
    return in_unit(number(value), units[kind]) if kind in units else plain(round(number(value), 9))


def combination(key: str) -> str:
    """``"5x6"`` as (5,6); other texts as they are."""
    first, _, second = key.partition("x")
    return f"({first},{second})" if first.isdigit() and second.isdigit() else key


def _row(statement: Statement, figure: Scalar) -> Row:
    shown = format_figure(figure, statement.quantity)
    if statement.value is None:
        return Row(statement.text, "", shown, statement.words or None)
    printed = statement.words or format_figure(statement.value, statement.quantity)
    mark, deviation = _verdict(statement, figure)
    return Row(statement.text, "", shown, printed, deviation, mark)


def _verdict(statement: Statement, figure: Scalar) -> tuple[Mark, str | None]:
    if isinstance(statement.value, str) or isinstance(figure, str):
        return (SAME if figure == statement.value else DIFFERENT), None
    published, value = number(statement.value), number(figure)
    if value == published or not statement.words and round(value, _decimals(published)) == published:
        return SAME, None
    return mark_for(value, published, statement.is_error), signed_deviation(value, published)


def _decimals(value: float) -> int:
    """Decimals to which a figure is stated."""
    return max(-int(Decimal(repr(value)).normalize().as_tuple().exponent), 0)
