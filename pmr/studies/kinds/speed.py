"""Computational speed: the paper's way in Exudyn, per-step updates in Exudyn, and the compiled simulator.

Weyrer et al., section "Computational Speed".  Only the solver is timed, several times; nothing else runs beside.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

from pmr import scene as scenes
from pmr.compare.cable import simulate_cable
from pmr.compare.runs import run_from_start
from pmr.errors import InputError
from pmr.scene import Scene
from pmr.scene.signals import SignalBase
from pmr.simulation import Excitation, exudyn
from pmr.simulation.exudyn.cable import COORDINATES_PER_NODE
from pmr.studies import booms, sections, shared, subjects
from pmr.studies.engine.task import Plan, Scalar, Task, TaskResult, key_of
from pmr.studies.results import RunRecord, StudyResults
from pmr.studies.study import Count, StudyBase
from pmr.system.body import SlidingBody
from pmr.system.projection import projected
from pmr.system.system import System, SystemTrajectory

if TYPE_CHECKING:
    from pmr.simulation.exudyn import Formulation

Array = NDArray[np.float64]
Share = Annotated[float, Field(gt=0.0, le=1.0)]
Simulate = Callable[[System, Excitation], SystemTrajectory]


@dataclass(frozen=True)
class Approach:
    """One way to simulate the beam; `model` is ``"ancf"``, ``"dense"`` (full), ``"full"`` (sparse) or ``"reduced"``."""

    model: str
    simulate: Simulate | None
    cost: float


def _in_exudyn(formulation: Formulation) -> Simulate:
    return partial(exudyn.simulate_system, formulation=formulation)


#: ``callbacks`` is the paper's way: dense matrices, rows and loads asked for in every iteration.  Whether it reuses a
#: Jacobian (``modified`` Newton) it does not say; the ratios that it states are close to those of one that does.
_CALLBACKS = _in_exudyn("callbacks")
_MODIFIED = _in_exudyn("callbacks-modified-newton")
APPROACHES: Mapping[str, Approach] = {
    "ancf": Approach("ancf", None, 15.0),
    "full-callbacks-modified": Approach("dense", _MODIFIED, 100.0),
    "full-callbacks": Approach("dense", _CALLBACKS, 600.0),
    "full-updates": Approach("full", _in_exudyn("springs"), 20.0),
    "full-march": Approach("full", run_from_start, 1.0),
    "reduced-callbacks-modified": Approach("reduced", _MODIFIED, 6.0),
    "reduced-callbacks": Approach("reduced", _CALLBACKS, 12.0),
    "reduced-updates": Approach("reduced", _in_exudyn("springs"), 3.0),
    "reduced-march": Approach("reduced", run_from_start, 1.0),
}
#: Pairs whose times the paper compares, and those that say what the other ways gain.
RATIOS = {
    "full_over_ancf": ("full-callbacks-modified", "ancf"),
    "reduced_over_full": ("reduced-callbacks-modified", "full-callbacks-modified"),
    "reduced_over_ancf": ("reduced-callbacks-modified", "ancf"),
    "updates_over_callbacks": ("reduced-updates", "reduced-callbacks"),
    "callbacks_over_march.full": ("full-callbacks", "full-march"),
    "callbacks_over_march.reduced": ("reduced-callbacks", "reduced-march"),
    "modified_over_march.full": ("full-callbacks-modified", "full-march"),
    "modified_over_march.reduced": ("reduced-callbacks-modified", "reduced-march"),
    "updates_over_march.full": ("full-updates", "full-march"),
}
#: Of a boom: the full sections and the reduced ones, compiled and, of these, in Exudyn with springs.
OF_SECTIONS = {"full-march": 5.0, "reduced-march": 1.0, "reduced-exudyn": 3.0}
#: Stretches over which a share of the time span is spread.
STRETCHES = 8


class Study(StudyBase):
    """The scenes in every approach, `repeats` times each.

    `share` says for some of the approaches which part of the time span is simulated, in stretches spread evenly over
    it, each from rest; times are extrapolated to all of it.  ``--set share.full-callbacks=1`` simulates the whole span.

    Of booms the full sections are timed, and reduced ones of each number of `coordinates`, elastic modes of each
    section, compiled and in Exudyn, over the whole time span from where they start.

    Figures, for each scene: ``<scene>.seconds.<approach>`` (median) and ratios of these, of booms with the number
    behind the approach and ``full_over_reduced.<r>``, ``exudyn_over_march.<r>``; ``span``, the longest time span, in s.
    """

    kind: Literal["speed"] = Field(description="Kind of study")
    scenes: Annotated[tuple[Path, ...], Field(min_length=1)] = Field(description="Scenes that are computed")
    repeats: Count = Field(default=5, description="Repetitions of each simulation; the median time is reported")
    share: dict[str, Share] = Field(default={}, description="Part of the time span that is simulated, by approach")
    coordinates: Annotated[tuple[Count, ...], Field(min_length=1)] = Field(
        default=(2, 4, 8), description="Numbers of elastic modes of each section of a boom"
    )

    def plan(self) -> Plan:
        unknown = sorted(set(self.share) - set(APPROACHES))
        if unknown:
            allowed = f"one of {', '.join(APPROACHES)} is allowed"
            raise InputError("study", f"share.{unknown[0]}", self.share[unknown[0]], allowed)
        runs, common = list[Task](), dict[str, Task]()
        for file in self.scenes:
            if boom := subjects.boom(file):
                runs += self._of_sections(boom, file.stem)
                continue
            scene = scenes.beam_scene(file)
            _check(scene, file)
            modes = shared.modes_tasks(scene)
            common |= {task.key: task for task in modes.values()}
            for name, approach in APPROACHES.items():
                share = self.share.get(name, 1.0)
                arguments = shared.scene_arguments(scene) | {"approach": name, "repeats": self.repeats, "share": share}
                needs = {key: task.key for key, task in modes.items()} if approach.model == "reduced" else {}
                parameters = {"scene": file.stem, "approach": name}
                cost = approach.cost * share * self.repeats / 5.0
                runs.append(Task(key_of(f"{file.stem}-{name}"), timed, arguments, needs, parameters, cost, alone=True))
        return Plan(tuple(runs), tuple(common.values()))

    def _of_sections(self, boom: Scene, name: str) -> Iterator[Task]:
        largest, known = booms.reduced_to(boom, max(self.coordinates)), {"repeats": self.repeats}
        for approach, cost in OF_SECTIONS.items():
            for modes in (0,) if approach.startswith("full") else self.coordinates:
                called = f"{approach}-{modes}" if modes else approach
                parameters: dict[str, Scalar] = {"scene": name, "approach": called}
                asked = known | {"simulator": approach.partition("-")[2], "modes": modes}
                one = sections.task(f"{name}-{called}", sections.timed, largest, parameters, {}, **asked)
                yield replace(one, cost=cost, alone=True)

    def figures(self, results: StudyResults) -> dict[str, Scalar]:
        found: dict[str, Scalar] = {"span": max(scenes.load_any(file).time.end for file in self.scenes)}
        for file in self.scenes:
            runs = [run for run in results.runs if run.parameters["scene"] == file.stem]
            median = {str(run.parameters["approach"]): statistics.median(_repeats(run)) for run in runs}
            found |= {f"{file.stem}.seconds.{name}": seconds for name, seconds in median.items()}
            ratios = RATIOS | _ratios_of_sections(self.coordinates)
            ratios = {name: both for name, both in ratios.items() if set(both) <= set(median)}
            found |= {f"{file.stem}.{name}": median[a] / median[b] for name, (a, b) in ratios.items()}
        return found


def _ratios_of_sections(sizes: Sequence[int]) -> dict[str, tuple[str, str]]:
    """As `RATIOS`, of booms."""
    pairs = {
        "full_over_reduced": ("full-march", "reduced-march-{}"),
        "exudyn_over_march": ("reduced-exudyn-{}", "reduced-march-{}"),
    }
    return {f"{name}.{r}": (one.format(r), other.format(r)) for name, (one, other) in pairs.items() for r in sizes}


def _check(scene: Scene, file: Path) -> None:
    """Refuse, by InputError, a scene that one of the approaches can't take."""
    if scene.reduction.flexibility:
        allowed = "scenes with reduction.flexibility = false are allowed: callbacks know no rows that give way"
        raise InputError("study", "scenes", file.name, allowed)
    if scene.body.profile is None or scene.body.profile.axial_stiffness is None:
        raise InputError("study", "scenes", file.name, "scenes with body.profile.axial_stiffness are allowed, for ANCF")


def timed(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: seconds ``repeat1``, ``repeat2``, ... of the solver for the whole time span; ``coordinates``, ``steps``.

    `share` is the part that is simulated.  A run of ten steps goes before, so that nothing is loaded or compiled
    while the clock runs.
    """
    scene, approach = shared.scene_of(arguments), APPROACHES[arguments["approach"]]
    stretches = stretches_of(scene, arguments["share"])
    solve, coordinates = _solver(scene, approach, needs)
    solve(Stretch(0.0, min(10, scene.time.steps)))
    steps = sum(stretch.steps for stretch in stretches)
    scale = scene.time.steps / steps
    seconds = {f"repeat{k + 1}": scale * sum(map(solve, stretches)) for k in range(arguments["repeats"])}
    return TaskResult({"coordinates": coordinates, "steps": steps, "share": arguments["share"]}, seconds=seconds)


@dataclass(frozen=True)
class Stretch:
    """A part of the time span: where it begins in s, and its number of steps."""

    begin: float
    steps: int


def stretches_of(scene: Scene, share: float) -> list[Stretch]:
    """The whole span, or stretches of it that make up a share, each in the middle of an equal part."""
    if share == 1.0:
        return [Stretch(0.0, scene.time.steps)]
    steps = max(1, round(share * scene.time.steps / STRETCHES))
    part = scene.time.end / STRETCHES
    return [Stretch((k + 0.5) * part - 0.5 * steps * scene.time.step, steps) for k in range(STRETCHES)]


class Later(SignalBase):
    """A signal from some time on: value(t) is that of the other one at t + begin."""

    signal: SignalBase
    begin: float

    def value(self, t: ArrayLike) -> Array:
        return self.signal.value(np.asarray(t) + self.begin)

    def rate(self, t: ArrayLike) -> Array:
        return self.signal.rate(np.asarray(t) + self.begin)


def _repeats(run: RunRecord) -> list[float]:
    return [seconds for name, seconds in run.seconds.items() if name.startswith("repeat")]


def _solver(
    scene: Scene, approach: Approach, needs: Mapping[str, TaskResult]
) -> tuple[Callable[[Stretch], float], int]:
    """What simulates a stretch from rest and returns the solver's seconds, and the number of coordinates."""
    from pmr.reduction.bodies import reduce_with

    whole = Excitation.of(scene)

    def during(stretch: Stretch) -> Excitation:
        paths, loads = (
            {name: Later(signal=signal, begin=stretch.begin) for name, signal in signals.items()}
            for signals in (whole.paths, whole.loads)
        )
        return Excitation(paths, loads, replace(whole.stepping, end=stretch.steps * scene.time.step))

    if approach.simulate is None:
        tip = [scene.alone.length]
        coordinates = COORDINATES_PER_NODE * (scene.compare.ancf_elements + 1)
        return lambda stretch: simulate_cable(scene, tip, during(stretch)).seconds, coordinates
    simulate = approach.simulate
    if approach.model == "reduced":
        body: SlidingBody = reduce_with(scene, shared.model_of(scene), shared.snapshots_from(scene, needs)).model
    else:
        full = shared.body_of(scene)
        body = full if approach.model == "full" else projected(full, np.eye(full.size))  # dense, as the paper's
    return lambda stretch: simulate(System.of(body), during(stretch)).seconds, body.size
