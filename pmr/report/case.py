"""What every case says in a report, whatever it is of: everything in it is text, markup or plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from pmr.report import marks, provenance
from pmr.report.figures import Drawing
from pmr.report.marks import Row
from pmr.report.provenance import Table
from pmr.report.sentences import KeyNumber
from pmr.results import RunResult


@dataclass(frozen=True, kw_only=True)
class Case:
    """One run, ready for the template that its kind has.

    Attributes
    ----------
    warnings : list of str
        What whoever sizes a machine by these results has to know.
    about : str
        What the errors in `table` are errors of.
    """

    template: ClassVar[str]
    anchor: str
    title: str
    source: str | None
    key_numbers: list[KeyNumber]
    paragraph: str
    warnings: list[str]
    about: str
    table: list[Row]
    verdicts: dict[str, int]
    apart: bool
    reasons: list[str]
    drawings: Mapping[str, Drawing]
    provenance: list[list[Table]]
    software: list[str]


def common(result: RunResult, anchor: str, table: list[Row]) -> dict[str, Any]:
    """The fields of a case that don't depend on its kind."""
    published = result.scene.published
    return {
        "anchor": anchor,
        "title": result.scene.title,
        "source": published.source if published else None,
        "table": table,
        "warnings": [warning[:1].upper() + warning[1:] for warning in result.summary.get("warnings", ())],
        "verdicts": marks.verdicts(table),
        "apart": bool(marks.apart(table)),
        "reasons": marks.reasons(result, table),
        "software": provenance.software(result),
    }
