"""From a scene to the full models of its bodies, and whether something holds them wherever they slide."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np

from pmr.errors import InputError, NotHeldError
from pmr.fem.compat import MPI
from pmr.fullmodel import free_motions
from pmr.fullmodel.from_scene import structure_of
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.structural import structural_model
from pmr.fullmodel.structure import Structure
from pmr.fullmodel.system import FullSystem
from pmr.fullmodel.wanted import wanted_matrices
from pmr.scene import Scene
from pmr.scene.choice import is_undecided, model_of
from pmr.scene.members import members
from pmr.scene.names import ALONE, SLIDER
from pmr.system.from_scene import contacts_of

logger = logging.getLogger(__name__)

#: Relative error of the lowest frequency from which on a mesh is called too fine.
NOTICED_ROUND_OFF = 1e-4
#: Places on the way at which is looked for free motions.
PLACES = 33


@dataclass(frozen=True)
class Built:
    """A scene's full model, and the structure that it is assembled from."""

    model: FullModel
    structure: Structure


def build(scene: Scene, comm: MPI.Comm = MPI.COMM_WORLD) -> Built:
    """Assemble the full model of a scene of one body on `comm`; as `build_bodies`."""
    scene.alone  # noqa: B018 - refuses others
    return build_bodies(scene, comm)[ALONE]


def full_model(scene: Scene, comm: MPI.Comm = MPI.COMM_WORLD) -> FullModel:
    """The full model alone, as `build_and_warn` makes it."""
    return build_and_warn(scene, comm).model


def build_and_warn(scene: Scene, comm: MPI.Comm = MPI.COMM_WORLD) -> Built:
    """Build a scene's full model as `build` does, with warnings in the log."""
    built = build(scene, comm)
    log_warnings([built], comm)
    return built


def log_warnings(built: Iterable[Built], comm: MPI.Comm) -> None:
    """Warnings of structures, each once, in the log of the first rank."""
    messages = dict.fromkeys(message for model in built for message in warnings(model.structure))
    for message in messages if comm.rank == 0 else ():
        logger.warning("%s", message)


def warnings(structure: Structure) -> list[str]:
    """A line where elements are so short that round-off in the stiffness can be seen in the frequencies."""
    round_off = getattr(structure.model, "round_off", 0.0)
    if round_off <= NOTICED_ROUND_OFF:
        return []
    return [
        "round-off in the stiffness of so short elements changes the lowest frequency by about "
        f"{round_off:.0e} of its value; fewer elements are more accurate"
    ]


def build_bodies(scene: Scene, comm: MPI.Comm = MPI.COMM_WORLD) -> Mapping[str, Built]:
    """The full models of a scene's bodies by their names; equal ones are one and the same.  Collective.

    Raises an `InputError` if a mesh can't be had or does not fit what stands on it, something is free to move, or
    measurements have yet to decide a model.
    """
    for member in filter(is_undecided, members(scene)):
        allowed = "a model by its name is allowed here: pmr.run and pmr.reduce measure which one will do"
        raise InputError("scene", scene.key_of(member.number, "body.model"), "auto", allowed)
    by_content, bodies = dict[tuple[str, str], Built](), dict[str, Built]()
    matrices = wanted_matrices(scene)
    for name, member in zip(scene.names, members(scene), strict=True):
        key = member.content, model_of(member)
        if key not in by_content:
            try:
                structure = replace(structure_of(member, comm), matrices=matrices)
                by_content[key] = Built(structural_model(structure, comm), structure)
            except InputError as error:
                raise error.called(scene.key_of(member.number, error.key)) from None
        bodies[name] = by_content[key]
    if scene.free_motions == "refused" and (free := _free(scene, bodies)).said:
        allowed = f"{_without_limit(bodies, free)}; a support that holds it is needed, or 'allowed'"
        raise NotHeldError("scene", "free_motions", scene.free_motions, allowed, free.short)
    return bodies


def models_of(built: Mapping[str, Built]) -> dict[str, FullModel]:
    """The models by their bodies' names."""
    return {name: body.model for name, body in built.items()}


def left_free(scene: Scene, built: Mapping[str, Built]) -> list[str]:
    """Rigid motions of the whole that nothing resists somewhere on its way, in a line, if there are any; collective."""
    free = _free(scene, built)
    return [_without_limit(built, free)] if free.said else []


def _without_limit(built: Mapping[str, Built], free: free_motions.Free) -> str:
    holds = "supports and pads" if ALONE in built else "supports, pads and cylinders"
    return f"{holds} leave {free.said}: loads along that move it without limit"


def _free(scene: Scene, built: Mapping[str, Built]) -> free_motions.Free:
    models = models_of(built)
    system = FullSystem(models, contacts_of(scene, models)).with_supports()
    return free_motions.words(system, {name: body.structure.model for name, body in built.items()}, _way(scene))


def _way(scene: Scene) -> free_motions.Way:
    """Positions at which bodies are looked at: of one alone all along its path; of sections some times and breaks."""
    if ALONE in scene.bodies:
        along = np.linspace(*scene.travel, PLACES)
        return free_motions.Way({SLIDER: along}, {ALONE: np.zeros(PLACES)}, [f"with s at {at:.4g} m" for at in along])
    end, breaks = scene.time.end, [t for path in scene.paths.values() for t in path.breaks]
    t = np.unique(np.clip([*np.linspace(0.0, end, PLACES), *breaks], 0.0, end))
    s = {name: path.value(t) for name, path in scene.paths.items()}
    tails = accumulate(s.values(), np.add, initial=np.zeros(len(t)))
    return free_motions.Way(s, dict(zip(scene.names, tails, strict=True)), [f"at t = {at:.4g} s" for at in t])
