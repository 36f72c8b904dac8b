"""A small boom whose section slides by itself, and the mass of that section."""

from functools import cache
from types import SimpleNamespace

import free_boom

import pmr
from pmr.scene import Scene
from pmr.simulation.free_base import FreeBase
from pmr.simulation.native.free_motion import ExtensionRun
from pmr.system.system import System

G = 9.80665
#: Keys by which sections and pads are as stiff as rigid ones.
RIGID = (
    "section.body.material.young=2.1e16",
    "section.joint.tail.0.stiffness=1e13",
    "section.joint.mouth.0.stiffness=1e13",
)


def free(drive: str, stroke: tuple[float, float] = (0.3, 1.2), start: float = 0.6) -> str:
    """Key of an extension that is free, with what drives it."""
    extension = f"kind='free', stroke={list(stroke)}, start={start}, stop_travel=0.02, {drive}".rstrip(", ")
    return f"sections.fly.joint.extension={{{extension}}}"


def scene(*changes: str) -> Scene:
    return free_boom.scene("frame.second_order=false", *changes)


@cache
def system(*changes: str) -> System:
    """Reduce the boom of a scene; keys of time, and those of the extension but for its stroke, change nothing."""
    return pmr.reduce(scene(*changes)).system


@cache
def mass(*changes: str) -> float:
    """Mass in kg of what slides."""
    return float(FreeBase(scene(*changes), system(*changes)).boom.masses[1])


def simulated(*changes: str) -> SimpleNamespace:
    """Scene with the computed extension, the system, times, extension with rates (3, T), and columns by name."""
    made = (*(key for key in changes if not key.startswith(("time.", "sections.fly.joint.ext"))), free(""))
    as_free = scene(*changes)
    run = ExtensionRun(as_free, system(*made))
    moved = run.with_extension()
    samples = moved.sections[1].joint.extension.samples
    t = samples.times
    columns = {name.replace(" ", "_"): values for name, values in samples.cylinder.items()}
    return SimpleNamespace(
        t=t, s=samples.values, scene=moved, written=as_free, system=system(*made), mass=mass(*made), run=run, **columns
    )
