"""Accuracy against processor time, online and offline, of bases, model sizes, time steps and meshes.

Methods are the bases of `pmr.studies.motions.model_family`, and

trajectory
    POD of the full model's own motion.

Axial coordinates, which no load excites, are left out of planar beams in all methods alike.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import Field

from pmr import scene as scenes
from pmr.compare.errors import relative_error
from pmr.compare.evaluation import evaluate_motion
from pmr.compare.outputs import run_from_start
from pmr.compare.summary import warnings_of_response
from pmr.errors import InputError, SimulationError
from pmr.files.arrays import Array
from pmr.scene import Scene
from pmr.studies import shared
from pmr.studies.motions import SECTION_BASES, FullMotion, model_family, pod_family, simulate_displacement, with_basis
from pmr.studies.results import StudyResults
from pmr.studies.study import Count, StudyBase
from pmr.studies.tasks import Arguments, Needs, Plan, Scalar, Task, TaskFunction, TaskResult, cell_number, task_key
from pmr.system.system import System

#: Tolerances of e_NRMS, the normalised root mean square error, of the displacements along the body.
TOLERANCES = (0.05, 0.01, 0.001, 0.0001)


def trade_points(figures: Mapping[str, Scalar]) -> list[tuple[int, float, float]]:
    """Return (coordinates, step as a multiple of the scene's step, error) of each simulated model among `figures`."""
    split = [(name.split("."), value) for name, value in figures.items() if name.startswith("total.")]
    return [(int(part[1]), float(".".join(part[2:])), cell_number(value)) for part, value in split if value is not None]


def coarsest_within(figures: Mapping[str, Scalar], tolerance: float) -> tuple[int, float] | None:
    """Return the fewest coordinates that hold a `tolerance`, and the longest step with which they do; None if none do.

    Steps are multiples of the scene's step.  All shorter steps in `figures` have to hold the tolerance, too, so that
    errors of model and step that happen to cancel are not counted as accuracy.
    """
    for r in sorted({r for r, _, _ in trade_points(figures)}):
        longest = None
        for _, h, error in sorted(point for point in trade_points(figures) if point[0] == r):
            if error > tolerance:
                break
            longest = h
        if longest is not None:
            return r, longest
    return None


Method = Literal["pod", "visited", "modes", "flexibility", "trajectory"]
METHODS: tuple[Method, ...] = get_args(Method)
#: The reference's step, as a share of the smallest step that is tried.
FINER = 0.25
#: Number of simulations with which a time is measured; the shortest time is taken.
REPEATS = 3
#: Number of free modes in trials of steps and meshes, with which the model's own error is negligible.
MANY = 20


class Study(StudyBase):
    """Each of `scenes` with each of `methods`, numbers of `coordinates`, and the scene's step times each of `steps`.

    Each scene of a single body is also simulated with the spectral radii `radii`, and a planar beam with numbers of
    `elements`.  For booms of sections the methods are ``modes`` and ``flexibility`` alone, and `coordinates` are
    numbers of elastic modes of each section.

    Figures: ``<scene>.<method>.<tolerance>``, such as ``"6 x 0.5"``: the fewest coordinates that hold the tolerance
    with any of the steps, and the longest step with which they do, as a multiple of the scene's.
    """

    kind: Literal["trade"]
    scenes: Annotated[tuple[Path, ...], Field(min_length=1)]
    methods: tuple[Method, ...] = METHODS
    coordinates: Annotated[tuple[Count, ...], Field(min_length=1)] = (2, 3, 4, 5, 6, 8, 10, 12, 16, 20)
    steps: Annotated[tuple[float, ...], Field(min_length=1)] = (4.0, 2.0, 1.0, 0.5, 0.25, 0.125, 0.0625)
    radii: tuple[float, ...] = (0.0, 0.5, 0.8, 0.9, 1.0)
    elements: tuple[Count, ...] = (4, 8, 16, 32, 64)

    def plan(self) -> Plan:
        """Return a task for each scene and method, radii or elements, and a reference for each scene."""
        runs, truths = [], []
        for file in self.scenes:
            scene, name = without_axial(scenes.load_any(file)).model_copy(update={"recovery": None}), file.stem
            is_alone = len(scene.sections) == 1
            shared.refuse_second_order(scene)
            self._check_steps(scene.time.steps)
            common = shared.scene_arguments(scene) | {"steps": sorted(self.steps, reverse=True)}
            truth = Task(task_key(f"truth-{name}-{common['hash']}"), simulate_reference, common, cost=5.0)
            truths.append(truth)
            tasks = list[tuple[str, TaskFunction, Mapping[str, Any]]]()
            for method in self.methods if is_alone else [basis for basis in self.methods if basis in SECTION_BASES]:
                reduced = shared.scene_arguments(with_basis(scene, method, max(self.coordinates)))
                sizes = {"method": method, "coordinates": sorted(self.coordinates)}
                tasks.append((method, errors_of_method, common | reduced | sizes))
            if is_alone:
                tasks.append(("radii", errors_of_radii, common | {"radii": list(self.radii)}))
            if is_alone and scene.body.profile is not None and scene.mesh.file is None:
                tasks.append(("elements", errors_of_meshes, common | {"elements": list(self.elements)}))
            for of, function, arguments in tasks:
                parameters, cost = {"scene": name, "method": of}, 5.0 if function is errors_of_method else 1.0
                key, needs = task_key(f"{name},{of}"), {"truth": truth.key}
                runs.append(Task(key, function, arguments, needs, parameters, cost))
        return Plan(tuple(runs), tuple(truths))

    def _check_steps(self, count: int) -> None:
        """Refuse `steps` that lack 1, that don't divide the largest step, or a largest that doesn't divide `count`."""
        ratios = [count / max(self.steps), *(max(self.steps) / factor for factor in self.steps)]
        if any(ratio != round(ratio) for ratio in ratios) or 1.0 not in self.steps:
            allowed = f"1 and factors that divide the largest, and that one the {count} steps, are allowed"
            raise InputError("study", "steps", list(self.steps), allowed)

    def figures(self, results: StudyResults) -> dict[str, Scalar]:
        """Return ``<scene>.<method>.<tolerance>`` as the class describes it; the value is None if no model holds it."""
        record: dict[str, Scalar] = {}
        for run in results.runs:
            scene, method = run.parameters["scene"], run.parameters["method"]
            for tolerance in TOLERANCES if method in self.methods else ():
                best = coarsest_within(run.figures, tolerance)
                record[f"{scene}.{method}.{tolerance:g}"] = None if best is None else f"{best[0]} x {best[1]:g}"
        return record


def without_axial(scene: Scene) -> Scene:
    """Return the scene of a planar beam without coordinates along its axis; any other scene unchanged."""
    if len(scene.sections) > 1 or scene.body.profile is None:
        return scene
    profile = scene.body.profile.model_copy(update={"axial": False})
    return scene.model_copy(update={"body": scene.body.model_copy(update={"profile": profile})})


def simulate_reference(arguments: Arguments, needs: Needs) -> TaskResult:
    """Task: compute the full model's displacements ``y`` (T, o) in m with the smallest step tried times `FINER` (< 1).

    The record has the estimated relative error by this step, under the key ``step``.  The task's warnings
    are those of a run with the scene's step.
    """
    case, steps = FullMotion.simulate(shared.scene_of(arguments)), arguments["steps"]
    finest = FINER * steps[-1]
    coarser, y = (
        simulate_displacement(case.scene, case.full, factor * finest, round(steps[0] / (factor * finest)))
        for factor in (2.0, 1.0)
    )
    lines = warnings_of_response(case.scene, case.full, case.response)
    return TaskResult({"step": relative_error(coarser, y) / 3.0}, {"y": y}, warnings=lines)


def errors_of_method(arguments: Arguments, needs: Needs) -> TaskResult:
    """Task: compute errors and times of a method with r coordinates, for all r of the study that the basis can have.

    Record, None where a model can't be simulated:

    - ``total.<r>.<factor>``: e_NRMS of all displacements against the reference, with the scene's step times a factor.
    - ``reduction.<r>``: e_NRMS of all displacements against the full model, both with the scene's step.
    - ``energy.<r>``, for a single body: the largest difference from the full model's energy while the slider moves,
      over the largest energy of the full model; 1000 at most.
    - ``reference``: the error of the reference's step; ``scene step`` in s, and the number of ``steps``.

    Seconds: ``offline``, processor time to make all models; ``step.<r>`` and ``full``, time of one step.
    """
    case, truth, method = FullMotion.simulate(shared.scene_of(arguments)), needs["truth"], arguments["method"]
    scene, steps, is_alone = case.scene, case.scene.time.steps, len(case.scene.sections) == 1
    begin = time.process_time()
    of_basis = pod_family(case) if method == "trajectory" else model_family(scene, method)
    sizes = [r for r in arguments["coordinates"] if of_basis.smallest <= r <= of_basis.largest]
    systems = {r: of_basis.system_of_size(r) for r in sizes}
    seconds = {"offline": time.process_time() - begin, "full": case.run.seconds / steps}
    record: dict[str, Scalar] = {"reference": truth.record["step"], "scene step": scene.time.step, "steps": steps}
    for r, system in systems.items():
        names = [f"total.{r}.{factor:g}" for factor in arguments["steps"]]
        record |= dict.fromkeys((*names, f"reduction.{r}", *([f"energy.{r}"] if is_alone else [])))
        for factor, name in zip(arguments["steps"], names, strict=True):
            try:
                y = simulate_displacement(scene, system, factor, round(arguments["steps"][0] / factor))
            except (SimulationError, InputError):
                continue
            record[name] = relative_error(y, truth.arrays["y"])
        try:
            runs = [run_from_start(system, case.excitation) for _ in range(REPEATS)]
        except (SimulationError, InputError):
            continue
        seconds[f"step.{r}"] = min(run.seconds for run in runs) / steps
        record[f"reduction.{r}"] = relative_error(
            evaluate_motion(system, runs[0]).displacement, case.response.displacement
        )
        if is_alone:
            moving = np.abs(case.excitation.path_rate) > 0.0
            off = np.abs(runs[0].energy - case.run.energy)[moving].max(initial=0.0)
            record[f"energy.{r}"] = float(min(off / case.run.energy.max(), 1e3))
    return TaskResult(record, seconds=seconds, warnings=truth.warnings)


def errors_of_radii(arguments: Arguments, needs: Needs) -> TaskResult:
    """Task: compute ``rho.<radius>.<factor>``, e_NRMS against the reference for spectral radii and step factors.

    The model has many free modes, so that its own error is small.
    """
    scene, truth, steps = shared.scene_of(arguments), needs["truth"].arrays["y"], arguments["steps"]
    system, record = _system_of_many_modes(scene), dict[str, Scalar]()
    for radius in arguments["radii"]:
        for factor in steps:
            y = simulate_displacement(scene, system, factor, round(steps[0] / factor), rho_inf=radius)
            record[f"rho.{radius:g}.{factor:g}"] = relative_error(y, truth)
    return TaskResult(record, warnings=needs["truth"].warnings)


def errors_of_meshes(arguments: Arguments, needs: Needs) -> TaskResult:
    """Task: compute ``tip.<elements>``, e_NRMS of the tip against a mesh of twice the largest number of elements.

    Models have many free modes.  The value is None where a mesh is too coarse for a model, as with two sliders within
    one element.
    """
    scene = shared.scene_of(arguments)

    def tip(count: int) -> Array:
        """Return the tip's displacement (T, 1) in m with `count` elements."""
        finer = scene.model_copy(update={"mesh": scene.mesh.model_copy(update={"elements": count})})
        return simulate_displacement(finer, _system_of_many_modes(finer), 1.0, 1)[:, -1:]

    finest, record = tip(2 * max(arguments["elements"])), dict[str, Scalar]()
    for count in arguments["elements"]:
        try:
            record[f"tip.{count}"] = relative_error(tip(count), finest)
        except InputError:
            record[f"tip.{count}"] = None
    return TaskResult(record, warnings=needs["truth"].warnings)


def _system_of_many_modes(scene: Scene) -> System:
    """Return a body's model with `MANY` free modes, or all of a coarse beam, and the flexibility of the other modes."""
    from pmr.pipeline import reduce

    size = 2 * (scene.mesh.elements + 1) if scene.body.profile is not None else 10 * MANY
    return System.of(reduce(with_basis(scene, "flexibility", min(MANY, size // 2))).reduced)
