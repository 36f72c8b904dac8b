"""Computational speed: the paper's way in Exudyn, per-step updates in Exudyn, and the compiled simulator.

Weyrer et al., section "Computational Speed".  Only the solver is timed, several times; nothing else runs beside.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from pmr import scene as scenes
from pmr.body import FullBody, SlidingBody
from pmr.errors import InputError
from pmr.responses import simulate_cable
from pmr.scene import Scene
from pmr.simulate import Simulator, TimeStepping, exudyn, march
from pmr.studies import nested, shared
from pmr.studies.results import RunRecord, StudyResults
from pmr.studies.study import Count, StudyBase
from pmr.studies.task import Plan, Scalar, Task, TaskResult

Share = Annotated[float, Field(gt=0.0, le=1.0)]


@dataclass(frozen=True)
class Approach:
    """One way to simulate the beam; `model` is ``"ancf"``, ``"dense"`` (full), ``"full"`` (sparse) or ``"reduced"``."""

    model: str
    simulate: Simulator | None
    cost: float


#: ``callbacks`` is the paper's way: dense matrices, rows and loads asked for in every iteration.
APPROACHES: Mapping[str, Approach] = {
    "ancf": Approach("ancf", None, 15.0),
    "full-callbacks": Approach("dense", exudyn.simulate_with_callbacks, 600.0),
    "full-updates": Approach("full", exudyn.simulate, 20.0),
    "full-march": Approach("full", march.simulate, 1.0),
    "reduced-callbacks": Approach("reduced", exudyn.simulate_with_callbacks, 12.0),
    "reduced-updates": Approach("reduced", exudyn.simulate, 3.0),
    "reduced-march": Approach("reduced", march.simulate, 1.0),
}
#: Pairs whose times the paper compares, and those that say what the other ways gain.
RATIOS = {
    "full_over_ancf": ("full-callbacks", "ancf"),
    "reduced_over_full": ("reduced-callbacks", "full-callbacks"),
    "reduced_over_ancf": ("reduced-callbacks", "ancf"),
    "updates_over_callbacks": ("reduced-updates", "reduced-callbacks"),
    "callbacks_over_march.full": ("full-callbacks", "full-march"),
    "callbacks_over_march.reduced": ("reduced-callbacks", "reduced-march"),
    "updates_over_march.full": ("full-updates", "full-march"),
}


class Study(StudyBase):
    """The scenes in every approach, `repeats` times each.

    `share` says for some of the approaches which part of the time span, from its beginning, is simulated; times are
    then extrapolated to all of it, the number of steps being what they depend on.  ``--set share.full-callbacks=1``
    simulates the whole span.

    Figures, for each scene: ``<scene>.seconds.<approach>`` (median) and ratios of these; ``span``, the longest time
    span, in s.
    """

    kind: Literal["speed"]
    scenes: Annotated[tuple[Path, ...], Field(min_length=1)]
    repeats: Count = 5
    share: dict[str, Share] = {}

    def plan(self) -> Plan:
        unknown = sorted(set(self.share) - set(APPROACHES))
        if unknown:
            allowed = f"one of {', '.join(APPROACHES)} is allowed"
            raise InputError("study", f"share.{unknown[0]}", self.share[unknown[0]], allowed)
        runs, common = [], dict[str, Task]()
        for file in self.scenes:
            scene = scenes.load(file)
            modes = shared.modes_tasks(scene)
            common |= {task.key: task for task in modes.values()}
            for name, approach in APPROACHES.items():
                share = self.share.get(name, 1.0)
                arguments = shared.scene_arguments(scene) | {"approach": name, "repeats": self.repeats, "share": share}
                needs = {key: task.key for key, task in modes.items()} if approach.model == "reduced" else {}
                parameters = {"scene": file.stem, "approach": name}
                cost = approach.cost * share * self.repeats / 5.0
                runs.append(Task(f"{file.stem}-{name}", timed, arguments, needs, parameters, cost, alone=True))
        return Plan(tuple(runs), tuple(common.values()))

    def figures(self, results: StudyResults) -> dict[str, Scalar]:
        found: dict[str, Scalar] = {"span": max(scenes.load(file).time.end for file in self.scenes)}
        for file in self.scenes:
            runs = [run for run in results.runs if run.parameters["scene"] == file.stem]
            median = {str(run.parameters["approach"]): statistics.median(_repeats(run)) for run in runs}
            found |= {f"{file.stem}.seconds.{name}": seconds for name, seconds in median.items()}
            found |= {f"{file.stem}.{name}": median[a] / median[b] for name, (a, b) in RATIOS.items()}
        return found


def timed(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: seconds ``repeat1``, ``repeat2``, ... of the solver for the whole time span; ``coordinates``, ``steps``.

    `share` is the part that was simulated.  A run of ten steps goes before, so that nothing is loaded or compiled
    while the clock runs.
    """
    scene, approach = shared.scene_of(arguments), APPROACHES[arguments["approach"]]
    steps = max(1, round(arguments["share"] * scene.time.steps))
    solve, coordinates = _solver(scene, approach, needs)
    solve(min(10, scene.time.steps))
    scale = scene.time.steps / steps
    seconds = {f"repeat{k + 1}": scale * solve(steps) for k in range(arguments["repeats"])}
    return TaskResult({"coordinates": coordinates, "steps": steps, "share": arguments["share"]}, seconds=seconds)


def _repeats(run: RunRecord) -> list[float]:
    return [seconds for name, seconds in run.seconds.items() if name.startswith("repeat")]


def _solver(scene: Scene, approach: Approach, needs: Mapping[str, TaskResult]) -> tuple[Callable[[int], float], int]:
    """What takes a number of steps and returns the solver's seconds, and the number of coordinates."""
    from pmr.run import reduce_with

    if approach.simulate is None:
        elements = scene.compare.ancf_elements

        def of_cable(steps: int) -> float:
            short = scene.time.model_copy(update={"end": steps * scene.time.step})
            return simulate_cable(scene.model_copy(update={"time": short}), [scene.body.length]).seconds

        return of_cable, 4 * (elements + 1)
    simulate, model = approach.simulate, shared.model_of(scene)
    if approach.model == "reduced":
        body: SlidingBody = reduce_with(scene, model, shared.snapshots_from(scene, needs)).reduced
    else:
        gathered = model.gather()
        assert gathered is not None
        body = _dense(gathered) if approach.model == "dense" else gathered
    loads = [load.signal for load in scene.loads]

    def of_body(steps: int) -> float:
        stepping = TimeStepping(steps * scene.time.step, scene.time.step, scene.time.rho_inf)
        return simulate(body, scene.slider.path, loads, stepping).seconds

    return of_body, body.size


def _dense(full: FullBody) -> SlidingBody:
    """The full model as the paper simulates it: a reduced one whose basis is the identity."""
    return nested.galerkin(full, np.eye(full.size))
