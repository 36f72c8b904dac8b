"""From a scene to its full model."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from pmr.fem.compat import MPI
from pmr.fullmodel.from_scene import structure_of
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.structure import Structure, structural_model
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
    return Built(structural_model(structure, comm), structure)


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
