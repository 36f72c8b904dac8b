"""A parameter study: scenes, each with keys changed as asked, reduced, simulated and compared."""

from __future__ import annotations

import itertools
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from pmr import scene as scenes
from pmr.errors import InputError
from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.keys import Section
from pmr.scene.richer import candidates
from pmr.scene.tomlfiles import Change
from pmr.studies import shared
from pmr.studies.figures import run_scene
from pmr.studies.study import StudyBase
from pmr.studies.tasks import KEY, Arguments, Needs, Plan, Scalar, Task, TaskResult, key_of


@dataclass(frozen=True)
class Point:
    """A run: the changes that it asks for, and what they are called in keys of tasks and in the table."""

    changes: tuple[Change, ...]
    words: tuple[str, ...]
    parameters: Mapping[str, Scalar]


def grid_points(grid: Mapping[str, Any]) -> Iterator[Point]:
    """All combinations of a grid's lists, the last list varying fastest; of an empty grid the one without changes.

    ``{"reduction": {"modes": [4, 6], "coordinates": [10, 20]}}`` has four, the first called ``modes=4`` and
    ``coordinates=10``; a name is the shortest end of a dotted key that tells it from the others.  Raises InputError
    with source ``"study"``, if something else than a list with values stands at the end of a key.
    """
    lists = dict(_lists(grid, ""))
    last = Counter(key.rpartition(".")[2] for key in lists)
    names = [key if last[key.rpartition(".")[2]] > 1 else key.rpartition(".")[2] for key in lists]
    for numbered in itertools.product(*map(enumerate, lists.values())):
        values = {key: value for key, (_, value) in zip(lists, numbered, strict=True)}
        yield Point(
            tuple(Change(_nest(key, value), "grid") for key, value in values.items()),
            tuple(f"{name}={_word(value, number)}" for name, (number, value) in zip(names, numbered, strict=True)),
            {key: value if _is_plain(value) else json.dumps(value) for key, value in values.items()},
        )


def _lists(tables: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Sequence[Any]]]:
    for key, value in tables.items():
        if isinstance(value, Mapping):
            yield from _lists(value, f"{prefix}{key}.")
        elif isinstance(value, list) and value:
            yield f"{prefix}{key}", value
        else:
            raise InputError("study", f"grid.{prefix}{key}", value, "a list of values is allowed, one for each run")


def _nest(key: str, value: Any) -> dict[str, Any]:
    for part in reversed(key.split(".")):
        value = {part: value}
    return dict(value)


def _is_plain(value: Any) -> bool:
    return isinstance(value, (float, int, str))


def _word(value: Any, number: int) -> str:
    """A value as part of a key; where it can't be, its place in the list."""
    text = str(value).lower() if isinstance(value, bool) else str(value)
    return text if _is_plain(value) and KEY.fullmatch(f"0{text}") else f"no{number + 1}"


class Case(Section):
    """A named change of the scene."""

    name: Annotated[str, Field(pattern=f"^{KEY.pattern}$")] = Field(description="Name of the case in tables")
    change: dict[str, Any] = Field(default={}, description="Keys of the scenes, and their values")


class Study(StudyBase):
    """All combinations of `scenes`, `cases` and `grid`; `change` goes before and holds for all.

    A list in `grid` is what its key takes one after the other: ``[grid] reduction.coordinates = [10, 14, 20]``.
    """

    kind: Literal["scenes"] = Field(description="Kind of study")
    scenes: Annotated[tuple[Path, ...], Field(min_length=1)] = Field(description="Scenes that are computed")
    change: dict[str, Any] = Field(default={}, description="Keys of the scenes to change in all runs")
    cases: tuple[Case, ...] = Field(default=(), description="Named changes, each of which is run")
    grid: dict[str, Any] = Field(default={}, description="Keys of the scenes and the values that each takes in turn")

    def plan(self) -> Plan:
        runs, common = [], dict[str, Task]()
        for file, point in self._points():
            key = key_of(",".join(point.words) or file.stem)
            scene = _varied_scene(file, point, key)
            arguments, needs = shared.scene_arguments(scene), dict[str, Task]()
            second_order = scene.frame is not None and scene.frame.second_order
            if not (len(scene.sections) > 1 or second_order or scene.goal is not None or candidates(scene)):
                needs = shared.modes_tasks(scene) | {"frequencies": shared.frequencies_task(scene)}
                needs |= {name: shared.reference_task(scene, name) for name in scene.compare.against}
            common |= {task.key: task for task in needs.values()}
            keys = {name: task.key for name, task in needs.items()}
            runs.append(Task(key, run_case, arguments, keys, point.parameters))
        return Plan(tuple(runs), tuple(common.values()))

    def _points(self) -> Iterator[tuple[Path, Point]]:
        """Scene files, and what to change in them, of all runs."""
        for file in self.scenes:
            of_scene: dict[str, Scalar] = {"scene": file.stem} if len(self.scenes) > 1 else {}
            for i, case in enumerate(self.cases or [None]):
                named: dict[str, Scalar] = of_scene | ({"case": case.name} if case else {})
                before = [Change(self.change, "change")]
                before += [Change(case.change, f"cases[{i}].change")] if case else []
                for point in grid_points(self.grid):
                    words = (*map(str, named.values()), *point.words)
                    yield file, Point((*before, *point.changes), words, {**named, **point.parameters})


def _varied_scene(file: Path, point: Point, key: str) -> Scene:
    """The scene of the run with this key; an InputError names the key of the study that makes it impossible."""
    try:
        return scenes.vary(file, point.changes)
    except InputError as error:
        source, of = error.source, error.key
        if source in {change.source for change in point.changes}:
            source, of = "study", f"{source}.{of}"
        raise InputError(source, of, error.value, f"{error.allowed} (run {key})") from None


def run_case(arguments: Arguments, needs: Needs) -> TaskResult:
    """Task: `run_scene`; of a body alone with eigenmodes, references and frequencies that other runs share."""
    from pmr.pipeline.bodies import Precomputed

    scene = shared.scene_of(arguments)
    if not needs:
        return run_scene(scene)
    references: dict[str, Response] = {name: shared.response_from(needs[name]) for name in scene.compare.against}
    frequencies = needs["frequencies"].arrays["omega"] / (2.0 * np.pi)
    return run_scene(scene, Precomputed(shared.snapshots_from(scene, needs), references, frequencies))
