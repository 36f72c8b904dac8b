"""Residual flexibility beside other ways to reduce a sliding beam: error over the number of coordinates.

Bases, each with the same numbers of coordinates, all against the full model's motion with the same step:

pod
    POD of eigenmodes with the slider held at several positions (Weyrer et al.), supports' rows left out.
modes
    Eigenmodes on the supports with the slider released.
harmonic
    POD of harmonic responses with the slider held along the visited stretch, up to `band`; M-orthonormal.
flexibility
    The same eigenmodes with the flexibility of those left out (docs/moving_residual_flexibility.md).
trajectory
    POD of the full model's own motion, M-orthonormal: no basis of fixed vectors holds more of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from pmr import scene as scenes
from pmr.compare import errors as compare
from pmr.compare import estimate
from pmr.errors import InputError, SimulationError
from pmr.studies import bases, booms, sections, shared, subjects
from pmr.studies.engine.task import Plan, Scalar, Task, TaskResult, key_of
from pmr.studies.results import StudyResults
from pmr.studies.study import Count, StudyBase
from pmr.system.contacts import ALONE
from pmr.system.system import System

BASES = ("pod", "modes", "harmonic", "flexibility", "trajectory")
#: Simulations of which the fastest counts.
REPEATS = 5


class Study(StudyBase):
    """Each of `scenes` (two sliders or pads are fine, axial coordinates too) with each basis.

    Of booms of sections with ``modes`` and ``flexibility``; `coordinates` are then elastic modes of each section.

    Figures: ``<scene>.<basis>.<r>``, e_NRMS of the beam, and ``ratio.least`` and ``ratio.largest`` of the estimate to
    the true error, over all scenes and models with residual flexibility whose error is above `round_off`.
    """

    kind: Literal["residual"] = Field(description="Kind of study")
    scenes: Annotated[tuple[Path, ...], Field(min_length=1)] = Field(description="Scenes that are computed")
    coordinates: Annotated[tuple[Count, ...], Field(min_length=1)] = Field(
        default=(4, 5, 6, 8, 10, 12, 16, 20), description="Numbers of coordinates"
    )
    band: Annotated[float, Field(gt=0.0)] = Field(
        default=20.0,
        description="Highest frequency of the responses that POD compresses",
        json_schema_extra={"unit": "Hz"},
    )
    round_off: float = Field(default=3e-8, description="Errors below this are round-off")

    def plan(self) -> Plan:
        if list(self.coordinates) != sorted(set(self.coordinates)):
            raise InputError("study", "coordinates", list(self.coordinates), "increasing numbers are allowed")
        runs = []
        for file in self.scenes:
            if boom := subjects.boom(file):
                largest = booms.reduced_to(boom, max(self.coordinates))
                more: dict[str, Any] = {"coordinates": list(self.coordinates)}
                for basis in sections.BASES:
                    parameters: dict[str, Scalar] = {"scene": file.stem, "basis": basis}
                    name, more = f"{file.stem},{basis}", more | {"basis": basis}
                    runs.append(sections.task(name, sections.by_size, largest, parameters, {}, **more))
                continue
            scene = scenes.beam_scene(file)
            for basis in BASES:
                update = {"reduction": bases.reduction(scene, basis, max(self.coordinates))}
                arguments = shared.scene_arguments(scene.model_copy(update=update))
                arguments |= {"basis": basis, "coordinates": list(self.coordinates), "band": self.band}
                parameters = {"scene": file.stem, "basis": basis}
                runs.append(Task(key_of(f"{file.stem},{basis}"), errors, arguments, {}, parameters, cost=2.0))
        return Plan(tuple(runs))

    def figures(self, results: StudyResults) -> dict[str, Scalar]:
        found: dict[str, Scalar] = {}
        ratios = []
        for run in results.runs:
            for r in self.coordinates:
                true, said = run.figures.get(f"beam.{r}"), run.figures.get(f"estimate.{r}")
                found[f"{run.parameters['scene']}.{run.parameters['basis']}.{r}"] = true
                if isinstance(true, float) and isinstance(said, float) and true > self.round_off and r >= 5:
                    ratios.append(said / true)
        return found | {"ratio.least": min(ratios, default=None), "ratio.largest": max(ratios, default=None)}


def errors(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``beam.<r>`` and ``force.<r>`` (e_NRMS), ``estimate.<r>`` where there is one; None where there is no model.

    Seconds: ``simulate.<r>``, of the solver alone, and ``full``.
    """
    scene = shared.scene_of(arguments)
    case = bases.Case.of(scene, arguments["band"])
    model = bases.MODELS[arguments["basis"]](case)
    record: dict[str, Scalar] = {}
    seconds = {"full": case.run.seconds}
    for r in arguments["coordinates"]:
        names = (f"beam.{r}", f"force.{r}", f"estimate.{r}")
        record |= dict.fromkeys(names)
        if r > model.largest:
            continue
        try:
            one = model.of(r)
            run, y = case.simulated(one)
            seconds[f"simulate.{r}"] = min(case.simulated(one)[0].seconds for _ in range(REPEATS))
        except (SimulationError, InputError):
            continue
        record[names[0]] = compare.relative_error(y, case.displacement)
        record[names[1]] = compare.relative_error(run.forces, case.run.forces)
        if estimate.no_estimate({ALONE: one}) is None:
            record[names[2]] = estimate.estimate({ALONE: one}, System.of(one), case.excitation).of("beam")
    return TaskResult(record, seconds=seconds)
