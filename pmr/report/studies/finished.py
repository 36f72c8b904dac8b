"""A finished study as a report reads it: its table, its figures, and what is published of them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pmr.studies.engine.task import Scalar, number
from pmr.studies.results import RunRecord, StudyResults
from pmr.studies.study import Statement


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
