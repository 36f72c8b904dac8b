"""A study of one figure, which stands in pmr's own code: python edited.py FOLDER"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pmr.studies.call import compute, save
from pmr.studies.engine import pools
from pmr.studies.engine.runner import Progress
from pmr.studies.engine.task import Plan, Task, TaskResult
from pmr.studies.files import Part, Project
from pmr.studies.study import StudyBase


def figure(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    from pmr.errors import environment

    return TaskResult({"figure": environment.FIGURE})


class Figures(StudyBase):
    kind: Literal["figures"] = "figures"
    title: str = "Figures"

    def plan(self) -> Plan:
        return Plan(tuple(Task(f"run={k}", figure, {"k": k}) for k in range(2)))


def main(folder: Path) -> None:
    print("begun", flush=True)
    study = Figures()
    project = Project(study.title, study.kind, (Part("", study, study.plan()),))
    with pools.local_pool(1) as pool:
        outcome = compute(project, folder, pool, _ignore)
    save(project, outcome, folder)
    print(*(run.figures["figure"] for run in outcome.results[""].runs), flush=True)


def _ignore(progress: Progress) -> None:
    pass


if __name__ == "__main__":
    sys.modules["edited"] = sys.modules["__main__"]
    figure.__module__ = "edited"
    main(Path(sys.argv[1]))
