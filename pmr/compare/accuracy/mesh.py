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

from pmr.compare.halved_steps import reference_rho
from pmr.compare.outputs import Floors, Outputs, differences, outputs
from pmr.reduced.model import ReducedModel
from pmr.scene import Scene
from pmr.scene.choice import model_of
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
    cells = scene.mesh
    if cells.file is not None:
        return None
    along, count = None if cells.along is None else cells.along / CELLS, int(BEAM * cells.elements)
    # Lengths that grow by the root of what they grew by have the same nodes, and one more in each element.
    grading = cells.grading ** ((count - 1) / (BEAM * max(1, cells.elements - 1)))
    changed = {"elements": count, "grading": grading, "size": cells.size / CELLS, "along": along}
    mesh = cells.model_copy(update=changed | {"tail_layer": cells.tail_layer / CELLS})
    return scene.model_copy(update={"mesh": mesh, "accuracy": None, "budget": None})


def mesh_error(
    model: ReducedModel, on_finer: ReducedModel, scene: Scene, tips: int, kinds: Sequence[str]
) -> dict[str, float]:
    """Part of the mesh by kind, fractions: of `model`, from the one with as many coordinates on the finer mesh.

    Both are hardly damped by the scheme, as what runs are compared with (`pmr.compare.halved_steps`).  Raises
    InputError or SimulationError as for `pmr.simulation.Simulator`.
    """
    excitation = Excitation.of(scene)
    stepping = excitation.stepping
    undamped = replace(stepping, rho_inf=reference_rho(model, stepping.rho_inf))
    excitation = excitation.with_stepping(undamped)
    own, better = (
        replace(motion, displacement=motion.displacement[:, places], velocity=motion.velocity[:, places])
        for motion, places in zip(
            (_motion(one, excitation, tips) for one in (model, on_finer)), _common(model, on_finer), strict=True
        )
    )
    by = BEAM if model_of(scene) in ("beam2d", "beam3d") else CELLS
    found = differences(own, better, Floors.of(model, excitation), kinds)
    return {kind: share / (1.0 - by**-ORDER) for kind, share in found.items()}


def _motion(model: ReducedModel, excitation: Excitation, tips: int) -> Outputs:
    form = modal_form(model)
    return outputs(form.body, march.simulate_modal(form, excitation), excitation, tips)


def _common(model: ReducedModel, on_finer: ReducedModel) -> tuple[list[int], list[int]]:
    """Numbers of the displacements that both models have: of many nodes not all are observed."""
    (own, x), (finer, finer_x) = (
        (np.array(one.output_names)[moved], one.output_positions[moved])
        for one, moved in ((one, length_outputs(one)) for one in (model, on_finer))
    )
    at, near = {name: k for k, name in enumerate(finer)}, SAME * np.ptp(x)
    common = [(k, at[name]) for k, name in enumerate(own) if name in at and abs(finer_x[at[name]] - x[k]) <= near]
    return [one for one, _ in common], [other for _, other in common]
