"""One call of ``pmr study``: from the parts of a project to their tables."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pmr.errors import environment
from pmr.studies.engine.graph import open_nodes
from pmr.studies.engine.pools import Pool
from pmr.studies.engine.runner import Watch, run
from pmr.studies.engine.store import Store
from pmr.studies.engine.worker import NOT_COMPUTING
from pmr.studies.files import Project
from pmr.studies.results import RunRecord, StudyResults
from pmr.studies.study import StudyBase

#: What digests of results leave out, so that a change there computes nothing again: a task's own one has its module.
LEFT_OUT = (*NOT_COMPUTING, "studies/kinds/")
#: Keys of study files that name files: where these lie is of no interest to readers of a summary.
FILES = {"scene", "scenes"}


@dataclass(frozen=True)
class Outcome:
    """Results of a call, and all that is there of its study.

    `results` are those of each part, by name; `computed` is the number of tasks that this call computed itself.
    """

    results: Mapping[str, StudyResults]
    computed: int

    @property
    def done(self) -> int:
        """Number of runs that are there."""
        return sum(record.status == "done" for results in self.results.values() for record in results.runs)

    @property
    def is_complete(self) -> bool:
        return all(results.is_complete for results in self.results.values())


def compute(project: Project, folder: Path, pool: Pool, watch: Watch) -> Outcome:
    """Compute what is not there yet; results of tasks go into a folder of `folder`, no table is written."""
    store, code = Store(folder / "tasks"), environment.code_digest(environment.sources(), LEFT_OUT)
    store.prepare()
    nodes = open_nodes([part.plan for part in project.parts], code, store.sound)
    failures = run(nodes, store, pool, watch)
    results = {
        part.name: StudyResults.collect(folder / part.name, part.plan, code, store, failures) for part in project.parts
    }
    return Outcome(results, len(nodes) - len(failures))


def save(project: Project, outcome: Outcome, folder: Path) -> list[Path]:
    """Write the tables, and say where: in `folder`, or for a collection in a folder in it for each part."""
    written = []
    for part in project.parts:
        results = outcome.results[part.name]
        tables = part.study.tables(results)
        results.save(_summary(part.study.title, part.study.kind) | _of_study(part.study, results), tables)
        written += [results.folder / name for name in ("runs.csv", *filter(tables.get, tables))]
    if "" not in outcome.results:
        runs = tuple(record for name, results in outcome.results.items() for record in _rename_runs(name, results))
        StudyResults(folder, runs).save_summary(
            _summary(project.title, project.kind) | {"studies": list(outcome.results)}
        )
    return written


def _rename_runs(name: str, results: StudyResults) -> list[RunRecord]:
    """Runs as seen from the folder above."""
    return [
        replace(run, key=f"{name}/{run.key}", file=run.file and os.path.normpath(os.path.join(name, run.file)))
        for run in results.runs
    ]


def _of_study(study: StudyBase, results: StudyResults) -> dict[str, Any]:
    """Keys of a study, the figures of all of its runs, and what is published about it."""
    base = set(StudyBase.model_fields)
    keys = {name: value for name, value in study.model_dump(mode="json").items() if name not in base | FILES}
    return {
        "asked": keys,
        "figures": dict(study.figures(results)) if results.is_complete else {},
        "source": study.source,
        "published": [statement.model_dump() for statement in study.statements()],
        "remarks": list(study.remarks),
        "hints": study.hints(),
    }


def _summary(title: str, kind: str) -> dict[str, Any]:
    return {
        "title": title,
        "kind": kind,
        "versions": environment.versions(),
        "commit": environment.commit(),
        "date": environment.today(),
        "machine": environment.machine(),
    }
