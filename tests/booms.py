"""Reference boom of workflows/boom_beam.toml with any structural model."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from pmr import scene as scenes
from pmr.fullmodel.from_scene import structure_of
from pmr.fullmodel.structure import Structure
from pmr.models import StructuralModel
from pmr.scene.members import member_at
from pmr.simulation import Excitation


@dataclass(frozen=True)
class Boom:
    """Structure of the reference boom, and the excitation that moves it."""

    structure: Structure
    excitation: Excitation


def boom(model: StructuralModel, span: float = 10.0, overrides: Sequence[str] = ()) -> Boom:
    """Build the reference boom with a structural model, over `span` s, with further settings of its scene."""
    scene = scenes.load("boom_beam", [f"time.end={span}", *overrides])
    return Boom(replace(structure_of(member_at(scene)), model=model), Excitation.from_scene(scene))
