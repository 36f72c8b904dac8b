"""Sizes that double precision carries: what lies beyond is a slip of the pen, and ends in figures that mean nothing.

The bounds are far from all that is built, so that models in any consistent units pass; ratios are what equations know.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from pydantic import BaseModel

from pmr.errors import InputError
from pmr.scene.sections import Body, Damping, MeshChoice, Scene, SceneBase, Support, TimeChoice
from pmr.scene.signals import SignalBase, bounds
from pmr.scene.space import (
    Box,
    Gravity,
    Holder,
    Observe,
    PadRing,
    Recovery,
    Region,
    SpaceBody,
    SpaceMesh,
    StructureScene,
)
from pmr.scene.structures import BeamSection, Material, PointMass

Range = tuple[float, float]

LENGTH: Range = (1e-6, 1e6)  # m
AT_MOST_LENGTH: Range = (0.0, 1e6)
PLACE: Range = (-1e6, 1e6)
STIFFNESS: Range = (1e-6, 1e15)  # N/m; what is stiffer is "rigid"
AREA: Range = (1e-14, 1e10)  # m^2
SECOND_MOMENT: Range = (1e-26, 1e20)  # m^4
#: Of beams in space: round-off in the stiffness grows with the fourth power of the number, 5000 leave two digits of the
#: lowest frequency.  What a planar beam's cost it is said of the run.
ELEMENTS: Range = (1, 5000)

#: Of keys of sections, in SI units.
ALLOWED: dict[type[BaseModel], dict[str, Range]] = {
    Body: {"length": LENGTH, "bending_stiffness": (1e-15, 1e25), "mass_per_length": (1e-12, 1e12),
           "axial_stiffness": (1e-9, 1e25)},
    Support: {"at": AT_MOST_LENGTH},
    MeshChoice: {"elements": (1, 1_000_000)},
    Box: {"length": LENGTH, "width": LENGTH, "height": LENGTH, "wall": LENGTH, "radius": AT_MOST_LENGTH,
          "frame_depth": AT_MOST_LENGTH},
    SpaceBody: {"thickness": LENGTH, "shear_correction": (1e-3, 1e6)},
    SpaceMesh: {"elements": ELEMENTS},
    Region: {"thickness": LENGTH},
    Material: {"young": (1e-3, 1e18), "poisson": (-0.99, 0.4999), "density": (1e-9, 1e9)},
    BeamSection: {"area": AREA, "second_moment_y": SECOND_MOMENT, "second_moment_z": SECOND_MOMENT,
                  "torsion_constant": SECOND_MOMENT, "shear_area_y": AREA, "shear_area_z": AREA},
    PointMass: {"mass": (0.0, 1e12), "inertia": (0.0, 1e15), "at": PLACE},
    PadRing: {"at": PLACE, "length": LENGTH, "width": LENGTH, "stiffness": STIFFNESS, "clearance": AT_MOST_LENGTH},
    Holder: {"stiffness": STIFFNESS},
    Gravity: {"acceleration": (1e-9, 1e6), "rise": (0.0, 1e9)},
    Damping: {"mass": (0.0, 1e9), "stiffness": (0.0, 1e6)},
    TimeChoice: {"end": (1e-9, 1e9), "step": (1e-12, 1e9)},
    Observe: {"start": PLACE, "end": PLACE, "count": (1, 10_000)},
    Recovery: {"every": (1e-12, 1e9), "frames": (1, 1_000_000)},
}  # fmt: skip

#: Of a box: what its length is over its smaller side, and that side over its wall.
SLENDER, THIN = (0.01, 1e4), (0.0, 1e4)
#: Of a beam: its length over a section's radius of gyration.
GYRATION = (0.01, 1e6)
LARGEST_LOAD = 1e120  # N or N m; models are linear in it, their energies are its squares


def check_magnitudes(scene: SceneBase) -> None:
    """Refuse sizes that no computation in double precision can carry.

    Raises
    ------
    InputError
        With the key and its range.
    """
    for key, value, (low, high) in _sized(scene, ""):
        if not low <= value <= high:
            raise InputError("scene", key, value, f"a number from {low:g} to {high:g} is allowed (SI units)")
    _proportions(scene)
    if isinstance(scene, (Scene, StructureScene)):
        for i, signal in enumerate(list(scene.signals.values())[: len(scene.loads)]):  # the weight comes last
            _check_load(signal, f"loads[{i}].signal", scene.time.end)


def _sized(part: Any, key: str) -> Iterator[tuple[str, float, Range]]:
    """Key, value and range of every number in a section and in those within it."""
    if isinstance(part, (tuple, list)):
        for i, one in enumerate(part):
            yield from _sized(one, f"{key}[{i}]")
    elif isinstance(part, dict):
        for name, one in part.items():
            yield from _sized(one, f"{key}.{name}")
    elif isinstance(part, BaseModel) and not isinstance(part, SignalBase):
        allowed = ALLOWED.get(type(part), {})
        for name in type(part).model_fields:
            value, here = getattr(part, name), f"{key}.{name}" if key else name
            if name in allowed:
                yield from ((where, number, allowed[name]) for where, number in _numbers(value, here))
            else:
                yield from _sized(value, here)


def _numbers(value: Any, key: str) -> Iterator[tuple[str, float]]:
    """The numbers of a key: it may hold one, several, some by name, a word or nothing."""
    if isinstance(value, (int, float)):
        yield key, value
    elif isinstance(value, (tuple, list)):
        for i, one in enumerate(value):
            yield from _numbers(one, f"{key}[{i}]")
    elif isinstance(value, dict):
        for name, one in value.items():
            yield from _numbers(one, f"{key}.{name}")


def _proportions(scene: SceneBase) -> None:
    if isinstance(scene, Scene):
        if scene.body.axial_stiffness is not None:
            radius = float(np.sqrt(scene.body.bending_stiffness / scene.body.axial_stiffness))
            _check_ratio("body.axial_stiffness", scene.body.length / radius, GYRATION, "length over radius of gyration")
    elif isinstance(scene, StructureScene) and scene.body.box is not None:
        box, section = scene.body.box, scene.body.section
        side = min(box.width, box.height)
        _check_ratio("body.box.length", box.length / side, SLENDER, "length over the smaller side")
        _check_ratio("body.box.width", box.width / box.height, (1e-3, 1e3), "width over height")
        _check_ratio("body.box.wall", side / box.wall, THIN, "the smaller side over the wall")
        if section is not None:
            for name in ("second_moment_y", "second_moment_z", "torsion_constant"):
                slender = box.length / float(np.sqrt(getattr(section, name) / section.area))
                _check_ratio(f"body.section.{name}", slender, GYRATION, "length over radius of gyration")


def _check_ratio(key: str, found: float, allowed: Range, what: str) -> None:
    if not allowed[0] <= found <= allowed[1]:
        said = f"a ratio of {what} from {allowed[0]:g} to {allowed[1]:g} is allowed, here it is {found:.3g}"
        raise InputError("scene", key, None, said)


def _check_load(signal: SignalBase, key: str, end: float) -> None:
    with np.errstate(all="ignore"):
        largest = float(np.abs(bounds(signal, 0.0, end)).max())
    if not largest <= LARGEST_LOAD:
        raise InputError("scene", key, None, f"at most {LARGEST_LOAD:g} N or N m are allowed, here it is {largest:.3g}")
