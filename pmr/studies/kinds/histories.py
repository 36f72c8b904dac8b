"""Histories: tip displacement and energy of the reduced beam, the full one and the ANCF cable, and their differences.

Weyrer et al., sections "Tip Displacement, Energy, and Accuracy" and "Accuracy".  Each scene is reduced as it says;
beside it stands the same basis with the supports' rows dropped.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field

from pmr import scene as scenes
from pmr.compare import errors as compare
from pmr.compare.simulated import simulate
from pmr.errors import InputError
from pmr.files import records
from pmr.scene import Scene
from pmr.scene.names import ALONE
from pmr.simulation import Excitation
from pmr.studies import figures, marching, sections, shared, subjects
from pmr.studies.engine.task import Plan, Scalar, Task, TaskResult, key_of
from pmr.studies.results import StudyResults
from pmr.studies.study import Statement, StudyBase

if TYPE_CHECKING:
    from pmr.reduction.reduced_body import ReducedBody

#: Energies and tips are what is drawn; displacements along the beam are compared here and not stored.
SIMULATORS = ("reduced", "full", "ancf")


class Study(StudyBase):
    """The scenes, each with its references.

    Figures: those of each run after the name of its scene, such as ``paper_evolved.errors.reduced_vs_full.tip``.  What
    the scenes say is published needs no repetition here.  A boom stands beside its full sections alone.
    """

    kind: Literal["histories"] = Field(description="Kind of study")
    scenes: Annotated[tuple[Path, ...], Field(min_length=1)] = Field(description="Scenes that are computed")

    def plan(self) -> Plan:
        runs, common = [], dict[str, Task]()
        for file in self.scenes:
            if boom := subjects.boom(file):
                runs.append(sections.task(file.stem, sections.history, boom, {"scene": file.stem}, {}))
                continue
            scene = scenes.beam_scene(file)
            if "ancf" not in scene.compare.against:
                allowed = f"{file.name}: scenes compared with ancf are allowed"
                raise InputError("study", "scenes", list(scene.compare.against), allowed)
            needs = shared.modes_tasks(scene) | {"ancf": shared.reference_task(scene, "ancf")}
            common |= {task.key: task for task in needs.values()}
            keys = {name: task.key for name, task in needs.items()}
            arguments = shared.scene_arguments(marching.marched(scene))
            runs.append(Task(key_of(file.stem), history, arguments, keys, {"scene": file.stem}, cost=2.0))
        return Plan(tuple(runs), tuple(common.values()))

    def figures(self, results: StudyResults) -> dict[str, Scalar]:
        return {f"{run.key}.{name}": value for run in results.runs for name, value in run.figures.items()}

    def statements(self) -> tuple[Statement, ...]:
        of_scenes = (
            statement for file in self.scenes for statement in _of_scene(key_of(file.stem), scenes.load_any(file))
        )
        return (*of_scenes, *self.published)


def history(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: errors between all three, with and without the supports' rows.

    Figures: ``errors.<a>_vs_<b>.<place>`` (e_NRMS), ``absolute_errors.`` likewise (e_abs, m), ``max_displacement`` and
    ``max_error`` (m), ``coordinates.full`` and ``.reduced``, ``basis.kappa``; ``dropped.tip``, ``dropped.beam`` and
    ``dropped.max_error`` for the reduced model without the supports' rows.  Arrays: of each simulator its response at
    the tip, of ``dropped`` the tip; ``path`` (m), ``path_rate`` (m/s) and ``loads`` (N) over time, ``singular_values``,
    ``x`` (m) and ``shapes`` of the basis, ``scene`` as JSON.
    """
    from pmr.compare import summary
    from pmr.pipeline.full_order import FullOrder
    from pmr.reduction.bodies import reduce_with

    scene = shared.scene_of(arguments)
    model = shared.model_of(scene)
    snapshots = shared.snapshots_from(scene, needs)
    dropping = scene.model_copy(update={"reduction": scene.reduction.model_copy(update={"basis": "eigenmodes"})})
    body, dropped = (reduce_with(one, model, snapshots) for one in (scene, dropping))
    full = FullOrder.of(scene, {ALONE: model}).reference("full")
    assert full is not None
    responses = {"reduced": simulate(scene, body.model), "full": full}
    responses["ancf"] = shared.response_from(needs["ancf"])
    beside = {"dropped": simulate(dropping, dropped.model), "full": responses["full"]}
    record = figures.compared(summary.compared(responses, compare.AT_NODES, {}).figures, "errors", "absolute_errors")
    record |= {
        f"dropped.{place}": value
        for place, value in compare.errors(beside, order=("dropped", "full"))["dropped_vs_full"].items()
    }
    record |= {
        "dropped.max_error": float(np.abs(beside["dropped"].displacement - full.displacement).max()),
        "coordinates.full": model.size,
        "coordinates.reduced": body.model.size,
        "basis.kappa": body.basis.kappa(),
    }
    arrays = _arrays(scene, body) | {"dropped.tip": beside["dropped"].tip}
    for name, response in responses.items():
        arrays |= records.arrays(figures.at_the_tip(response), f"{name}.")
    return TaskResult(record, arrays, {f"simulate.{name}": response.seconds for name, response in responses.items()})


def _arrays(scene: Scene, body: ReducedBody) -> dict[str, Any]:
    excitation = Excitation.of(scene)
    return {
        "path": excitation.s[:, 0],
        "path_rate": excitation.path_rate,
        "loads": excitation.f,
        "singular_values": body.basis.sigma,
        "x": body.model.output_positions,
        "shapes": body.model.outputs,
        "scene": np.array(scene.model_dump_json()),
    }


def _of_scene(name: str, scene: Scene) -> Iterator[Statement]:
    """What the scene file says is published."""
    if scene.published is None:
        return
    spoken = {"full": "full", "ancf": "ANCF", "reduced": "reduced"}
    remarks = " ".join(scene.published.remarks)
    for pair, places in scene.published.errors.items():
        first, _, second = pair.partition("_vs_")
        for place, value in places.items():
            text = f"{scene.title}: {spoken[first]} against {spoken[second]}, {place}"
            figure, why = f"{name}.errors.{pair}.{place}", remarks if first == "reduced" else ""
            yield Statement(figure=figure, text=text, value=value, quantity="share", why=why)
    for figure, text in (("max_displacement", "largest displacement"), ("max_error", "largest error")):
        value = getattr(scene.published, figure)
        if value is not None:
            yield Statement(
                figure=f"{name}.{figure}", text=f"{scene.title}: {text}", value=value, quantity="length", why=remarks
            )
