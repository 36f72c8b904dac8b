"""Mutated studies: accepted ones are planned, and of some a run is computed."""

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fuzz import toml
from fuzz.bases import BEAM, BOOM
from fuzz.mutations import STRANGE, Random, mutated, scratched, strange
from fuzz.scenes import prepare as warm
from fuzz.verdict import NonsenseError

from pmr import ConvergenceError, SimulationError
from pmr.studies import call
from pmr.studies.tasks import Plan, Task, TaskResult

SCENES = {
    "beam.toml": BEAM
    | {"reduction": {"basis": "eigenmodes", "snapshots": 3, "modes": 2, "coordinates": 4, "positions": "nodes"}},
    "boom.toml": BOOM,
}
STUDIES: dict[str, dict[str, Any]] = {
    "scenes": {"kind": "scenes", "title": "Coordinates", "scenes": ["beam.toml"],
     "change": {"compare": {"against": ["full"]}}, "cases": [{"name": "soft",
     "change": {"body": {"profile": {"bending_stiffness": 1e4}}}}, {"name": "as-it-is"}],
     "grid": {"reduction": {"coordinates": [3, 4], "basis": ["eigenmodes"]}}},
    "sections": {"kind": "scenes", "title": "Boom", "scenes": ["boom.toml"], "grid": {"mesh": {"elements": [12, 16]}}},
    "collection": {"kind": "collection", "title": "All", "files": ["scenes.toml", "sections.toml"],
     "change": {"scenes": {"title": "A"}}},
}  # fmt: skip
COMPUTED, MOST_RUNS = 6, 1  # of that many accepted ones so many runs are computed


prepare = warm


def case(number: int, rng: Random, folder: Path) -> str:
    """Plan a mutated study and compute some of it if it is accepted; return the outcome in a few words."""
    for name, data in SCENES.items():
        (folder / name).write_text(toml.written(data))
    for name, data in STUDIES.items():
        (folder / f"{name}.toml").write_text(toml.written(data))
    names = list(STUDIES)
    base = STUDIES[names[int(rng.integers(len(names)))]]
    overrides: list[str] = []
    how = rng.random()
    content = toml.written(base).encode()
    if how < 0.15:
        content = scratched(content, rng)
    elif how < 0.3:
        keys = ["grid.reduction.coordinates", "title", "scenes", "change.time.step", "grid", *STRANGE[:3]]
        overrides = [f"{keys[int(rng.integers(len(keys)))]}={toml.value(strange(rng))}"]
    else:
        content = toml.written(mutated(base, rng, most=2)).encode()
    file = folder / "study.toml"
    file.write_bytes(content)
    project = call.load(file, overrides)
    if any("\n" in run for run in project.runs):
        raise NonsenseError("a run's name has several lines")
    computed = 0
    if number % COMPUTED == 0:
        for part in project.parts[:1]:
            for run in part.plan.runs[:MOST_RUNS]:
                try:
                    _ensure_told(_result(part.plan, run, {}))
                except (ConvergenceError, SimulationError) as error:  # a study records it, and its exit code says so
                    return f"{len(project.runs)} runs, one fails: {error}"
                computed += 1
    return f"{len(project.runs)} runs, {computed} computed"


def _result(plan: Plan, task: Task, known: dict[str, TaskResult]) -> TaskResult:
    """Compute a task as a worker does, its needs first."""
    by_key = {each.key: each for each in plan}
    for key in task.needs.values():
        if key not in known:
            known[key] = _result(plan, by_key[key], known)
    arguments = json.loads(json.dumps(dict(task.arguments), allow_nan=False))
    return task.function(arguments, {name: known[key] for name, key in task.needs.items()})


def _ensure_told(result: TaskResult) -> None:
    """Fail if a value of a result is not finite."""
    record: Mapping[str, Any] = result.record
    for name, value in record.items():
        if isinstance(value, float) and not math.isfinite(value):
            raise NonsenseError(f"{name} = {value}")
