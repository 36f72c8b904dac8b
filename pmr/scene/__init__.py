"""Scenes: what is built, how it moves, and what is computed of it (SI units, z up), validated and frozen.

`load` reads a scene file (TOML), follows its key ``extends``, applies overrides and returns a `Scene`.  A value that is
not allowed raises `pmr.errors.InputError` with file, key, value and what is allowed.
"""

from pmr.scene.built import Body, Load, MeshChoice, Support
from pmr.scene.files import has_sections, load, load_any, vary
from pmr.scene.run_settings import Compare, Published, Reduction, Simulation, TimeChoice
from pmr.scene.scene import Scene
from pmr.scene.structures import Damping

__all__ = [
    "Body", "Compare", "Damping", "Load", "MeshChoice", "Published", "Reduction", "Scene", "Simulation",
    "Support", "TimeChoice", "has_sections", "load", "load_any", "vary",
]  # fmt: skip
