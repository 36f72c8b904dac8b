"""A machine on outriggers in a system's block: its data, and names and units of its outputs (src/ground.c)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pmr.files.arrays import Array
from pmr.kernel.further import AXES, Arrays, Frame, numbers_of_forces
from pmr.scene import Scene
from pmr.scene.built import force_name, reaction_name
from pmr.scene.ground import MachineMass, edge_rows
from pmr.scene.keys import LUFFING
from pmr.scene.mechanism import AT_GROUND, TIPPING_MARGIN, cylinder_force_names, ground_contact_wrenches
from pmr.system.system import System

#: Directions of force and moment on the ground, with their units.
DIRECTIONS = dict.fromkeys(("x", "y", "z"), "N") | dict.fromkeys(("rx", "ry", "rz"), "N m")


def ground_outputs(scene: Scene) -> dict[str, str]:
    """Units by name of a scene's force and moment on the ground, of outriggers, margins, and the use of the polygon.

    There are none without a ground.
    """
    ground = None if scene.frame is None else scene.frame.ground
    if ground is None:
        return {}
    corners = [corner.name for corner in ground.corners]
    edges = zip(corners, (*corners[1:], corners[0]), strict=True)
    return {
        **{reaction_name(f"{AT_GROUND} {direction}"): unit for direction, unit in DIRECTIONS.items()},
        **{force_name(f"outrigger {outrigger.name}"): "N" for outrigger in ground.outriggers},
        **{f"{TIPPING_MARGIN}{first} to {second}": "N m" for first, second in edges},
        "use of the support polygon": "1",
    }


def mass_numbers(masses: Sequence[MachineMass]) -> Array:
    """Numbers (m, 8) of the masses of a machine in the kernel's order (`pmr_masses_wrench`)."""
    rows = [[mass.mass, *mass.at, *mass.inertia, mass.slews] for mass in masses]
    return np.array(rows, float).reshape(-1, 8)


def ground_arrays(frame: Frame, system: System, paths: Sequence[str], reactions: Sequence[str]) -> Arrays:
    """Arrays of the outriggers of a system with these paths and reactions of rigid supports; empty without any.

    They are empty, too, where a force between boom and ground is not known.  Of each force on the ground there is the
    wrench (6,) about the pivot by a unit of it, and the change of that by 1 m of each of P paths: (6, 1 + P).
    """
    scene = frame.scene
    ground = None if scene.frame is None else scene.frame.ground
    if ground is None:
        return {}
    numbers = numbers_of_forces(system, reactions)
    unit, still = np.eye(len(paths) + 1), np.zeros(len(paths) + 1)
    along = {name: unit[1 + paths.index(name)] if name in paths else still for name in scene.paths} | {LUFFING: still}
    sources, wrenches, cylinder = list[int](), list[Array](), -1
    for pressed in ground_contact_wrenches(scene, along):
        name = next((name for name in pressed.names if name in numbers), None)
        if name is None:
            return {}
        if scene.holding_cylinder is not None and name in cylinder_force_names(scene):
            cylinder = numbers[name]
            continue
        sources.append(numbers[name])
        wrenches.append(np.vstack([pressed.wrench[:1], pressed.wrench[1:] - pressed.wrench[0]]).T)
    motions = [frame.drivers.index(name) if name in frame.drivers else -1 for name in (*AXES, "gravity")]
    of_cylinder = None if scene.frame is None else scene.frame.cylinder
    hinges = (0.0,) * 4 if of_cylinder is None else (*of_cylinder.foot, *of_cylinder.lug)
    places = [place for outrigger in ground.outriggers for place in outrigger.at]
    stiffness = [outrigger.stiffness for outrigger in ground.outriggers]
    edges = edge_rows(ground.polygon, ground.height).ravel()
    return {
        "ground_numbers": np.array([*motions, cylinder]),
        "ground_sources": np.array(sources, np.int64),
        "ground_wrenches": np.array(wrenches).ravel(),
        "ground_masses": mass_numbers(ground.masses).ravel(),
        "ground_corners": np.array(ground.corner_numbers),
        "ground_stand": np.array([ground.height, *hinges, *places, *stiffness, *edges], float),
    }
