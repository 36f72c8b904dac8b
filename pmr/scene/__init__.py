"""What is built and what is asked: a scene (SI units), validated and frozen.

`load` reads a scene file (TOML), follows ``extends``, applies overrides and returns a `Scene`; anything that is not
allowed raises `pmr.errors.InputError` with file, key, value and what is allowed.
"""

from pmr.scene.files import load, vary
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
    Simulation,
)

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
    "Simulation",
    "load",
    "vary",
]
