"""Convergence with the mesh: the full beam and the ANCF cable with more and more elements.

Weyrer et al., section "Convergence Analysis": the absolute error e_abs in m of the transverse tip displacement is the
norm, over all steps, of the difference between this displacement and the displacement on the finest mesh of the same
approach.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from pmr import scene as scenes
from pmr.compare.errors import absolute_error, relative_error
from pmr.compare.responses import march_once, simulate_cable
from pmr.compare.summary import warnings_of_response
from pmr.errors import InputError
from pmr.scene import Compare, Reduction, Scene, Simulation
from pmr.scene.hints import hints
from pmr.simulation import Excitation
from pmr.simulation.exudyn.ancf import COORDINATES_PER_NODE
from pmr.studies import shared
from pmr.studies.results import StudyResults
from pmr.studies.study import Count, StudyBase
from pmr.studies.tasks import Arguments, Needs, Plan, Scalar, Task, TaskResult

#: Rough effort in s of one element.
COSTS = {"ancf": 0.1, "full": 0.01}


class Study(StudyBase):
    """Numbers of elements of the full beam and of the ANCF cable, at least two each; a boom has them in every section.

    Figures, for each approach (``full`` or ``ancf``): ``chosen.<approach>``, the error in m with the number of elements
    that the scene has, and ``least.<approach>``, the smallest error in m of all numbers of elements.
    """

    kind: Literal["convergence"] = Field(description="Kind of study")
    scene: Path = Field(description="Scene that is computed")
    full: Annotated[tuple[Count, ...], Field(min_length=2)] = Field(description="Numbers of elements of the full beam")
    ancf: tuple[Count, ...] = Field(default=(), description="Numbers of elements of the ANCF cable, of one beam alone")

    @field_validator("full", "ancf")
    @classmethod
    def _check_increasing(cls, elements: tuple[int, ...]) -> tuple[int, ...]:
        """Refuse numbers of elements that do not increase, and a list of a single number."""
        if list(elements) != sorted(set(elements)):
            raise ValueError("numbers of elements must increase")
        if len(elements) == 1:
            raise ValueError("two numbers of elements at least are allowed")
        return elements

    def plan(self) -> Plan:
        """Return a task for each approach and number of elements; all but the finest need the finest one's result."""
        scene = scenes.load_any(self.scene) if scenes.has_sections(self.scene) else scenes.beam_scene(self.scene)
        shared.refuse_second_order(scene)
        profile = scene.sections[0].body.profile
        if len(scene.sections) > 1:
            if self.ancf:
                raise InputError("study", "ancf", list(self.ancf), "no ANCF cable is allowed: it is a single beam")
            if any(part.mesh.file is not None for part in scene.sections):
                raise InputError("study", "scene", str(self.scene), "sections with mesh.elements are allowed")
        elif scene.mesh.file is not None or profile is None or profile.axial_stiffness is None:
            allowed = "a scene with mesh.elements and body.profile.axial_stiffness is allowed"
            raise InputError("study", "scene", str(self.scene), allowed)
        return Plan((*self._runs(scene, "ancf", self.ancf), *self._runs(scene, "full", self.full)))

    def _runs(self, scene: Scene, approach: str, elements: tuple[int, ...]) -> list[Task]:
        """Return the tasks of an approach, ``"ancf"`` or ``"full"``, for increasing numbers of elements."""
        function = {"ancf": simulate_cable_tip, "full": simulate_full_tip}[approach]
        runs = []
        for count in elements:
            arguments = shared.scene_arguments(with_elements(scene, count))
            needs = {"finest": f"{approach}-{elements[-1]}"} if count != elements[-1] else {}
            parameters: dict[str, Scalar] = {"approach": approach, "elements": count}
            cost = COSTS[approach] * count
            runs.append(Task(f"{approach}-{count}", function, arguments, needs, parameters, cost))
        return runs

    def figures(self, results: StudyResults) -> dict[str, Scalar]:
        """Return ``chosen.<approach>`` and ``least.<approach>`` in m.

        A value of ``chosen`` is None if no run has the scene's number of elements.
        """
        scene, record = scenes.load_any(self.scene), dict[str, Scalar]()
        counts = {body.mesh.elements for body in scene.bodies.values()}
        choices = {"ancf": scene.compare.ancf_elements, "full": counts.pop() if len(counts) == 1 else None}
        for approach, chosen in choices.items():
            runs = [run for run in results.runs if run.parameters["approach"] == approach]
            if not runs:
                continue
            errors = {run.parameters["elements"]: run.figures["e_abs"] for run in runs}
            record[f"chosen.{approach}"] = errors.get(chosen)
            record[f"least.{approach}"] = min(error for error in errors.values() if error is not None)
        return record


def with_elements(scene: Scene, count: int) -> Scene:
    """Return the scene with `count` elements in every section, without the settings that its full model does not need.

    Comparison, recovery, choices of simulators, accuracy, budget and reduction are removed.
    """
    update = {
        "compare": Compare(against=()), "simulation": Simulation(), "recovery": None, "accuracy": None, "budget": None
    }  # fmt: skip
    parts = [
        part.model_copy(update={"mesh": part.mesh.model_copy(update={"elements": count})}) for part in scene.sections
    ]
    return shared.with_reduction(scene.model_copy(update=update | {"sections": tuple(parts)}), Reduction())


def simulate_full_tip(arguments: Arguments, needs: Needs) -> TaskResult:
    """Task: compute the tip's motion of the full model; record ``coordinates``, ``e_abs`` (m), ``e_nrms``.

    The array ``tip`` in m holds the transverse displacement (T,) of a single beam, or all d directions (T, d) of a
    boom's tip.  Errors are against the result ``finest``, which all tasks need but the task of the finest mesh; in the
    record of the latter the errors are None.
    """
    scene = shared.scene_of(arguments)
    system = shared.full_system(scene)
    response = march_once(scene, system, Excitation.from_scene(scene))
    tip, size = response.of("tip", body=scene.names[-1]), sum(body.size for body in system.bodies.values())
    result = _compare_tip(tip if len(scene.sections) > 1 else tip[:, -1], size, needs)
    return replace(result, warnings=warnings_of_response(scene, system, response))


def simulate_cable_tip(arguments: Arguments, needs: Needs) -> TaskResult:
    """Task: compute the tip's motion of an ANCF cable; record ``coordinates``, ``e_abs`` (m), ``e_nrms``.

    The array ``tip`` (T,) is the tip's transverse displacement in m.  Errors are against the result ``finest``, which
    all tasks need but the task of the finest mesh; in the record of the latter the errors are None.
    """
    scene = shared.scene_of(arguments)
    elements = scene.mesh.elements
    compared = scene.compare.model_copy(update={"ancf_elements": elements})
    cable = scene.model_copy(update={"compare": compared})
    motion = simulate_cable(cable, [scene.only_section.length], Excitation.from_scene(scene))
    result = _compare_tip(motion.displacement[:, -1], COORDINATES_PER_NODE * (elements + 1), needs)
    return replace(result, warnings=tuple(hints(scene)))


def _compare_tip(tip: NDArray[np.float64], coordinates: int, needs: Needs) -> TaskResult:
    """Return a task's result: the tip's displacement in m and, if `needs` has ``finest``, the errors against that."""
    record: dict[str, Scalar] = {"coordinates": coordinates, "e_abs": None, "e_nrms": None}
    if "finest" in needs:
        finest = needs["finest"].arrays["tip"]
        record |= {"e_abs": absolute_error(tip, finest), "e_nrms": relative_error(tip, finest)}
    return TaskResult(record, {"tip": tip})
