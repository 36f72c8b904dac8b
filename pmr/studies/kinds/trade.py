"""Accuracy against time: bases and sizes, steps, meshes, and what each costs online and offline.

Methods are those of `pmr.studies.bases`, and

visited
    POD of eigenmodes with the slider held at nine positions that the path visits.

Axial coordinates, which nothing excites, are left out of planar beams, for all methods alike.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pmr import scene as scenes
from pmr.compare.errors import relative_error
from pmr.compare.responses import respond
from pmr.compare.summary import warnings_of_response
from pmr.errors import InputError, SimulationError
from pmr.scene import Scene
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.modal import modal_form
from pmr.studies import bases, booms, sections, shared, subjects
from pmr.studies.bases import observe, scale_step
from pmr.studies.engine.task import Plan, Scalar, Task, TaskResult, key_of
from pmr.studies.results import StudyResults
from pmr.studies.study import Count, StudyBase
from pmr.studies.tolerances import TOLERANCES, coarsest_within
from pmr.system.body import length_outputs
from pmr.system.system import System

Array = NDArray[np.float64]
Method = Literal["pod", "visited", "modes", "flexibility", "trajectory"]
METHODS: tuple[Method, ...] = get_args(Method)
#: The reference's step, as a share of the smallest one that is tried.
FINER = 0.25
#: Simulations of which the fastest counts.
REPEATS = 3
#: Free modes with their flexibility, as good as all: what steps and meshes are tried on.
MANY = 20


class Study(StudyBase):
    """Each of `scenes` with each of `methods`, of `coordinates` and with the scene's step times each of `steps`.

    Beside that, for each scene, spectral radii and for planar beams numbers of elements.  Of booms of sections the
    methods are ``modes`` and ``flexibility`` alone, and `coordinates` elastic modes of each section.

    Figures: ``<scene>.<method>.<tolerance>``, as ``"6 x 0.5"``: the fewest coordinates that hold the tolerance with any
    of the steps, and the longest one with which they do, as a multiple of the scene's.
    """

    kind: Literal["trade"]
    scenes: Annotated[tuple[Path, ...], Field(min_length=1)]
    methods: tuple[Method, ...] = METHODS
    coordinates: Annotated[tuple[Count, ...], Field(min_length=1)] = (2, 3, 4, 5, 6, 8, 10, 12, 16, 20)
    steps: Annotated[tuple[float, ...], Field(min_length=1)] = (4.0, 2.0, 1.0, 0.5, 0.25, 0.125, 0.0625)
    radii: tuple[float, ...] = (0.0, 0.5, 0.8, 0.9, 1.0)
    elements: tuple[Count, ...] = (4, 8, 16, 32, 64)

    def plan(self) -> Plan:
        runs, truths = [], []
        for file in self.scenes:
            if boom := subjects.boom(file):
                self._check_steps(boom.time.steps)
                truth, of_sections = self._of_sections(boom, file.stem)
                truths.append(truth)
                runs += of_sections
                continue
            scene = without_axial(scenes.load(file))
            self._check_steps(scene.time.steps)
            common = shared.scene_arguments(scene) | {"steps": sorted(self.steps, reverse=True)}
            truth = Task(key_of(f"truth-{file.stem}-{common['hash']}"), reference, common, cost=5.0)
            truths.append(truth)
            for method in self.methods:
                reduced = scene.model_copy(update={"reduction": bases.reduction(scene, method, max(self.coordinates))})
                arguments = common | shared.scene_arguments(reduced)
                arguments |= {"method": method, "coordinates": sorted(self.coordinates)}
                needs, parameters = {"truth": truth.key}, {"scene": file.stem, "method": method}
                runs.append(Task(key_of(f"{file.stem},{method}"), errors, arguments, needs, parameters, cost=5.0))
            arguments = common | {"radii": list(self.radii)}
            parameters = {"scene": file.stem, "method": "radii"}
            runs.append(Task(key_of(f"{file.stem},radii"), dissipated, arguments, {"truth": truth.key}, parameters))
            if scene.body.profile is not None and scene.mesh.file is None:
                arguments, parameters = common | {"elements": list(self.elements)}, parameters | {"method": "elements"}
                runs.append(Task(key_of(f"{file.stem},elements"), meshed, arguments, {"truth": truth.key}, parameters))
        return Plan(tuple(runs), tuple(truths))

    def _check_steps(self, count: int) -> None:
        ratios = [count / max(self.steps), *(max(self.steps) / factor for factor in self.steps)]
        if any(ratio != round(ratio) for ratio in ratios) or 1.0 not in self.steps:
            allowed = f"1 and factors that divide the largest, and that one the {count} steps, are allowed"
            raise InputError("study", "steps", list(self.steps), allowed)

    def _of_sections(self, boom: Scene, name: str) -> tuple[Task, list[Task]]:
        """The reference of a boom, and a run of each method that sections have."""
        steps, largest = sorted(self.steps, reverse=True), booms.reduced_to(boom, max(self.coordinates))
        truth = sections.task(f"truth-{name}-{boom.hash}", sections.finest, boom, {}, {}, steps=steps)
        runs = []
        for method in (basis for basis in self.methods if basis in sections.BASES):
            more = {"steps": steps, "basis": method, "coordinates": sorted(self.coordinates)}
            parameters, needs = {"scene": name, "method": method}, {"truth": truth.key}
            runs.append(
                sections.task(f"{name},{method}", sections.by_size_and_step, largest, parameters, needs, **more)
            )
        return truth, runs

    def figures(self, results: StudyResults) -> dict[str, Scalar]:
        record: dict[str, Scalar] = {}
        for run in results.runs:
            scene, method = run.parameters["scene"], run.parameters["method"]
            for tolerance in TOLERANCES if method in self.methods else ():
                best = coarsest_within(run.figures, tolerance)
                record[f"{scene}.{method}.{tolerance:g}"] = None if best is None else f"{best[0]} x {best[1]:g}"
        return record


def without_axial(scene: Scene) -> Scene:
    """A planar beam without coordinates along its axis; any other scene as it is."""
    if scene.body.profile is None:
        return scene
    profile = scene.body.profile.model_copy(update={"axial": False})
    return scene.model_copy(update={"body": scene.body.model_copy(update={"profile": profile})})


def reference(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``y`` (T, o) in m, the full model's motion with a step `FINER` than all that are tried.

    Figures: ``step``, what its own step is off by, as a fraction.  Warnings are those of a run with the scene's step.
    """
    scene, steps = shared.scene_of(arguments), arguments["steps"]
    form, excitation, finest = modal_form(shared.body_of(scene)), Excitation.of(scene), FINER * steps[-1]
    coarser, y = (
        observe(form, scale_step(excitation, factor * finest), round(steps[0] / (factor * finest)))
        for factor in (2.0, 1.0)
    )
    case = bases.Case.of(scene)
    system = System.of(case.full)
    lines = warnings_of_response(scene, system, respond(system, case.run))
    return TaskResult({"step": relative_error(coarser, y) / 3.0}, {"y": y}, warnings=lines)


def errors(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: a method's errors.

    Figures: ``total.<r>.<factor>``, e_NRMS of all displacements against the reference with the scene's step times a
    factor; ``reduction.<r>``, the same against the full model with the scene's own step; ``energy.<r>``, the largest
    difference to that one's energy while the slider moves, over its largest energy; ``reference``, what the reference's
    step is off by; ``scene step`` in s and the number of ``steps``.  None where no model can be simulated.
    Seconds: ``offline``, of the processor, ``step.<r>`` and ``full``, of one step.
    """
    scene, truth = shared.scene_of(arguments), needs["truth"]
    case = bases.Case.of(scene)
    begin = time.process_time()
    models = bases.MODELS[arguments["method"]](case)
    tried = [
        (r, bases.simulator(models.of(r))) for r in arguments["coordinates"] if models.smallest <= r <= models.largest
    ]
    seconds = {"offline": time.process_time() - begin, "full": case.run.seconds / scene.time.steps}
    stored = case.run.energy
    moving = np.abs(case.excitation.path_rate) > 0.0
    record: dict[str, Scalar] = {"reference": truth.record["step"]}
    record |= {"scene step": scene.time.step, "steps": scene.time.steps}
    for r, simulate in tried:
        names = [f"total.{r}.{factor:g}" for factor in arguments["steps"]]
        record |= dict.fromkeys((*names, f"reduction.{r}", f"energy.{r}"))
        for factor, name in zip(arguments["steps"], names, strict=True):
            every = round(arguments["steps"][0] / factor)
            try:
                motion = simulate(scale_step(case.excitation, factor), every)
                record[name] = relative_error(motion.displacement, truth.arrays["y"])
            except (SimulationError, InputError):
                continue
        try:
            runs = [simulate(case.excitation, 1) for _ in range(REPEATS)]
        except (SimulationError, InputError):
            continue
        seconds[f"step.{r}"] = min(run.seconds for run in runs) / scene.time.steps
        record[f"reduction.{r}"] = relative_error(runs[0].displacement, case.displacement[:, length_outputs(case.full)])
        off = np.abs(runs[0].energy - stored)[moving].max(initial=0.0)
        record[f"energy.{r}"] = float(min(off / stored.max(), 1e3))
    return TaskResult(record, seconds=seconds, warnings=truth.warnings)


def dissipated(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``rho.<radius>.<factor>``, e_NRMS of many free modes with other spectral radii, against the reference."""
    scene, truth = shared.scene_of(arguments), needs["truth"].arrays["y"]
    form, excitation, record = modal_form(_many(scene)), Excitation.of(scene), dict[str, Scalar]()
    for radius in arguments["radii"]:
        for factor in arguments["steps"]:
            stepping = TimeStepping(excitation.stepping.end, excitation.stepping.step * factor, radius)
            y = observe(form, excitation.with_stepping(stepping), round(arguments["steps"][0] / factor))
            record[f"rho.{radius:g}.{factor:g}"] = relative_error(y, truth)
    return TaskResult(record, warnings=needs["truth"].warnings)


def meshed(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``tip.<elements>``, e_NRMS of the tip, many free modes, against twice the largest number of elements.

    None where a mesh is too coarse for a model, as with two sliders within one element.
    """
    scene = shared.scene_of(arguments)

    def tip(count: int) -> Array:
        finer = scene.model_copy(update={"mesh": scene.mesh.model_copy(update={"elements": count})})
        return observe(modal_form(_many(finer)), Excitation.of(finer), 1)[:, -1:]

    finest, record = tip(2 * max(arguments["elements"])), dict[str, Scalar]()
    for count in arguments["elements"]:
        try:
            record[f"tip.{count}"] = relative_error(tip(count), finest)
        except InputError:
            record[f"tip.{count}"] = None
    return TaskResult(record, warnings=needs["truth"].warnings)


def _many(scene: Scene) -> Any:
    from pmr.pipeline import reduce

    size = 2 * (scene.mesh.elements + 1) if scene.body.profile is not None else 10 * MANY
    update = {"reduction": bases.reduction(scene, "flexibility", min(MANY, size // 2))}
    return reduce(scene.model_copy(update=update)).reduced
