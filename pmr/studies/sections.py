"""Tasks of studies on booms: full models on several meshes; models of several sizes and steps beside the full one.

What counts is the number of elastic modes of each section, rigid-body motions and modes of cylinders come on top.
Motions begin in static equilibrium.  Where pads push, models take the parts of a step that the full one took.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare import errors as compare
from pmr.compare.accuracy.family import Family
from pmr.compare.accuracy.order import family_of
from pmr.compare.booms import respond
from pmr.compare.estimate import estimate, no_estimate
from pmr.compare.runs import in_parts, run_from_start
from pmr.errors import InputError, SimulationError
from pmr.reduced.attachment import with_cylinder_modes
from pmr.reduced.model import ReducedModel
from pmr.results import Response
from pmr.scene import Scene
from pmr.simulation import Excitation, TimeStepping
from pmr.studies.engine.task import Scalar, Task, TaskFunction, TaskResult, key_of
from pmr.studies.figures import boom_arguments
from pmr.system.from_scene import contacts_of, system_of
from pmr.system.system import System, SystemTrajectory

Array = NDArray[np.float64]

#: Bases that sections may have: free modes, without the flexibility of those left out or with it.
BASES = ("modes", "flexibility")
#: Rigid-body motions of a section, at most; simulations of which the fastest counts; the reference's step.
RIGID, REPEATS, FINER = 6, 3, 0.25


def meshed(boom: Scene, count: int) -> Scene:
    """With so many elements in every section, and the full model alone."""
    return _with(boom, "mesh", {"elements": count})


def reduced_to(boom: Scene, modes: int) -> Scene:
    """With free modes for so many elastic ones in every section."""
    asked = {"coordinates": RIGID + modes, "flexibility": True, "estimate": True}
    return _with(boom, "reduction", asked)


def _with(boom: Scene, table: str, changes: Mapping[str, Any]) -> Scene:
    """With changes in a table of every section, and nothing to be searched."""
    tables = [getattr(part, table).model_copy(update=changes) for part in boom.sections]
    parts = tuple(part.model_copy(update={table: one}) for part, one in zip(boom.sections, tables, strict=True))
    return boom.model_copy(update={"sections": parts, "accuracy": None, "budget": None})


def task(
    name: str,
    function: TaskFunction,
    boom: Scene,
    parameters: Mapping[str, Scalar],
    needs: Mapping[str, str],
    **more: Any,
) -> Task:
    """A run on a boom, with further arguments."""
    return Task(key_of(name), function, boom_arguments(boom) | more, dict(needs), dict(parameters), cost=5.0)


def full_tip(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``coordinates``, ``e_abs`` (m) and ``e_nrms`` of the full boom's tip; array ``tip`` (T, d) in m."""
    case = Case.of(Scene.model_validate(arguments["boom"]))
    y = case.response.of("tip", body=case.boom.names[-1])
    size = sum(body.size for body in case.full.bodies.values())
    record: dict[str, Scalar] = {"coordinates": size, "e_abs": None, "e_nrms": None}
    if "finest" in needs:
        finest = needs["finest"].arrays["tip"]
        record |= {"e_abs": compare.absolute_error(y, finest), "e_nrms": compare.nrms(y, finest)}
    return TaskResult(record, {"tip": y})


def by_size(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``beam.<r>`` and ``force.<r>`` (e_NRMS) by elastic modes a section, ``estimate.<r>`` where there is one.

    None where there is no model.  Seconds: ``simulate.<r>``, of the solver alone, and ``full``.
    """
    case, record = Case.of(Scene.model_validate(arguments["boom"])), dict[str, Scalar]()
    seconds, family = {"full": case.run.seconds}, case.family()
    for r in arguments["coordinates"]:
        names = (f"beam.{r}", f"force.{r}", f"estimate.{r}")
        record |= dict.fromkeys(names)
        if r > family.most:
            continue
        modal, system = case.models(family, r, arguments["basis"])
        try:
            runs = [run_from_start(system, case.excitation) for _ in range(REPEATS)]
        except (SimulationError, InputError):
            continue
        seconds[f"simulate.{r}"], found = min(run.seconds for run in runs), respond(system, runs[0])
        record[names[0]] = compare.nrms(found.displacement, case.response.displacement)
        both = compare.with_common_forces(found, case.response)
        record[names[1]] = compare.nrms(both[0].slider_force, both[1].slider_force)
        if no_estimate(modal) is None:
            record[names[2]] = estimate(modal, system, case.excitation, runs[0]).of("beam")
    return TaskResult(record, seconds=seconds)


def finest(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``y`` (T, o) in m, the full boom's motion with a step `FINER` than all; ``step``, what that is off by."""
    case, steps = Case.of(Scene.model_validate(arguments["boom"])), arguments["steps"]
    least = FINER * steps[-1]
    coarser, y = (case.full_at(factor * least, round(steps[0] / (factor * least))) for factor in (2.0, 1.0))
    return TaskResult({"step": compare.nrms(coarser, y) / 3.0}, {"y": y})


def by_size_and_step(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``total.<r>.<factor>``, ``reduction.<r>``; seconds ``offline``, ``step.<r>``, ``full``: as of one body."""
    case, truth = Case.of(Scene.model_validate(arguments["boom"])), needs["truth"]
    begin = time.process_time()
    family = case.family()
    seconds = {"offline": time.process_time() - begin, "full": case.run.seconds / case.boom.time.steps}
    record: dict[str, Scalar] = {"reference": truth.record["step"]}
    record |= {"scene step": case.boom.time.step, "steps": case.boom.time.steps}
    for r in [one for one in arguments["coordinates"] if one <= family.most]:
        names = [f"total.{r}.{factor:g}" for factor in arguments["steps"]]
        record |= dict.fromkeys((*names, f"reduction.{r}"))
        _, system = case.models(family, r, arguments["basis"])
        for factor, name in zip(arguments["steps"], names, strict=True):
            try:
                y = case.at(system, factor, round(arguments["steps"][0] / factor))
            except (SimulationError, InputError):
                continue
            record[name] = compare.nrms(y, truth.arrays["y"])
        try:
            runs = [run_from_start(system, case.excitation) for _ in range(REPEATS)]
        except (SimulationError, InputError):
            continue
        seconds[f"step.{r}"] = min(run.seconds for run in runs) / case.boom.time.steps
        record[f"reduction.{r}"] = compare.nrms(respond(system, runs[0]).displacement, case.response.displacement)
    return TaskResult(record, seconds=seconds)


@dataclass(frozen=True)
class Case:
    """A boom, its full models as one system, the motion of that, and what drives it, in the parts of a step it took."""

    boom: Scene
    built: Mapping[str, Any]
    full: System
    excitation: Excitation
    run: SystemTrajectory
    response: Response

    @classmethod
    def of(cls, boom: Scene) -> Case:
        from pmr.fullmodel.build import build_bodies
        from pmr.fullmodel.system import FullSystem

        built = build_bodies(boom)
        models = {name: one.model for name, one in built.items()}
        full = FullSystem(models, contacts_of(boom, models)).gather()
        assert full is not None  # a task runs on one rank
        excitation = in_parts(full, Excitation.of(boom))
        run = run_from_start(full, excitation)
        return cls(boom, built, full, excitation, run, respond(full, run))

    def family(self) -> Family:
        """The reduced models of the sections, of all sizes."""
        from pmr.reduction.bodies import reduce_bodies

        reduced = {name: one.modal for name, one in reduce_bodies(self.boom, self.built).items()}
        return family_of(self.boom, reduced)

    def models(self, family: Family, modes: int, basis: str) -> tuple[dict[str, ReducedModel], System]:
        """Of so many elastic modes a section: on free modes, and as they are simulated."""
        modal = family.models(family.member(modes))
        if basis == "modes":
            modal = {name: _stiff(model) for name, model in modal.items()}
        return modal, system_of(self.boom, {name: with_cylinder_modes(model) for name, model in modal.items()})

    def at(self, system: System, factor: float, every: int) -> Array:
        """Displacements (T, o) in m of a system with a step that is so many times as long."""
        stepping = _stepping(self.boom)
        excitation = Excitation.of(self.boom).on_grid(replace(stepping, step=factor * stepping.step))
        return respond(system, run_from_start(system, excitation).at(slice(None, None, every))).displacement

    def full_at(self, factor: float, every: int) -> Array:
        """The same of the full models."""
        return self.at(self.full, factor, every)


def _stepping(boom: Scene) -> TimeStepping:
    return TimeStepping(boom.time.end, boom.time.step, boom.time.rho_inf)


def _stiff(model: ReducedModel) -> ReducedModel:
    """Without the flexibility of the modes that are left out."""
    assert model.carriers is not None  # as section models have
    carriers = replace(model.carriers, flexibility=None, inertia=None, answers=None)
    return replace(model, flexibility=None, enrichment=None, carriers=carriers)
