"""What is built and what is asked: a scene (SI units), validated and frozen.

`load` reads a scene file (TOML), follows ``extends``, applies overrides and returns a `Scene`; anything that is not
allowed raises `pmr.errors.InputError` with file, key, value and what is allowed.
"""

from pmr.scene.files import from_data, load, vary, vary_beam
from pmr.scene.sections import (
    SUPPORT_ROWS,
    Body,
    Compare,
    Damping,
    Load,
    MeshChoice,
    Published,
    Reduction,
    Scene,
    SceneBase,
    Simulation,
)
from pmr.scene.space import StructureScene

__all__ = [
    "SUPPORT_ROWS",
    "Body",
    "Compare",
    "Damping",
    "Load",
    "MeshChoice",
    "Published",
    "Reduction",
    "Scene",
    "SceneBase",
    "Simulation",
    "StructureScene",
    "from_data",
    "load",
    "vary",
    "vary_beam",
]
