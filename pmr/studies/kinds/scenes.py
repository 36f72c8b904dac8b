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
from pmr.scene.names import ALONE
from pmr.scene.tomlfiles import Change
from pmr.studies import grid, shared
from pmr.studies.engine.task import KEY, Plan, Scalar, Task, TaskResult, key_of
from pmr.studies.figures import boom_arguments, compared, figures_of, of_bodies, run_boom_case
from pmr.studies.study import StudyBase

COMPARED_FREQUENCIES = 3


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
            if len(scene.sections) > 1 or (scene.frame is not None and scene.frame.second_order):
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
    """Task: one run, from eigenmodes and references to errors.

    Figures: ``errors.<a>_vs_<b>.<place>`` (e_NRMS), ``max_displacement`` and ``max_error`` (m), ``coordinates.full``
    and ``.reduced``, ``basis.kappa``, and ``frequency_error.<i>``, the largest relative error of the i-th frequency
    over the path; then what `pmr.studies.figures` says, with stresses where the scene recovers them.  Arrays: ``t``
    (s), ``tip`` (m), ``singular_values``, ``frequencies.s`` (m), ``.full``, ``.reduced`` (rad/s).
    """
    from pmr.compare import summary
    from pmr.compare.frequencies import reduced_frequencies
    from pmr.compare.responses import quantities
    from pmr.compare.simulated import simulate_with_states
    from pmr.compare.summary import combined
    from pmr.compare.utilisation import masses, utilisation
    from pmr.reduction.bodies import reduce_with
    from pmr.reduction.recover.from_scene import beside_full, of_reduced, recovered_steps

    scene = shared.scene_of(arguments)
    built, stressed = shared.built_of(scene), scene.recovery is not None and scene.recovery.stress
    body = reduce_with(scene, built.model, shared.snapshots_from(scene, needs))
    simulated = simulate_with_states(scene, body.model, recovered_steps(scene).tolist() if stressed else ())
    responses = {"reduced": simulated.response}
    responses |= {name: shared.response_from(needs[name]) for name in scene.compare.against}
    s, full = (needs["frequencies"].arrays[name] for name in ("s", "omega"))
    reduced = 2.0 * np.pi * reduced_frequencies(body.model, s, full.shape[1])
    record = compared(summary.compared(responses, quantities(scene, simulated.response), {}).figures, "errors")
    record |= {
        "coordinates.full": built.model.size,
        "coordinates.reduced": body.model.size,
        "basis.kappa": body.basis.kappa(),
    }
    for i in range(min(COMPARED_FREQUENCIES, full.shape[1])):
        off = np.abs(reduced[:, i] / full[:, i] - 1.0).max()
        record[f"frequency_error.{i + 1}"] = float(off) if np.isfinite(off) else None  # fewer coordinates are free
    response = responses["reduced"]
    record |= figures_of(scene, response, s, reduced)
    said = combined([masses({ALONE: built.model.masses})])
    if stressed:
        seen = beside_full(of_reduced(scene, {ALONE: built}, {ALONE: body}, simulated.states), {})[ALONE].summary()
        said |= seen | dict(utilisation(scene, {ALONE: seen}).figures)
    record |= of_bodies(said)
    arrays = {"t": response.t, "tip": response.tip, "singular_values": body.basis.sigma}
    arrays |= {"frequencies.s": s, "frequencies.full": full, "frequencies.reduced": reduced}
    return TaskResult(record, arrays, {f"simulate.{name}": r.seconds for name, r in responses.items()})
