r"""What the mesh leaves out: the same reduced motion on a mesh with shorter cells.

.. math:: e_{mesh} \approx \frac{\lVert y_{l/c} - y_l \rVert}{1 - c^{-2}}

with cells c times as short.  Second order is less than what beams without shear and solids converge with, whose part is
thus taken to be larger than it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pmr.compare.outputs import Floors, Outputs, differences, outputs
from pmr.reduced.model import ReducedModel
from pmr.scene import Scene
from pmr.scene.choice import model_of
from pmr.simulate import Excitation
from pmr.simulate.modal import modal_form
from pmr.simulate.native import simulator as march
from pmr.system.body import length_outputs

Array = NDArray[np.float64]

#: Cells are so many times as short: beams have few of them, and with shells the coordinates grow with the square.
BEAM, CELLS = 2.0, 1.5
ORDER = 2.0
#: Places along the body are the same up to this share of its length.
SAME = 1e-9


def finer(scene: Scene) -> Scene | None:
    """The scene on a mesh with shorter cells; None where its mesh is a file."""
    cells = scene.mesh
    if cells.file is not None:
        return None
    along = None if cells.along is None else cells.along / CELLS
    changed = {"elements": int(BEAM * cells.elements), "size": cells.size / CELLS, "along": along}
    mesh = cells.model_copy(update=changed | {"tail_layer": cells.tail_layer / CELLS})
    return scene.model_copy(update={"mesh": mesh, "accuracy": None, "budget": None})


def mesh_error(
    model: ReducedModel, on_finer: ReducedModel, scene: Scene, tips: int, kinds: Sequence[str]
) -> dict[str, float]:
    """Part of the mesh by kind, fractions: of `model`, from the one with as many coordinates on the finer mesh.

    Raises InputError or SimulationError as for `pmr.simulate.Simulator`.
    """
    excitation = Excitation.of(scene)
    own, better = (_motion(one, excitation, tips) for one in (model, on_finer))
    places = _places(model, on_finer)
    better = replace(better, displacement=better.displacement[:, places], velocity=better.velocity[:, places])
    by = BEAM if model_of(scene) in ("beam2d", "beam3d") else CELLS
    found = differences(own, better, Floors.of(model, excitation), kinds)
    return {kind: share / (1.0 - by**-ORDER) for kind, share in found.items()}


def _motion(model: ReducedModel, excitation: Excitation, tips: int) -> Outputs:
    form = modal_form(model)
    return outputs(form.body, march.simulate_modal(form, excitation), excitation, tips)


def _places(model: ReducedModel, on_finer: ReducedModel) -> NDArray[np.intp]:
    """Which displacements of the finer model are those of the other one: nodes of a beam are twice as many there."""
    x, finer_x = (one.output_positions[length_outputs(one)] for one in (model, on_finer))
    if len(x) == len(finer_x):
        return np.arange(len(x))
    nearest = np.abs(finer_x[None, :] - x[:, None]).argmin(axis=1)
    assert np.all(np.abs(finer_x[nearest] - x) <= SAME * np.ptp(x))
    return np.asarray(nearest)
