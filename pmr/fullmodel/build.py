"""From a scene to its full model, and from a boom to those of its sections, with rows wherever pads of joints sit."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np

from pmr.constraints.straight import Straight
from pmr.errors import InputError
from pmr.fem.compat import MPI
from pmr.fullmodel import free_motions
from pmr.fullmodel.from_scene import structure_of
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.pads import Pad, Pads, Support
from pmr.fullmodel.structure import Structure, Weight, structural_model
from pmr.fullmodel.system import BODY, FullSystem
from pmr.scene import Boom, Scene
from pmr.scene.boom_parts import DRIVEN, POINT, TAIL, Footprint, footprints, is_axial, section_scene, stiffened
from pmr.system.booms import contacts_of

logger = logging.getLogger(__name__)

#: Relative error of the lowest frequency from which on a mesh is called too fine.
NOTICED_ROUND_OFF = 1e-4
#: Places on the way at which is looked for free motions, and what the path of one body is called there.
PLACES, PATH = 33, "s"


@dataclass(frozen=True)
class Built:
    """A scene's full model, and the structure that it is assembled from."""

    model: FullModel
    structure: Structure


def build(scene: Scene, comm: MPI.Comm = MPI.COMM_WORLD) -> Built:
    """Assemble the full model of a scene on `comm`; collective.

    Raises an `InputError` if the scene's mesh does not fit what stands on it, or the body is free to move.
    """
    structure = structure_of(scene, comm)
    built = Built(structural_model(structure, comm), structure)
    _check_freedom(scene, left_free(scene, {BODY: built}))
    return built


def full_model(scene: Scene, comm: MPI.Comm = MPI.COMM_WORLD) -> FullModel:
    """The full model alone, as `build_and_warn` makes it."""
    return build_and_warn(scene, comm).model


def build_and_warn(scene: Scene, comm: MPI.Comm = MPI.COMM_WORLD) -> Built:
    """As `build`, with warnings in the log."""
    built = build(scene, comm)
    for said in warnings(built.structure) if comm.rank == 0 else ():
        logger.warning("%s", said)
    return built


def warnings(structure: Structure) -> list[str]:
    """A line where elements are so short that round-off in the stiffness can be seen in the frequencies."""
    round_off = getattr(structure.model, "round_off", 0.0)
    if round_off <= NOTICED_ROUND_OFF:
        return []
    return [
        "round-off in the stiffness of so short elements changes the lowest frequency by about "
        f"{round_off:.0e} of its value; fewer elements are more accurate"
    ]


def build_sections(boom: Boom, comm: MPI.Comm = MPI.COMM_WORLD) -> Mapping[str, Built]:
    """By the sections' names; equal ones are one and the same.  Collective.

    Raises an `InputError` if a mesh can't be had, lacks a group, a pad leaves its face, or a section is free to move.
    """
    made, found = dict[tuple[str, bool], Built](), dict[str, Built]()
    for number, name in enumerate(boom.names):
        key = section_scene(boom, number).without_loads().hash, number == 0  # the base is moved by no extension
        if key not in made:
            structure = _structure(boom, number, comm)
            made[key] = Built(structural_model(structure, comm), structure)
        found[name] = made[key]
    _check_freedom(boom, left_free(boom, found))
    return found


def left_free(scene: Scene | Boom, built: Mapping[str, Built]) -> list[str]:
    """Rigid motions of the whole that nothing resists somewhere on its way, in a line, if there are any; collective.

    `built` holds the sections of a boom by their names, or one body as ``BODY``.
    """
    models = {name: one.model for name, one in built.items()}
    if isinstance(scene, Boom):
        system, holds = FullSystem(models, contacts_of(scene, models)).supported(), "supports, pads and cylinders"
        way = _way(scene)
    else:
        system, holds = FullSystem.of(models[BODY], PATH), "supports and pads"
        s = np.linspace(*scene.travel, PLACES)
        way = free_motions.Way({PATH: s}, {BODY: np.zeros(PLACES)}, [f"with s at {at:.4g} m" for at in s])
    found = free_motions.words(system, {name: one.structure.model for name, one in built.items()}, way)
    return [f"{holds} leave {found}: loads along that move it without limit"] if found else []


def _way(boom: Boom) -> free_motions.Way:
    """Where a boom is looked at: at some times, and where its paths have breaks."""
    end, breaks = boom.time.end, [t for path in boom.paths.values() for t in path.breaks]
    t = np.unique(np.clip([*np.linspace(0.0, end, PLACES), *breaks], 0.0, end))
    s = {name: path.value(t) for name, path in boom.paths.items()}
    tails = accumulate(s.values(), np.add, initial=np.zeros(len(t)))
    return free_motions.Way(s, dict(zip(boom.names, tails, strict=True)), [f"at t = {at:.4g} s" for at in t])


def _check_freedom(scene: Scene | Boom, free: list[str]) -> None:
    if free and scene.free_motions == "refused":
        allowed = f"{free[0]}; a support that holds it is needed, or 'allowed'"
        raise InputError("scene", "free_motions", scene.free_motions, allowed)


def _structure(boom: Boom, number: int, comm: MPI.Comm) -> Structure:
    structure = structure_of(section_scene(boom, number), comm)
    pads, loads = structure.pads, structure.loads
    travels = {one.name: one for one in footprints(boom, number)}
    pads = replace(
        pads,
        moving=tuple(_travelling(pad, travels) for pad in pads.moving),
        sliders=tuple(replace(point, name=POINT) for point in pads.sliders),
        straight=tuple(Straight(end, names) for names, end in stiffened(boom, number).items()),
    )
    held = any(clamp.on == "tail" and "x" in clamp.directions for clamp in structure.clamps)  # every point of it
    if is_axial(boom, number) and (number or not held):  # of the base, too, which the first cylinder leans on
        pads = replace(pads, ends=(Support(TAIL, "tail", "x"),), travel=_stretch(pads))
        loads = (*loads, Weight((-1.0, 0.0, 0.0), DRIVEN)) if number else loads
    return replace(structure, pads=pads, loads=loads)


def _travelling(pad: Pad, travels: Mapping[str, Footprint]) -> Pad:
    own = next(one for name, one in travels.items() if pad.name.startswith(f"{name} "))
    return replace(pad, travel=(own.travel.first, own.travel.last))


def _stretch(pads: Pads) -> tuple[float, float]:
    """Where all rows are defined: those of ends are too."""
    travels = [pad.travel for pad in pads.moving if pad.travel is not None] or [pads.travel]
    return float(np.max([low for low, _ in travels])), float(np.min([high for _, high in travels]))
