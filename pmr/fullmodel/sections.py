"""Full models of a boom's sections: what each is, with rows wherever pads of its joints sit, and along the boom."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pmr.constraints.straight import Straight
from pmr.fem.compat import MPI
from pmr.fullmodel.build import Built
from pmr.fullmodel.from_scene import structure_of
from pmr.fullmodel.pads import Pad, Pads, Support
from pmr.fullmodel.structure import Structure, Weight, structural_model
from pmr.scene import Boom
from pmr.scene.boom_parts import DRIVEN, POINT, TAIL, Footprint, footprints, is_axial, section_scene, stiffened


def build_sections(boom: Boom, comm: MPI.Comm = MPI.COMM_WORLD) -> Mapping[str, Built]:
    """By the sections' names; equal ones are one and the same.  Collective.

    Raises
    ------
    InputError
        If a mesh can't be had, lacks a group, or a pad leaves its face.
    """
    made, found = dict[str, Built](), dict[str, Built]()
    for number, name in enumerate(boom.names):
        key = section_scene(boom, number).without_loads().hash
        if key not in made:
            structure = _structure(boom, number, comm)
            made[key] = Built(structural_model(structure, comm), structure)
        found[name] = made[key]
    return found


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
    if number and is_axial(boom, number):
        pads = replace(pads, ends=(Support(TAIL, "tail", "x"),), travel=_stretch(pads))
        loads = (*loads, Weight((-1.0, 0.0, 0.0), DRIVEN))
    return replace(structure, pads=pads, loads=loads)


def _travelling(pad: Pad, travels: Mapping[str, Footprint]) -> Pad:
    own = next(one for name, one in travels.items() if pad.name.startswith(f"{name} "))
    return replace(pad, travel=(own.travel.first, own.travel.last))


def _stretch(pads: Pads) -> tuple[float, float]:
    """Where all rows are defined: those of ends are too."""
    travels = [pad.travel for pad in pads.moving if pad.travel is not None] or [pads.travel]
    return float(np.max([low for low, _ in travels])), float(np.min([high for _, high in travels]))
