"""Small boom of two sections on a base that moves freely."""

from functools import cache
from pathlib import Path

import pmr
from pmr import System
from pmr.scene import Scene
from pmr.simulation.free_base import with_all_inertia
from pmr.system.from_scene import system_of

FILE = Path(__file__).parent / "simulation" / "exudyn" / "free_boom.toml"


@cache
def scene(*changes: str) -> Scene:
    """Load the scene of the boom with changed keys."""
    return pmr.load_scene(FILE, list(changes))


@cache
def system(*changes: str) -> System:
    """Reduce the sections, with second order and with the inertia of all modes."""
    reduced = pmr.reduce(scene(*changes)).reduced
    return with_all_inertia(system_of(scene(*changes), reduced))


#: Keys by which its pads rub, on a cylinder that gives way.
RUBBING = (
    "section.joint.cylinder.stiffness=1e8",
    *(f"section.joint.{ring}.0.{key}" for ring in ("tail", "mouth") for key in ("friction=0.2", "shear_stiffness=1e7")),
)
#: Keys by which all its pads only push.
PUSHING = tuple(
    f"section.joint.{end}=[{{at=0.2, faces={{bottom=[-0.05, 0.05], top=[-0.05, 0.05], left=[0.0], right=[0.0]}}}}]"
    for end in ("tail", "mouth")
)
