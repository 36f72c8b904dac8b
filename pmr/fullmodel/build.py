"""From a scene of any kind to its full model."""

from __future__ import annotations

from dataclasses import dataclass

from pmr.fem.compat import MPI
from pmr.fullmodel.from_scene import structure_of
from pmr.fullmodel.model import FullModel, full_model
from pmr.fullmodel.structure import Structure, structural_model
from pmr.scene import Scene, SceneBase, StructureScene


@dataclass(frozen=True)
class Built:
    """A scene's full model, and in space the structure that it is assembled from."""

    model: FullModel
    structure: Structure | None = None


def build(scene: SceneBase, comm: MPI.Comm = MPI.COMM_WORLD) -> Built:
    """Assemble the full model of a scene on `comm`; collective.

    Raises
    ------
    InputError
        If the scene's mesh does not fit what stands on it.
    """
    if isinstance(scene, StructureScene):
        structure = structure_of(scene, comm)
        return Built(structural_model(structure, comm), structure)
    assert isinstance(scene, Scene)
    return Built(full_model(scene, comm))
