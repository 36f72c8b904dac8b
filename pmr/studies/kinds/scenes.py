"""A parameter study: scenes, each with keys changed as asked, reduced, simulated and compared."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from pmr import scene as scenes
from pmr.errors import InputError
from pmr.scene import Scene
from pmr.scene.richer import candidates
from pmr.scene.tomlfiles import Change
from pmr.studies import grid, shared
from pmr.studies.engine.task import KEY, Plan, Scalar, Task, TaskResult, key_of
from pmr.studies.figures import boom_arguments, ran, run_boom_case
from pmr.studies.study import StudyBase


class Case(BaseModel):
    """A named change of the scene."""

    model_config = ConfigDict(frozen=True, extra="forbid")

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
        for point in self._points():
            scene = self._scene(point)
            second_order = scene.frame is not None and scene.frame.second_order
            if len(scene.sections) > 1 or second_order or scene.goal is not None or candidates(scene):
                runs.append(Task(point.key, run_boom_case, boom_arguments(scene), {}, point.parameters))
                continue
            needs = shared.modes_tasks(scene) | {"frequencies": shared.frequencies_task(scene)}
            needs |= {name: shared.reference_task(scene, name) for name in scene.compare.against}
            common |= {task.key: task for task in needs.values()}
            keys = {name: task.key for name, task in needs.items()}
            runs.append(Task(point.key, run_case, shared.scene_arguments(scene), keys, point.parameters))
        return Plan(tuple(runs), tuple(common.values()))

    def _points(self) -> Iterator[_Point]:
        for file in self.scenes:
            of_scene: dict[str, Scalar] = {"scene": file.stem} if len(self.scenes) > 1 else {}
            for i, case in enumerate(self.cases or [None]):
                of_case: dict[str, Scalar] = {"case": case.name} if case else {}
                before = [Change(self.change, "change")]
                before += [Change(case.change, f"cases[{i}].change")] if case else []
                for point in grid.points(self.grid):
                    words = (*map(str, (of_scene | of_case).values()), *point.words)
                    parameters = {**of_scene, **of_case, **point.parameters}
                    yield _Point(key_of(",".join(words) or file.stem), file, (*before, *point.changes), parameters)

    def _scene(self, point: _Point) -> Scene:
        try:
            return scenes.vary(point.file, point.changes)
        except InputError as error:
            source, key = error.source, error.key
            if source in {change.source for change in point.changes}:
                source, key = "study", f"{source}.{key}"
            raise InputError(source, key, error.value, f"{error.allowed} (run {point.key})") from None


@dataclass(frozen=True)
class _Point:
    """One run: its key, its scene file, what to change in it, and that as columns of the table."""

    key: str
    file: Path
    changes: tuple[Change, ...]
    parameters: Mapping[str, Scalar]


def run_case(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: one run of a body alone with eigenmodes, references and frequencies that other runs share; see `ran`."""
    from pmr.pipeline.bodies import Precomputed

    scene = shared.scene_of(arguments)
    references = {name: shared.response_from(needs[name]) for name in scene.compare.against}
    frequencies = needs["frequencies"].arrays["omega"] / (2.0 * np.pi)
    return ran(scene, Precomputed(shared.snapshots_from(scene, needs), references, frequencies))
