r"""What the mesh leaves out: the same reduced motion on a mesh with shorter cells.

.. math:: e_{mesh} \approx \frac{\lVert y_{l/c} - y_l \rVert}{1 - c^{-2}}

with cells c times as short.  Second order is less than what beams without shear and solids converge with, whose part is
thus taken to be larger than it is.

Where nobody asks, walls are compared with those of cells twice as long, whose reduction takes half of the run's own
or less:

.. math:: e_{mesh} \approx \frac{\lVert y_{2 l} - y_l \rVert}{2^p - 1}, \qquad p = 1

On such cells the motion under pads, whose edges lie within cells, is far from second order.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np

from pmr.compare.accuracy.family import Family, Member
from pmr.compare.outputs import differences
from pmr.errors import InputError
from pmr.scene import MeshChoice, Scene
from pmr.scene.choice import model_of
from pmr.scene.members import members
from pmr.scene.richer import EACH, rectangles

#: Cells are so many times as short: beams have few of them, and with shells the coordinates grow with the square.
BEAM, CELLS = 2.0, 1.5
ORDER = 2.0
#: Of walls that are compared with coarser ones: how many times as long, and with which power of it they converge.
COARSER, FIRST_ORDER = 2.0, 1.0
#: Of coarser walls: rectangles of cells of all bodies, some 6 ms each.
MOST_RECTANGLES = 1000
#: Of beams whose mesh is judged without being asked for.
MOST_ELEMENTS = 120
#: Places along the body are the same up to this share of its length.
SAME = 1e-9


def finer(scene: Scene) -> Scene | None:
    """The scene with shorter cells in all bodies; None where the mesh of one is a file."""
    cells = [_shorter(part.mesh) for part in scene.sections]
    if not all(cells):
        return None
    parts = [part.model_copy(update={"mesh": mesh}) for part, mesh in zip(scene.sections, cells, strict=True)]
    return scene.model_copy(update={"sections": tuple(parts)})


def finer_beams(scene: Scene) -> Scene:
    """The scene with twice as many elements, of beams with rigid walls, whose reduction takes no time.

    Raises an `InputError` that says why the part of the mesh is to be asked for.
    """
    why, ask = "", "not measured; [accuracy] measures it"
    if not all(model_of(member) in ("beam2d", "beam3d") for member in members(scene)):
        why = f"{ask}, by a second reduction on cells two thirds as long"
    elif any(part.body.walls == "give" for part in scene.sections):
        why = f"{ask}, with the cells on which walls give way"
    elif sum(part.mesh.elements for part in scene.sections) > MOST_ELEMENTS:
        why = ask
    found = finer(scene)
    if why or found is None:
        raise InputError("scene", "mesh", None, why or "a mesh that is read from a file has no finer one")
    return _once(found)


def coarser_walls(scene: Scene) -> Scene:
    """The scene on cells twice as long, of shells, solids and walls that give way; beams have half as many elements.

    Raises an `InputError` that says how the part of the mesh is measured instead.
    """
    if any(part.mesh.file is not None for part in scene.sections):
        raise InputError("scene", "mesh", None, "a mesh that is read from a file has no coarser one")
    parts, count = [], 0.0
    for part in scene.sections:
        along = None if part.mesh.along is None else COARSER * part.mesh.along
        changed = {"size": COARSER * part.mesh.size, "along": along, "tail_layer": COARSER * part.mesh.tail_layer}
        cells = part.mesh.model_copy(update=changed | {"elements": max(2, part.mesh.elements // 2)})
        count += rectangles(part, COARSER) if part.body.box is not None else 0.0
        parts.append(part.model_copy(update={"mesh": cells}))
    if count > MOST_RECTANGLES:
        seconds = EACH * count
        ask = f"not measured: it would take some {seconds:.0f} s; [accuracy] measures it, on cells two thirds as long"
        raise InputError("scene", "mesh", None, ask)
    return _once(scene.model_copy(update={"sections": tuple(parts)}))


def unasked(scene: Scene, beside_own: Callable[[Callable[[Scene], Scene], str], Mapping[str, Any]]) -> dict[str, Any]:
    """``mesh`` of the budget by kind, and its ``mesh_reason``.

    `beside_own` tells what a scene that is made of this one, and called so, is apart from it.
    """
    if all(model_of(member) in ("beam2d", "beam3d") and member.part.body.walls == "rigid" for member in members(scene)):
        found, share = beside_own(finer_beams, "finer mesh"), 1.0 / (1.0 - BEAM**-ORDER)
    else:
        found, share = beside_own(coarser_walls, "coarser mesh"), 1.0 / (COARSER**FIRST_ORDER - 1.0)
    kinds = [kind for kind in ("beam", "tip", "pad_force", "cylinder_force") if found.get(kind) is not None]
    return {"mesh": {kind: share * found[kind] for kind in kinds} or None, "mesh_reason": found.get("reason")}


def _once(scene: Scene) -> Scene:
    """Reduced and simulated for its motion alone."""
    once = scene.simulation.model_copy(update={"simulators": ("march",), "repeats": 1})
    parts = [
        part.model_copy(update={"reduction": part.reduction.model_copy(update={"estimate": False})})
        for part in scene.sections
    ]
    return scene.model_copy(update={"sections": tuple(parts), "simulation": once, "recovery": None})


def _shorter(cells: MeshChoice) -> MeshChoice | None:
    if cells.file is not None:
        return None
    along, count = None if cells.along is None else cells.along / CELLS, int(BEAM * cells.elements)
    # Lengths that grow by the root of what they grew by have the same nodes, and one more in each element.
    grading = cells.grading ** ((count - 1) / (BEAM * max(1, cells.elements - 1)))
    changed = {"elements": count, "grading": grading, "size": cells.size / CELLS, "along": along}
    return cells.model_copy(update=changed | {"tail_layer": cells.tail_layer / CELLS})


def part_of(
    own: Family, better: Family, member: Member, steps: int, models: Collection[str], kinds: Sequence[str]
) -> dict[str, float]:
    """Part of the mesh by kind, fractions, of bodies of some structural `models`: the same member on the finer mesh.

    Both are hardly damped by the scheme, as what runs are compared with (`pmr.compare.halved_steps`).  Raises
    InputError or SimulationError as for `pmr.simulation.Simulator`.
    """
    common = _common(own.places, better.places)
    one, other = (
        family.motion(member, steps, steps).moved_at(places)
        for family, places in zip((own, better), common, strict=True)
    )
    by = BEAM if set(models) <= {"beam2d", "beam3d"} else CELLS
    return {
        kind: share / (1.0 - by**-ORDER) for kind, share in differences(one, other, own.floors(steps), kinds).items()
    }


def _common(own: Sequence[tuple[str, float]], finer: Sequence[tuple[str, float]]) -> tuple[list[int], list[int]]:
    """Numbers of the displacements that both have: of many nodes not all are observed."""
    at, near = {name: k for k, (name, _) in enumerate(finer)}, SAME * np.ptp([x for _, x in own])
    common = [(k, at[name]) for k, (name, x) in enumerate(own) if name in at and abs(finer[at[name]][1] - x) <= near]
    return [one for one, _ in common], [other for _, other in common]
