"""A reduced system under a scene that it may not have been made from; FEniCSx is not needed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pmr.compare.machine import with_machine
from pmr.compare.made_for import check_made_for, with_models_of
from pmr.compare.responses import Simulated, refused_growth, simulate_by
from pmr.compare.second_order import as_made, decide_second_order
from pmr.errors import InputError
from pmr.errors.environment import Clock
from pmr.reduced.model import ReducedModel
from pmr.results import Response
from pmr.scene.built import WEIGHT
from pmr.scene.choice import loads_of
from pmr.scene.frame import INERTIA
from pmr.scene.members import EXTENSION, members
from pmr.simulation import Excitation
from pmr.simulation.excitation import on_path
from pmr.simulation.machine.motion import with_machine_moved
from pmr.system.contacts import ALONE
from pmr.system.from_scene import system_of
from pmr.system.system import System


def simulate(scene: Any, reduced: System | ReducedModel | Mapping[str, ReducedModel]) -> Response:
    """Response of a reduced model or system to the paths and loads of a `pmr.scene.Scene`.

    The first simulator of the scene computes it.  `reduced` is a system, the model of a single body, or the models of
    all sections by their names, which are then joined as the scene says.

    Raises
    ------
    InputError
        If the scene has other bodies, joints or loads than those from which the system was made.  Of a boom also if
        `reduced` is neither its system nor a model for each of its sections.
    """
    return simulate_with_states(scene, reduced, ()).response


def simulate_with_states(
    scene: Any, reduced: System | ReducedModel | Mapping[str, ReducedModel], steps: Sequence[int] | None = None
) -> Simulated:
    """Response of a reduced model or system, and the states of each body at some steps of the scene's time grid.

    Parameters
    ----------
    scene, reduced
        As for `simulate`, which raises the same errors.
    steps : sequence of int, optional
        Ascending numbers of steps, 0 for the start; by default all of them.

    Returns
    -------
    Simulated
        `response`, and `states` by body, ``""`` for a single one: coordinates ``p`` (S, r), their rates ``v``, path
        coordinates ``s`` (S, m) in m and ``multipliers`` (S, m) in N of its `rows`, ``loads`` (S, i).
    """
    steps = range(scene.time.steps + 1) if steps is None else steps
    scene = with_models_of(scene, reduced)
    system = reduced if isinstance(reduced, System) else join_models(scene, reduced)
    scene = as_made(scene, system.terms)
    with Clock().stage("reduced"), refused_growth(scene):
        if scene.frame is not None and scene.frame.machine is not None:
            check_fits(scene, system)
            scene, system = with_machine_moved(scene, system)
        simulated = simulate_by(scene, system, excitation_in(scene, system), scene.simulation.simulators[0], steps)
        return replace(simulated, response=with_machine(scene, simulated.response))


def excitation_in(scene: Any, system: System) -> Excitation:
    """Paths, loads and time grid of a `pmr.scene.Scene` for a system.

    An InputError is raised as by `check_fits`, or where a path leaves the rows of the system.
    """
    scene = as_made(scene, system.terms)
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
    for member, (name, body) in zip(members(scene), system.bodies.items(), strict=True):
        inertia_inputs = [input_name for input_name in body.input_names if input_name.startswith(INERTIA)]
        if (scene.frame is None) == bool(inertia_inputs):
            allowed = (
                "a scene with a frame is allowed: the model moves in one"
                if inertia_inputs
                else "the model has no frame"
            )
            raise InputError("scene", "frame", None, allowed)
        load_inputs = [
            input_name for input_name in body.input_names if input_name not in (WEIGHT, EXTENSION, *inertia_inputs)
        ]
        loads = [load.name for load in loads_of(member)]
        weighs = scene.gravity is not None and scene.frame is None
        if set(loads) != set(load_inputs) or (name == ALONE and weighs != (WEIGHT in body.input_names)):
            key = "loads" if name == ALONE else f"sections.{name}.loads"
            allowed = f"the inputs of its model are allowed: {', '.join(body.input_names)}"
            raise InputError("scene", key, sorted(loads), allowed)
    second = scene.frame is not None and scene.frame.second_order
    if second != bool(system.terms):
        allowed = f"{str(not second).lower()} is allowed: the system was reduced so"
        raise InputError("scene", "frame.second_order", second, allowed)
    check_made_for(system, scene)


def join_models(scene: Any, reduced: ReducedModel | Mapping[str, ReducedModel]) -> System:
    """The system of models that were reduced one by one; an InputError is raised where a scene has others."""
    names = tuple(scene.bodies)
    models = {ALONE: reduced} if isinstance(reduced, ReducedModel) else reduced
    if not isinstance(models, Mapping) or set(models) != set(names):
        models_given = sorted(reduced) if isinstance(reduced, Mapping) else type(reduced).__name__
        allowed = f"a model for each section, by its name, is allowed: {', '.join(names)}; or their System"
        if ALONE in names:
            allowed = "a ReducedModel or a System is allowed with this scene"
        raise InputError("pmr.simulate", "models", models_given, allowed)
    if ALONE in names:
        return system_of(decide_second_order(scene, models), models)
    for number, name in enumerate(names):
        model = models[name]
        if model.section is None or model.section.name != name:
            is_of = "a whole body" if model.section is None else f"section {model.section.name}"
            raise InputError("pmr.simulate", f"models.{name}", is_of, f"the model of section {name} is allowed")
        check_made_for(model, scene, number)
    ordered_models = {name: models[name] for name in names}
    return system_of(decide_second_order(scene, ordered_models), ordered_models)
