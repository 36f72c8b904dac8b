"""Compute studies in this process, with the tasks, store and tables of `pmr study` but without its workers."""

from pathlib import Path
from typing import Any

from pmr.studies import call
from pmr.studies.call import Outcome, Project, save
from pmr.studies.study import Store, StudyResults
from pmr.studies.tasks import digests

WORKFLOWS = Path(__file__).parents[1] / "workflows"
#: A coarse beam over half a second.
SHORT = """
extends = "{base}"
title = "Sliding beam, short case"
mesh.elements = 20
time.end = 0.5
slider.path = {{ kind = "ramp", times = [0.1, 0.4], values = [1.25, 1.6] }}
compare.ancf_elements = 8
"""


def short_scene(folder: Path, base: str = "paper_evolved") -> Path:
    """Write a scene file into `folder` that shortens and coarsens one of the paper's, and return its path."""
    file = folder / "short.toml"
    file.write_text(SHORT.format(base=WORKFLOWS / f"{base}.toml"))
    return file


def finished(folder: Path, text: str, **changes: Any) -> StudyResults:
    """Write a study file into `folder`, compute all of it there, and return its results."""
    file = folder / "study.toml"
    file.write_text(text)
    return compute(folder, call.load(file))


def compute(folder: Path, project: Project) -> StudyResults:
    """Compute the tasks of a project's only study one after the other, write its tables, and return its results."""
    (part,) = project.parts
    store, digest, results = Store(folder / "tasks"), digests(part.plan, "test"), {}
    store.prepare()
    for task in part.plan:
        needs = {name: results[key] for name, key in task.needs.items()}
        results[task.key] = task.function(task.arguments, needs)
        store.write(digest[task.key], task.key, results[task.key])
    found = StudyResults.collect(folder, part.plan, "test", store, {})
    save(project, Outcome({"": found}, len(results)), folder)
    return found
