"""Tasks of studies on booms: full models on several meshes; models of several sizes and steps beside the full one.

What counts is the number of elastic modes of each section, rigid-body motions and modes of cylinders come on top.
Motions begin in static equilibrium.  Where pads push, models take the parts of a step that the full one took.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare.errors import absolute_error, relative_error
from pmr.compare.outputs import run_from_start
from pmr.compare.responses import respond
from pmr.compare.summary import warnings_of_response
from pmr.errors import InputError, SimulationError
from pmr.scene import Scene
from pmr.studies.booms import Case, models_of, sizes_of
from pmr.studies.engine.task import Scalar, Task, TaskFunction, TaskResult, key_of
from pmr.studies.figures import boom_arguments

Array = NDArray[np.float64]

#: Bases that sections may have: free modes, without the flexibility of those left out or with it.
BASES = ("modes", "flexibility")
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
        record |= {"e_abs": absolute_error(y, finest), "e_nrms": relative_error(y, finest)}
    return TaskResult(record, {"tip": y}, warnings=warnings_of_response(case.boom, case.full, case.response))


def finest(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``y`` (T, o) in m, the full boom's motion with a step `FINER` than all; ``step``, what that is off by.

    Warnings are those of its motion with its own step.
    """
    case, steps = Case.of(Scene.model_validate(arguments["boom"])), arguments["steps"]
    least = FINER * steps[-1]
    coarser, y = (case.at(case.full, factor * least, round(steps[0] / (factor * least))) for factor in (2.0, 1.0))
    lines = warnings_of_response(case.boom, case.full, case.response)
    return TaskResult({"step": relative_error(coarser, y) / 3.0}, {"y": y}, warnings=lines)


def by_size_and_step(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``total.<r>.<factor>``, ``reduction.<r>``; seconds ``offline``, ``step.<r>``, ``full``: as of one body."""
    case, truth = Case.of(Scene.model_validate(arguments["boom"])), needs["truth"]
    begin = time.process_time()
    trials = sizes_of(case.boom, case.built)
    seconds = {"offline": time.process_time() - begin, "full": case.run.seconds / case.boom.time.steps}
    record: dict[str, Scalar] = {"reference": truth.record["step"]}
    record |= {"scene step": case.boom.time.step, "steps": case.boom.time.steps}
    for r in [count for count in arguments["coordinates"] if count <= trials.elastic(trials.most)]:
        names = [f"total.{r}.{factor:g}" for factor in arguments["steps"]]
        record |= dict.fromkeys((*names, f"reduction.{r}"))
        _, system = models_of(case.boom, trials, r, arguments["basis"])
        for factor, name in zip(arguments["steps"], names, strict=True):
            try:
                y = case.at(system, factor, round(arguments["steps"][0] / factor))
            except (SimulationError, InputError):
                continue
            record[name] = relative_error(y, truth.arrays["y"])
        try:
            runs = [run_from_start(system, case.excitation) for _ in range(REPEATS)]
        except (SimulationError, InputError):
            continue
        seconds[f"step.{r}"] = min(run.seconds for run in runs) / case.boom.time.steps
        displacement = respond(system, runs[0]).displacement
        record[f"reduction.{r}"] = relative_error(displacement, case.response.displacement)
    return TaskResult(record, seconds=seconds, warnings=truth.warnings)
