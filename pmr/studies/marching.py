"""Beams on the compiled simulator, for studies that take hundreds of simulations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import SimulationError
from pmr.scene import Compare, Damping, Reduction, Scene, Simulation
from pmr.simulation import Excitation
from pmr.simulation.balance import NOTABLE, described
from pmr.simulation.modal import modal_form
from pmr.simulation.native import simulator as march
from pmr.studies import shared
from pmr.studies.engine.task import Task, TaskResult
from pmr.system.body import SlidingBody

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """Transverse displacement (T, o) in m at the outputs, strain energy (T,) in J; `surplus` as `Trajectory` has it."""

    displacement: Array
    strain: Array
    surplus: float = 0.0


def motion(body: SlidingBody, excitation: Excitation) -> Motion:
    """Displacement and, from the modal coordinates z, the strain energy sum_i omega_i^2 z_i^2 / 2.

    Raises InputError or SimulationError as for `pmr.simulation.Simulator`.
    """
    form = modal_form(body)
    found = march.simulate_modal(form, excitation)
    z = found.q
    return Motion(z @ form.body.outputs.T, z**2 @ form.omega2 / 2.0, found.surplus)


def full_task(scene: Scene) -> Task:
    """The full model's motion, the same task for all scenes that differ in their reduction only."""
    arguments = shared.scene_arguments(driven(scene))
    return Task(f"march-{arguments['hash']}", full, arguments, cost=1.0)


def full(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``displacement`` (T, o) in m, ``strain`` (T,) in J of the full model; ``t`` (T,) in s, ``x`` (o,) in m."""
    scene = shared.scene_of(arguments)
    body, excitation = shared.body_of(scene), Excitation.of(scene)
    found = motion(body, excitation)
    if found.surplus > NOTABLE:  # what many runs are compared with
        raise SimulationError(f"the full model is no reference: {described(found.surplus)}")
    arrays = {"t": excitation.times, "x": body.output_positions}
    return TaskResult(arrays=arrays | {"displacement": found.displacement, "strain": found.strain})


def full_motion(result: TaskResult) -> Motion:
    """The motion of a `full_task`."""
    return Motion(result.arrays["displacement"], result.arrays["strain"])


def driven(scene: Scene) -> Scene:
    """The scene without what the full model's motion does not depend on: reduction, comparison, choice of simulator."""
    update = {"reduction": Reduction(), "compare": Compare(against=()), "simulation": Simulation()}
    return scene.model_copy(update=update)


def resting(scene: Scene) -> Scene:
    """The scene without what eigenmodes and bases do not depend on: loads, damping, sizes, comparison."""
    deciding = Reduction(basis="eigenmodes", positions=scene.reduction.positions, solver=scene.reduction.solver)
    return driven(scene).without_loads().model_copy(update={"damping": Damping(), "reduction": deciding})


def marched(scene: Scene) -> Scene:
    """The scene with the compiled simulator for the reduced and the full model."""
    return scene.model_copy(update={"simulation": Simulation(simulators=("march",), repeats=1, full="march")})
