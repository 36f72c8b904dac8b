r"""What the mesh leaves out: the same reduced motion on a mesh with shorter cells.

.. math:: e_{mesh} \approx \frac{\lVert y_{l/c} - y_l \rVert}{1 - c^{-2}}

with cells c times as short.  Second order is less than what beams without shear and solids converge with, whose part is
thus taken to be larger than it is.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.compare.halved_steps import reference_rho
from pmr.compare.outputs import Floors, Outputs, differences, outputs
from pmr.reduced.model import ReducedModel
from pmr.scene import MeshChoice, Scene
from pmr.scene.choice import model_of
from pmr.scene.members import member_at
from pmr.simulation import Excitation
from pmr.simulation.modal import modal_form
from pmr.simulation.native import simulator as march
from pmr.system.body import length_outputs

Array = NDArray[np.float64]

#: Cells are so many times as short: beams have few of them, and with shells the coordinates grow with the square.
BEAM, CELLS = 2.0, 1.5
ORDER = 2.0
#: Places along the body are the same up to this share of its length.
SAME = 1e-9


def finer(scene: Scene) -> Scene | None:
    """The scene on a mesh with shorter cells; None where its mesh is a file."""
    cells = _shorter(scene.mesh)
    if cells is None:
        return None
    return scene.model_copy(update={"mesh": cells, "accuracy": None, "budget": None})


def finer_sections(boom: Scene) -> Scene | None:
    """The boom with shorter cells in all sections; None where the mesh of one is a file."""
    cells = [_shorter(part.mesh) for part in boom.sections]
    if not all(cells):
        return None
    parts = [part.model_copy(update={"mesh": mesh}) for part, mesh in zip(boom.sections, cells, strict=True)]
    return boom.model_copy(update={"sections": tuple(parts)})


def _shorter(cells: MeshChoice) -> MeshChoice | None:
    if cells.file is not None:
        return None
    along, count = None if cells.along is None else cells.along / CELLS, int(BEAM * cells.elements)
    # Lengths that grow by the root of what they grew by have the same nodes, and one more in each element.
    grading = cells.grading ** ((count - 1) / (BEAM * max(1, cells.elements - 1)))
    changed = {"elements": count, "grading": grading, "size": cells.size / CELLS, "along": along}
    return cells.model_copy(update=changed | {"tail_layer": cells.tail_layer / CELLS})


@dataclass(frozen=True)
class Meshed:
    """A motion, and of each displacement its name and where it is along its body in m."""

    outputs: Outputs
    places: Sequence[tuple[str, float]]


def part_of(
    own: Meshed, better: Meshed, floors: Floors, models: Collection[str], kinds: Sequence[str]
) -> dict[str, float]:
    """Part of the mesh by kind, fractions, of structural models by their names, from a motion on the finer mesh."""
    mine, theirs = _common(own.places, better.places)
    found = differences(own.outputs.moved_at(mine), better.outputs.moved_at(theirs), floors, kinds)
    by = BEAM if set(models) <= {"beam2d", "beam3d"} else CELLS
    return {kind: share / (1.0 - by**-ORDER) for kind, share in found.items()}


def mesh_error(
    model: ReducedModel, on_finer: ReducedModel, scene: Scene, tips: int, kinds: Sequence[str]
) -> dict[str, float]:
    """Part of the mesh of `model`, from the one with as many coordinates on the finer mesh.

    Both are hardly damped by the scheme, as what runs are compared with (`pmr.compare.halved_steps`).  Raises
    InputError or SimulationError as for `pmr.simulation.Simulator`.
    """
    excitation = Excitation.of(scene)
    stepping = excitation.stepping
    undamped = replace(stepping, rho_inf=reference_rho(model, stepping.rho_inf))
    excitation = excitation.with_stepping(undamped)
    own, better = (Meshed(_motion(one, excitation, tips), _places(one)) for one in (model, on_finer))
    return part_of(own, better, Floors.of(model, excitation), [model_of(member_at(scene))], kinds)


def _motion(model: ReducedModel, excitation: Excitation, tips: int) -> Outputs:
    form = modal_form(model)
    return outputs(form.body, march.simulate_modal(form, excitation), excitation, tips)


def _places(model: ReducedModel) -> list[tuple[str, float]]:
    moved = length_outputs(model)
    return list(zip(np.array(model.output_names)[moved], model.output_positions[moved], strict=True))


def _common(own: Sequence[tuple[str, float]], finer: Sequence[tuple[str, float]]) -> tuple[list[int], list[int]]:
    """Numbers of the displacements that both have: of many nodes not all are observed."""
    at, near = {name: k for k, (name, _) in enumerate(finer)}, SAME * np.ptp([x for _, x in own])
    common = [(k, at[name]) for k, (name, x) in enumerate(own) if name in at and abs(finer[at[name]][1] - x) <= near]
    return [one for one, _ in common], [other for _, other in common]
