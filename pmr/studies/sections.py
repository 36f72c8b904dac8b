"""Tasks of studies on booms: full models on several meshes; models of several sizes and steps beside the full one.

What counts is the number of elastic modes of each section, rigid-body motions and modes of cylinders come on top.
Motions begin in static equilibrium.  Where pads push, models take the parts of a step that the full one took.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare import errors as compare
from pmr.compare import summary
from pmr.compare.booms import quantities
from pmr.compare.estimate import estimate, no_estimate
from pmr.compare.evaluation import respond
from pmr.compare.runs import in_parts, run_from_start
from pmr.errors import InputError, SimulationError
from pmr.files import records
from pmr.scene import Scene
from pmr.simulation import Excitation, SystemSimulator, exudyn
from pmr.simulation.native import systems
from pmr.studies import figures
from pmr.studies.booms import Case, built_of, family_of, full_of, models_of
from pmr.studies.engine.task import Scalar, Task, TaskFunction, TaskResult, key_of
from pmr.studies.figures import boom_arguments
from pmr.system.from_scene import system_of

Array = NDArray[np.float64]

#: Bases that sections may have: free modes, without the flexibility of those left out or with it.
BASES = ("modes", "flexibility")
_SIMULATORS: Mapping[str, SystemSimulator] = {
    "march": systems.simulate,
    "exudyn": partial(exudyn.simulate_system, formulation=exudyn.FORMULATIONS["exudyn"]),
}
#: Simulations of which the fastest counts; the reference's step.
REPEATS, FINER = 3, 0.25


def task(
    name: str,
    function: TaskFunction,
    boom: Scene,
    parameters: Mapping[str, Scalar],
    needs: Mapping[str, str],
    **more: Any,
) -> Task:
    """A run on a boom, with further arguments."""
    arguments = boom_arguments(boom.model_copy(update={"recovery": None})) | more
    return Task(key_of(name), function, arguments, dict(needs), dict(parameters), cost=5.0)


def full_tip(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``coordinates``, ``e_abs`` (m) and ``e_nrms`` of the full boom's tip; array ``tip`` (T, d) in m."""
    case = Case.of(Scene.model_validate(arguments["boom"]))
    y = case.response.of("tip", body=case.boom.names[-1])
    size = sum(body.size for body in case.full.bodies.values())
    record: dict[str, Scalar] = {"coordinates": size, "e_abs": None, "e_nrms": None}
    if "finest" in needs:
        finest = needs["finest"].arrays["tip"]
        record |= {"e_abs": compare.absolute_error(y, finest), "e_nrms": compare.relative_error(y, finest)}
    return TaskResult(record, {"tip": y})


def by_size(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``beam.<r>`` and ``force.<r>`` (e_NRMS) by elastic modes a section, ``estimate.<r>`` where there is one.

    None where there is no model.  Seconds: ``simulate.<r>``, of the solver alone, and ``full``.
    """
    case, record = Case.of(Scene.model_validate(arguments["boom"])), dict[str, Scalar]()
    seconds, family = {"full": case.run.seconds}, family_of(case.boom, case.built)
    for r in arguments["coordinates"]:
        names = (f"beam.{r}", f"force.{r}", f"estimate.{r}")
        record |= dict.fromkeys(names)
        if r > family.most:
            continue
        modal, system = models_of(case.boom, family, r, arguments["basis"])
        try:
            runs = [run_from_start(system, case.excitation) for _ in range(REPEATS)]
        except (SimulationError, InputError):
            continue
        seconds[f"simulate.{r}"], found = min(run.seconds for run in runs), respond(system, runs[0])
        record[names[0]] = compare.relative_error(found.displacement, case.response.displacement)
        both = compare.with_common_forces(found, case.response)
        record[names[1]] = compare.relative_error(both[0].slider_force, both[1].slider_force)
        if no_estimate(modal) is None:
            record[names[2]] = estimate(modal, system, case.excitation, runs[0]).of("beam")
    return TaskResult(record, seconds=seconds)


def finest(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``y`` (T, o) in m, the full boom's motion with a step `FINER` than all; ``step``, what that is off by."""
    case, steps = Case.of(Scene.model_validate(arguments["boom"])), arguments["steps"]
    least = FINER * steps[-1]
    coarser, y = (case.at(case.full, factor * least, round(steps[0] / (factor * least))) for factor in (2.0, 1.0))
    return TaskResult({"step": compare.relative_error(coarser, y) / 3.0}, {"y": y})


def by_size_and_step(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``total.<r>.<factor>``, ``reduction.<r>``; seconds ``offline``, ``step.<r>``, ``full``: as of one body."""
    case, truth = Case.of(Scene.model_validate(arguments["boom"])), needs["truth"]
    begin = time.process_time()
    family = family_of(case.boom, case.built)
    seconds = {"offline": time.process_time() - begin, "full": case.run.seconds / case.boom.time.steps}
    record: dict[str, Scalar] = {"reference": truth.record["step"]}
    record |= {"scene step": case.boom.time.step, "steps": case.boom.time.steps}
    for r in [one for one in arguments["coordinates"] if one <= family.most]:
        names = [f"total.{r}.{factor:g}" for factor in arguments["steps"]]
        record |= dict.fromkeys((*names, f"reduction.{r}"))
        _, system = models_of(case.boom, family, r, arguments["basis"])
        for factor, name in zip(arguments["steps"], names, strict=True):
            try:
                y = case.at(system, factor, round(arguments["steps"][0] / factor))
            except (SimulationError, InputError):
                continue
            record[name] = compare.relative_error(y, truth.arrays["y"])
        try:
            runs = [run_from_start(system, case.excitation) for _ in range(REPEATS)]
        except (SimulationError, InputError):
            continue
        seconds[f"step.{r}"] = min(run.seconds for run in runs) / case.boom.time.steps
        moved = respond(system, runs[0]).displacement
        record[f"reduction.{r}"] = compare.relative_error(moved, case.response.displacement)
    return TaskResult(record, seconds=seconds)


def timed(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: seconds ``repeat1``, ... of the solver; ``coordinates``, ``steps``; of the full sections without `modes`.

    A run of ten steps goes before.
    """
    boom = Scene.model_validate(arguments["boom"])
    built, simulate = built_of(boom), _SIMULATORS[arguments["simulator"]]
    system = full_of(boom, built)
    if modes := arguments["modes"]:
        family = family_of(boom, built)
        if modes > family.most:
            raise InputError(
                "study", "coordinates", modes, f"up to {family.most} elastic modes of a section are allowed"
            )
        system = models_of(boom, family, modes, "flexibility")[1]
    excitation = Excitation.of(boom)
    if arguments["simulator"] != "march":  # which chooses the parts of a step where pads push
        excitation = in_parts(system, excitation)
    start, given = systems.start_of(system, excitation), excitation.stepping
    short = replace(given, end=min(10, given.steps) * given.step, schedule=given.schedule[:10])
    simulate(system, excitation.with_stepping(short), start)
    count = arguments["repeats"]
    seconds = {f"repeat{k + 1}": simulate(system, excitation, start).seconds for k in range(count)}
    size = sum(body.size for body in system.bodies.values())
    return TaskResult({"coordinates": size, "steps": given.steps, "share": 1.0}, seconds=seconds)


def history(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: errors of the reduced sections, as the scene asks for them, beside the full ones; what is drawn of both.

    Figures and arrays as of one body (`pmr.studies.kinds.histories`), without a cable or dropped rows.
    """
    from pmr.reduction.bodies import reduce_bodies

    case = Case.of(Scene.model_validate(arguments["boom"]))
    boom = case.boom
    system = system_of(boom, {name: one.model for name, one in reduce_bodies(boom, case.built).items()})
    found = respond(system, run_from_start(system, case.excitation))
    responses = {"reduced": found, "full": case.response}
    errors = summary.compared(responses, quantities(case.excitation, found), {}).figures
    record = figures.compared(errors, "errors", "absolute_errors")
    sizes = {"full": case.full, "reduced": system}
    record |= {f"coordinates.{model}": sum(body.size for body in one.bodies.values()) for model, one in sizes.items()}
    driven = Excitation.of(boom)
    arrays: dict[str, Any] = {"paths": np.array(list(driven.paths)), "path": driven.s, "path_rate": driven.rates}
    arrays |= {"inputs": np.array(system.input_names), "loads": driven.forces(system.input_names)}
    arrays |= {"scene": np.array(boom.model_dump_json())}
    for name, response in responses.items():
        arrays |= records.arrays(figures.at_the_tip(response), f"{name}.")
    return TaskResult(record, arrays, {f"simulate.{name}": response.seconds for name, response in responses.items()})
