"""Response of a reduced system to a scene, and the check that the system was made for it; without FEniCSx."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pmr.compare.evaluation import append_machine
from pmr.compare.responses import Simulation, refuse_growth, simulate_by
from pmr.compare.second_order import decide_second_order, with_choice_of_terms
from pmr.errors import InputError
from pmr.errors.environment import Clock
from pmr.results import Response
from pmr.scene import Scene
from pmr.scene.built import WEIGHT
from pmr.scene.choice import axis_loads
from pmr.scene.frame import INERTIA
from pmr.scene.joints import OneBody
from pmr.scene.keys import ALONE, SceneTable
from pmr.scene.members import EXTENSION, Member, member_at, members
from pmr.simulation import Excitation
from pmr.simulation.excitation import clip_path
from pmr.simulation.native.free_motion import with_free_motion
from pmr.system.from_scene import system_of, with_hoist_of
from pmr.system.reduced_model import ReducedModel
from pmr.system.system import System


def simulate(scene: Scene, reduced: System | ReducedModel | Mapping[str, ReducedModel]) -> Response:
    """Response of a reduced model or system to the paths and loads of a `pmr.scene.Scene`.

    The first simulator of the scene computes it.  `reduced` is a system, the model of a single body, or the models of
    all sections by their names, which are then joined as the scene says.  There are no warnings, such as those on
    ``time.step`` and ``time.rho_inf``: `pmr.run` and the command ``pmr simulate`` judge a motion.

    Raises
    ------
    InputError
        If the scene has other bodies, joints or loads than those from which the system was made.  For a boom, it is
        raised too if `reduced` is neither the boom's system nor a model for each section.
    """
    return simulate_with_states(scene, reduced, ()).response


def simulate_with_states(
    scene: Scene, reduced: System | ReducedModel | Mapping[str, ReducedModel], steps: Sequence[int] | None = None
) -> Simulation:
    """Response of a reduced model or system, and the states of each body at some steps of the scene's time grid.

    Parameters
    ----------
    scene, reduced
        As for `simulate`, which raises the same errors.
    steps : sequence of int, optional
        Ascending numbers of the steps with states, 0 for the start; by default all steps.

    Returns
    -------
    Simulation
        Its `response`, and its `states` by name of the body, ``""`` for a single body.  States have coordinates ``p``
        (S, r) and their rates ``v``, ``loads`` (S, i), and for the m rows of the body the path coordinates ``s`` (S, m)
        in m and ``multipliers`` (S, m) in N.
    """
    steps = range(scene.time.steps + 1) if steps is None else steps
    scene = with_models_of(scene, reduced)
    system = with_hoist_of(scene, reduced) if isinstance(reduced, System) else join_models(scene, reduced)
    scene = with_choice_of_terms(scene, system.terms)
    with Clock().stage("reduced"), refuse_growth(scene):
        if scene.computed_key is not None:
            check_scene_fits(scene, system)
            scene, system = with_free_motion(scene, system)
        excitation = excitation_of_scene(scene, system)
        simulated = simulate_by(scene, system, excitation, scene.simulation.simulators[0], steps)
        return replace(simulated, response=append_machine(scene, simulated.response))


def excitation_of_scene(scene: Scene, system: System) -> Excitation:
    """Paths, loads and time grid of a `pmr.scene.Scene` for a system.

    An InputError is raised as by `check_scene_fits`, or if a path leaves the rows of the system.
    """
    scene = with_choice_of_terms(scene, system.terms)
    check_scene_fits(scene, system)
    alone = ALONE in system.bodies
    excitation = Excitation.from_scene(scene)
    for (name, path), s in zip(excitation.paths.items(), excitation.s.T, strict=True):
        try:
            clip_path(path, s, system.ranges.get(name, (-np.inf, np.inf)), excitation.times)
        except InputError as error:
            key = error.key if alone else f"sections.{name}.joint"
            raise InputError("scene", key, error.value, error.allowed) from None
    return excitation


def check_scene_fits(scene: Scene, system: System) -> None:
    """Raise an InputError if a scene's bodies, joints or loads are not those of the scene that a system is made for.

    A frame, and second order in it, have to be in both or in neither.
    """
    parts = scene.bodies
    if tuple(parts) != tuple(system.bodies):
        allowed = f"the sections of the system are allowed: {', '.join(system.bodies)}"
        if ALONE in system.bodies:
            allowed = "a scene of one body is allowed: the model is that of a body alone"
        raise InputError("scene", "sections", [name for name in parts if name != ALONE], allowed)
    for member, (name, body) in zip(members(scene), system.bodies.items(), strict=True):
        inertia_inputs = [input_name for input_name in body.input_names if input_name.startswith(INERTIA)]
        if (scene.frame is None) == bool(inertia_inputs):
            moving = "a scene with a frame is allowed: the model moves in one"
            raise InputError("scene", "frame", None, moving if inertia_inputs else "the model has no frame")
        load_inputs = set(body.input_names) - {WEIGHT, EXTENSION, *inertia_inputs}
        loads = [load.name for load in axis_loads(member)]
        weighs = scene.gravity is not None and scene.frame is None
        if set(loads) != load_inputs or (name == ALONE and weighs != (WEIGHT in body.input_names)):
            key = "loads" if name == ALONE else f"sections.{name}.loads"
            allowed = f"the inputs of its model are allowed: {', '.join(body.input_names)}"
            raise InputError("scene", key, sorted(loads), allowed)
    second = scene.frame is not None and scene.frame.second_order
    if second != bool(system.terms):
        allowed = f"{str(not second).lower()} is allowed: the system was reduced so"
        raise InputError("scene", "frame.second_order", second, allowed)
    check_same_scene(system, scene)


def join_models(scene: Scene, reduced: ReducedModel | Mapping[str, ReducedModel]) -> System:
    """System of models that were reduced one by one, joined as the scene says.

    Raises InputError if they are not the models of the scene's bodies.
    """
    names = tuple(scene.bodies)
    models = {ALONE: reduced} if isinstance(reduced, ReducedModel) else reduced
    if not isinstance(models, Mapping) or set(models) != set(names):
        models_given = sorted(reduced) if isinstance(reduced, Mapping) else type(reduced).__name__
        allowed = f"a model for each section, by its name, is allowed: {', '.join(names)}; or their System"
        if ALONE in names:
            allowed = "a ReducedModel or a System is allowed with this scene"
        raise InputError("pmr.simulate", "models", models_given, allowed)
    if ALONE in names:
        scene = decide_second_order(scene, models)
        joined = system_of(scene, models)
        return replace(joined, provenance=scene.provenance) if joined.terms else joined
    for number, name in enumerate(names):
        model = models[name]
        if model.section is None or model.section.name != name:
            is_of = "a whole body" if model.section is None else f"section {model.section.name}"
            raise InputError("pmr.simulate", f"models.{name}", is_of, f"the model of section {name} is allowed")
        check_same_scene(model, scene, number)
    ordered_models = {name: models[name] for name in names}
    scene = decide_second_order(scene, ordered_models)
    return replace(system_of(scene, ordered_models), provenance=scene.provenance)


#: Keys that may differ from the scene that a model was made from: signals, and how reductions are computed and judged.
FREE = frozenset({
    *("signal", "acceleration", "rise", "path", "travel", "frequency_response", "solver", "estimate"),
    *("extension", "overlap", "follows", "ratio", "offset"),
})  # fmt: skip


def with_models_of(scene: Scene, models: System | ReducedModel | Mapping[str, ReducedModel]) -> Scene:
    """Scene in which bodies with the structural model ``auto`` get the structural model of the reduced `models`.

    With the model, its ``walls`` are taken over.  Both were chosen by measurements when these models were reduced.
    `models` are a system, a model of a single body, or a model of each section by name.
    """
    parts = []
    for number, (name, part) in enumerate(scene.bodies.items()):
        model = models.get(name) if isinstance(models, Mapping) else models
        written = {} if model is None else model.provenance.get("scene") or {}
        if "sections" in written:
            written = written["sections"][number] if number < len(written["sections"]) else {}
        chosen_by_model = {key: value for key, value in written.get("body", {}).items() if key in ("model", "walls")}
        chosen = chosen_by_model if part.body.model == "auto" and chosen_by_model.get("model", "auto") != "auto" else {}
        parts.append(part.with_keys(body=chosen))
    return scene.with_keys(sections=tuple(parts))


def check_same_scene(model: System | ReducedModel, scene: Scene, number: int | None = None) -> None:
    """Raise an InputError, with the first key that differs and its old value, if a model is from another scene.

    Compared are bodies, supports, pads, joints, damping, observed outputs, positions and directions of loads, and the
    content of files: those of the whole scene or, if `number` is not None, of the section with this number alone.  The
    direction of gravity is compared if both scenes have gravity, and pivot, luffing cylinder and hoist if `model` is a
    system.  Keys that are missing in the file of an older model, and keys of `FREE`, are not compared.
    """
    recorded_scene = model.provenance.get("scene")
    if not isinstance(recorded_scene, Mapping):
        return
    files = model.provenance.get("files") or {}
    alone = number is not None or len(scene.sections) == 1
    if alone:
        differing = _body_differences(recorded_scene, member_at(scene, number or 0))
        read: Mapping[str, Path] = scene.sections[number or 0].files
    else:
        keys = [key for key in ("damping", "sections") if key in recorded_scene]
        differing = (d for key in keys for d in _part_differences(recorded_scene[key], getattr(scene, key), key))
        read = scene.files_read
    gravity, of_files = recorded_scene.get("gravity"), _file_differences(files, read)
    of_gravity = _part_differences(gravity, scene.gravity, "gravity") if gravity and scene.gravity else ()
    of_mechanism = _mechanism_differences(recorded_scene, scene) if isinstance(model, System) else ()
    for key, value, of_model in itertools.chain(of_gravity, of_mechanism, differing, of_files):
        shown = list(value) if isinstance(value, tuple) else value
        where = scene.section_key(number or 0, key) if alone else key
        raise InputError("scene", where, shown, f"{of_model!r} is allowed, as in the model")


class Difference(NamedTuple):
    """Difference between a scene and the scene of a model: key, the scene's value, the model's value."""

    key: str
    present: object
    recorded: object


#: Keys of a frame and a hoist that are in the contacts, terms and inputs of a system.
MECHANISM = (
    *("frame.pivot", "frame.cylinder.stiffness"),
    *("hoist.section", "hoist.on", "hoist.offset", "hoist.winch.section"),
)
#: Further such keys of a luffing cylinder that holds the boom; otherwise supports of the base hold it.
HINGES = ("frame.cylinder.foot", "frame.cylinder.lug")


def _mechanism_differences(recorded_scene: Mapping[str, object], scene: Scene) -> Iterator[Difference]:
    """Yield the differences between `recorded_scene`, the keys of a model's scene, and `scene` in their mechanism.

    The keys are `MECHANISM` and a winch's place on a section.  `HINGES` are added if a free luffing angle or a cylinder
    makes them matter.  Raises an InputError if only one of the two scenes has a frame, a cylinder or a hoist.
    """
    on_section = scene.hoist is not None and scene.hoist.winch.section
    holds = scene.frame is not None and (scene.frame.luffing == "free" or scene.holding_cylinder is not None)
    for key in (*MECHANISM, *(HINGES if holds else ()), *(["hoist.winch.at"] if on_section else [])):
        recorded: Any = recorded_scene
        present: Any = scene
        names = key.split(".")
        for depth, name in enumerate(names, 1):
            if name not in recorded:
                break
            recorded, present = recorded[name], getattr(present, name)
            if (recorded is None) != (present is None):
                allowed = "nothing is allowed, as the model has none" if recorded is None else "the model has one"
                raise InputError("scene", ".".join(names[:depth]), None, allowed)
            if recorded is None or depth == len(names):
                yield from _part_differences(recorded, present, ".".join(names[:depth]))
                break


def _body_differences(recorded_scene: Mapping[str, Any], member: Member) -> Iterator[Difference]:
    """Yield the differences in one body between `recorded_scene`, the keys of a model's scene, and that of `member`.

    Loads are compared by their names.
    """
    recorded_loads = {load.get("name"): load for load in recorded_scene.get("loads") or ()}
    for i, load in enumerate(member.part.loads):
        yield from _part_differences(recorded_loads.get(load.name, {}), load, f"loads[{i}]")
    fields = {name: getattr(member.part, name) for name in OneBody.model_fields if name != "loads"}
    for name, value in (fields | {"pads": member.pads, "damping": member.scene.damping}).items():
        if name in recorded_scene and not (name == "slider" and value is None):
            yield from _part_differences(recorded_scene[name], value, name)


def _file_differences(recorded_digests: Mapping[str, str], read: Mapping[str, Path]) -> Iterator[Difference]:
    """Yield those files `read` by a scene, by key, whose content has another SHA-256 than in `recorded_digests`.

    A difference is shown as a file's name and as a digest.  A file without a recorded digest does not differ.
    """
    for name, file in read.items():
        digest = hashlib.sha256(file.read_bytes()).hexdigest()
        if recorded_digests.get(name, digest) != digest:
            yield Difference(f"{name}.file", file.name, f"content of SHA-256 {recorded_digests[name][:12]}")


def _part_differences(recorded: object, present: object, key: str) -> Iterator[Difference]:
    """Yield the differences between a `recorded` and a `present` value of a scene at `key`, and in all their fields."""
    if isinstance(present, SceneTable) and isinstance(recorded, Mapping):
        for name in [name for name in type(present).model_fields if name in recorded and name not in FREE]:
            yield from _part_differences(recorded[name], getattr(present, name), f"{key}.{name}")
    elif isinstance(present, dict) and isinstance(recorded, Mapping) and set(present) == set(recorded):
        for name, value in present.items():
            yield from _part_differences(recorded[name], value, f"{key}.{name}")
    elif (
        isinstance(present, tuple)
        and present
        and isinstance(present[0], SceneTable)
        and isinstance(recorded, list | tuple)
        and len(present) == len(recorded)
    ):
        for i, (recorded_entry, value) in enumerate(zip(recorded, present, strict=True)):
            yield from _part_differences(recorded_entry, value, f"{key}[{i}]")
    elif not _is_equal(recorded, present):
        yield Difference(key, present.name if isinstance(present, Path) else present, recorded)


def _is_equal(recorded: object, present: object) -> bool:
    """Whether a present value equals the recorded one, with three differences allowed.

    Numbers may differ by round-off (1e-12 relative), tuples are read back from JSON as lists, and of a path only the
    file's name counts.
    """
    if isinstance(present, tuple) and isinstance(recorded, list | tuple):
        return len(present) == len(recorded) and all(map(_is_equal, recorded, present))
    if isinstance(present, float) and isinstance(recorded, int | float):
        return math.isclose(present, recorded, rel_tol=1e-12)
    return bool((present.name if isinstance(present, Path) else present) == recorded)
