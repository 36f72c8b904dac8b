"""A small boom of two sections for bases that move freely."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import pmr
from pmr.scene import Scene
from pmr.simulation.free_base import with_all_inertia
from pmr.system.from_scene import system_of
from pmr.system.system import System

FILE = Path(__file__).parent / "simulation" / "exudyn" / "free_boom.toml"


@cache
def scene(*changes: str) -> Scene:
    """With keys changed."""
    return pmr.load_scene(FILE, list(changes))


@cache
def system() -> System:
    """Its sections, reduced, with second order; all modes have inertia."""
    reduced = pmr.reduce(scene()).reduced
    return with_all_inertia(system_of(scene(), reduced))
