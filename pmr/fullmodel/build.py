"""From a scene to its full model."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from pmr.fem.compat import MPI
from pmr.fullmodel.from_scene import structure_of
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.structure import Structure, structural_model
from pmr.models.beam2d import Beam2D
from pmr.scene import Scene

logger = logging.getLogger(__name__)

#: Relative error of the lowest frequency from which on a mesh is called too fine.
NOTICED_ROUND_OFF = 1e-4


@dataclass(frozen=True)
class Built:
    """A scene's full model, and the structure that it is assembled from."""

    model: FullModel
    structure: Structure


def build(scene: Scene, comm: MPI.Comm = MPI.COMM_WORLD) -> Built:
    """Assemble the full model of a scene on `comm`; collective.

    Raises
    ------
    InputError
        If the scene's mesh does not fit what stands on it.
    """
    structure = structure_of(scene, comm)
    if comm.rank == 0:
        _say_round_off(structure)
    return Built(structural_model(structure, comm), structure)


def full_model(scene: Scene, comm: MPI.Comm = MPI.COMM_WORLD) -> FullModel:
    """The full model alone; as `build`."""
    return build(scene, comm).model


def _say_round_off(structure: Structure) -> None:
    model = structure.model
    if isinstance(model, Beam2D) and model.round_off > NOTICED_ROUND_OFF:
        logger.warning(
            "round-off in the stiffness of so short elements changes the lowest frequency by about %.0e of its value; "
            "fewer elements are more accurate",
            model.round_off,
        )
