"""How reduced bodies move under a scene, by the simulators that it names; FEniCSx is not needed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from pmr.compare import responses
from pmr.compare.booms import respond, with_friction
from pmr.compare.made_for import check_made_for
from pmr.compare.pivot import at_pivot
from pmr.compare.responses import agreement
from pmr.errors import InputError
from pmr.errors.environment import Clock
from pmr.reduced.model import ReducedModel
from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.built import WEIGHT
from pmr.scene.frame import INERTIA
from pmr.scene.members import DRIVEN
from pmr.simulation import Excitation, Progress, SystemSimulator, contact_step, exudyn
from pmr.simulation.contact_step import contact_frequency
from pmr.simulation.excitation import on_path
from pmr.simulation.native import systems
from pmr.system.contacts import ALONE
from pmr.system.from_scene import system_of
from pmr.system.system import System, SystemTrajectory

#: s: what takes no longer is simulated several times.
SHORT = 2.0


@dataclass(frozen=True)
class BoomSimulations:
    """What the simulators say: the first one's motion and response, seconds, and how far each two agree, in m."""

    first: SystemTrajectory
    response: Response
    seconds: Mapping[str, float]
    agreement: Mapping[str, float]


def simulate_sections(boom: Scene, system: System, excitation: Excitation, clock: Clock) -> BoomSimulations:
    """From equilibrium, by all of them; Exudyn makes each step in the parts that the compiled simulator chose."""
    names, motions = boom.simulation.simulators, dict[str, SystemTrajectory]()
    omega = contact_frequency(system, excitation)
    for name in names:
        given = excitation
        if name != "march" and names[0] == "march":
            given = given.with_stepping(contact_step.as_made(given.stepping, motions["march"].parts, omega))
        with clock.stage("reduced" if len(names) == 1 else f"reduced, {name}") as done:
            motions[name] = _repeated(boom, system, given, simulator_of(name), done)
    found = {name: respond(system, motion) for name, motion in motions.items()}
    return BoomSimulations(
        motions[names[0]],
        found[names[0]],
        {name: motion.seconds for name, motion in motions.items()},
        agreement(found),
    )


def simulator_of(name: str) -> SystemSimulator:
    """By its name in a scene."""
    if name == "march":
        return systems.simulate
    return partial(exudyn.simulate_system, formulation=exudyn.FORMULATIONS[name])


def simulate(scene: Any, reduced: System | ReducedModel | Mapping[str, ReducedModel]) -> Response:
    """Response of a reduced system to the paths and loads of a `pmr.scene.Scene`, by the first simulator that it names.

    A model is that of a body alone; models of all sections, by their names, are joined as the scene says.

    Raises
    ------
    InputError
        If the scene describes other bodies, joints or loads than those that the system was made from, or a boom comes
        with anything but its system or a model for each of its sections.
    """
    system = reduced if isinstance(reduced, System) else joined(scene, reduced)
    excitation = driven_by(scene, system)
    if ALONE in system.bodies:
        model: Any = system.bodies[ALONE]
        return at_pivot(scene, responses.simulate_with_states(scene, model, ()).response)
    found = simulate_sections(scene, system, excitation, Clock()).response
    return at_pivot(scene, with_friction(scene, system.contacts, found))


def driven_by(scene: Any, system: System) -> Excitation:
    """Paths, loads and time grid of a `pmr.scene.Scene` for a system.

    An InputError is raised as by `check_fits`, or where a path leaves the rows of the system.
    """
    check_fits(scene, system)
    alone = ALONE in system.bodies
    excitation = Excitation.of(scene)
    for (name, path), s in zip(excitation.paths.items(), excitation.s.T, strict=True):
        try:
            on_path(path, s, system.ranges.get(name, (-np.inf, np.inf)), excitation.times)
        except InputError as error:
            raise InputError(
                "scene", error.key if alone else f"sections.{name}.joint", error.value, error.allowed
            ) from None
    return excitation


def check_fits(scene: Any, system: System) -> None:
    """Refuse with an InputError a scene of other bodies, joints or loads than those that a system was made from."""
    parts = scene.bodies
    if tuple(parts) != tuple(system.bodies):
        allowed = f"the sections of the system are allowed: {', '.join(system.bodies)}"
        if ALONE in system.bodies:
            allowed = "a scene of one body is allowed: the model is that of a body alone"
        raise InputError("scene", "sections", [name for name in parts if name != ALONE], allowed)
    for name, body in system.bodies.items():
        moved = [one for one in body.input_names if one.startswith(INERTIA)]
        if (scene.frame is None) == bool(moved):
            allowed = "a scene with a frame is allowed: the model moves in one" if moved else "the model has no frame"
            raise InputError("scene", "frame", None, allowed)
        known = [one for one in body.input_names if one not in (WEIGHT, DRIVEN, *moved)]
        loads = [load.name for load in parts[name].loads]
        weighs = scene.gravity is not None and scene.frame is None
        if set(loads) != set(known) or (name == ALONE and weighs != (WEIGHT in body.input_names)):
            key = "loads" if name == ALONE else f"sections.{name}.loads"
            allowed = f"the inputs of its model are allowed: {', '.join(body.input_names)}"
            raise InputError("scene", key, sorted(loads), allowed)
    check_made_for(system, scene)


def joined(scene: Any, reduced: ReducedModel | Mapping[str, ReducedModel]) -> System:
    """The system of models that were reduced one by one; an InputError is raised where a scene has others."""
    names = tuple(scene.bodies)
    models = {ALONE: reduced} if isinstance(reduced, ReducedModel) else reduced
    if not isinstance(models, Mapping) or set(models) != set(names):
        given = sorted(reduced) if isinstance(reduced, Mapping) else type(reduced).__name__
        allowed = f"a model for each section, by its name, is allowed: {', '.join(names)}; or their System"
        if ALONE in names:
            allowed = "a ReducedModel or a System is allowed with this scene"
        raise InputError("pmr.simulate", "models", given, allowed)
    if ALONE in names:
        return System.of(models[ALONE])
    for number, name in enumerate(names):
        model = models[name]
        if model.section is None or model.section.name != name:
            is_of = "a whole body" if model.section is None else f"section {model.section.name}"
            raise InputError("pmr.simulate", f"models.{name}", is_of, f"the model of section {name} is allowed")
        check_made_for(model, scene, number)
    return system_of(scene, {name: models[name] for name in names})


def _repeated(
    boom: Scene, system: System, excitation: Excitation, simulator: SystemSimulator, done: Progress
) -> SystemTrajectory:
    """A short simulation is repeated as the scene says, and the fastest counts."""
    start = systems.start_of(system, excitation)
    found = [simulator(system, excitation, start, done)]
    while len(found) < boom.simulation.repeats and found[0].seconds < SHORT:
        found.append(simulator(system, excitation, start))
    return min(found, key=lambda one: one.seconds)
