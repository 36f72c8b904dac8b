"""Beams and booms of them on the compiled simulator, for studies that take hundreds of simulations."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare.runs import in_parts, run_from_start
from pmr.errors import SimulationError
from pmr.scene import Compare, Damping, Reduction, Scene, Simulation
from pmr.simulation import Excitation
from pmr.simulation.balance import NOTABLE, described
from pmr.simulation.modal import ModalForm
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.studies import shared
from pmr.studies.engine.task import Task, TaskResult
from pmr.system.body import Trajectory, length_outputs
from pmr.system.system import System

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """Transverse displacement (T, o) in m at the outputs; `surplus` as `Trajectory` has it."""

    displacement: Array
    strained: Callable[[], Array]  # finds `strain`, which most runs of a study aren't asked for
    surplus: float = 0.0

    @cached_property
    def strain(self) -> Array:
        """Strain energy (T,) in J."""
        return self.strained()


def motion(system: System, excitation: Excitation) -> Motion:
    """Displacement and, from each body's modal coordinates z, the strain energy sum_i omega_i^2 z_i^2 / 2.

    Raises InputError or SimulationError as for `pmr.simulation.SystemSimulator`.
    """
    form = SystemForm.of(system)
    run = run_from_start(form, excitation)
    lengths, each = _lengths(system), list(systems.displacements(system, run).values())
    moved = each[0] if len(each) == 1 else np.hstack(each)
    moved = moved if lengths.all() else moved[:, lengths]  # copies take as long as the steps

    def strained() -> Array:
        return np.asarray(np.sum([_strain(one, run.bodies[name]) for name, one in form.forms.items()], 0))

    return Motion(moved, strained, run.surplus)


def _strain(form: ModalForm, run: Trajectory) -> Array:
    return np.asarray((run.q @ form.inverse.T) ** 2 @ form.omega2 / 2.0)


def _lengths(system: System) -> NDArray[np.bool_]:
    return np.concatenate([length_outputs(body) for body in system.bodies.values()])


def full_task(scene: Scene) -> Task:
    """The full model's motion, the same task for all scenes that differ in their reduction only."""
    arguments = shared.scene_arguments(driven(scene))
    return Task(f"march-{arguments['hash']}", full, arguments, cost=1.0)


def full(arguments: Mapping[str, Any], needs: Mapping[str, TaskResult]) -> TaskResult:
    """Task: ``displacement`` (T, o) in m, ``strain`` (T,) in J of the full model; ``t`` (T,) in s, ``x`` (o,) in m.

    ``schedule``: of how many parts it made each step, where pads only push.
    """
    scene = shared.scene_of(arguments)
    system = shared.full_system(scene)
    excitation = in_parts(system, Excitation.of(scene))
    found = motion(system, excitation)
    if found.surplus > NOTABLE:  # what many runs are compared with
        raise SimulationError(f"the full model is no reference: {described(found.surplus)}")
    x = np.concatenate([body.output_positions for body in system.bodies.values()])[_lengths(system)]
    arrays = {"t": excitation.times, "x": x, "schedule": np.array(excitation.stepping.schedule, int)}
    return TaskResult(arrays=arrays | {"displacement": found.displacement, "strain": found.strain})


def excitation_of(scene: Scene, full: TaskResult) -> Excitation:
    """What drives the scene, in the parts of a step that a `full_task` took."""
    found = Excitation.of(scene)
    schedule = tuple(full.arrays["schedule"].tolist())
    return found.with_stepping(replace(found.stepping, schedule=schedule)) if schedule else found


def full_motion(result: TaskResult) -> Motion:
    """The motion of a `full_task`."""
    return Motion(result.arrays["displacement"], lambda: result.arrays["strain"])


def driven(scene: Scene) -> Scene:
    """The scene without what the full model's motion does not depend on: reduction, comparison, choice of simulator."""
    update = {"compare": Compare(against=()), "simulation": Simulation()}
    return shared.with_reduction(scene.model_copy(update=update), Reduction())


def resting(scene: Scene) -> Scene:
    """The scene without what eigenmodes and bases do not depend on: loads, damping, sizes, comparison."""
    unloaded = driven(scene).without_loads().model_copy(update={"damping": Damping()})
    choice = scene.sections[0].reduction
    return shared.with_reduction(
        unloaded, Reduction(basis="eigenmodes", positions=choice.positions, solver=choice.solver)
    )


def moving(scene: Scene) -> Scene:
    """The scene with what models on such bases depend on, damping too, and their motion."""
    return shared.with_reduction(driven(scene), resting(scene).sections[0].reduction)


def marched(scene: Scene) -> Scene:
    """The scene with the compiled simulator for the reduced and the full model."""
    return scene.model_copy(update={"simulation": Simulation(simulators=("march",), repeats=1, full="march")})
