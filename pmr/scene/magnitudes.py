"""Sizes that double precision carries, and proportions that equations know."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from pmr.errors import InputError
from pmr.scene.scene import Scene
from pmr.scene.section import Quantity, Section, quantity_of
from pmr.scene.signals import SignalBase

Range = tuple[float, float]

#: Of a box: what its length is over its smaller side, and that side over its wall.
SLENDER, THIN = (0.01, 1e4), (0.0, 1e4)
#: Of a beam: its length over a section's radius of gyration.
GYRATION = (0.01, 1e6)
LARGEST_LOAD = 1e120  # N or N m; models are linear in it, their energies are its squares


def check_magnitudes(scene: Scene) -> None:
    """Refuse sizes that no computation in double precision can carry."""
    check_sizes(scene)
    _proportions(scene)
    for i, load in enumerate(scene.loads):
        _check_load(load.signal, f"loads[{i}].signal", scene.time.end)


def check_sizes(part: Section) -> None:
    """Refuse any number, in a section or in those within it, that is out of its range."""
    for key, value, known in _sized(part, ""):
        if not known.low <= value <= known.high:
            raise InputError(
                "scene", key, value, f"a number from {known.low:g} to {known.high:g} is allowed (SI units)"
            )


def _sized(part: Any, key: str, known: Quantity | None = None) -> Iterator[tuple[str, float, Quantity]]:
    """Key and value of every number in a section and in those within it, and what is known of it."""
    if isinstance(part, (int, float)) and known is not None:
        yield key, part, known
    elif isinstance(part, (tuple, list)):
        for i, one in enumerate(part):
            yield from _sized(one, f"{key}[{i}]", known)
    elif isinstance(part, dict):
        for name, one in part.items():
            yield from _sized(one, f"{key}.{name}", known)
    elif isinstance(part, Section):
        for name in type(part).model_fields:
            here = f"{key}.{name}" if key else name
            yield from _sized(getattr(part, name), here, quantity_of(type(part), name))


def _proportions(scene: Scene) -> None:
    box, section, profile = scene.body.box, scene.body.section, scene.body.profile
    if profile is not None and profile.axial_stiffness is not None:
        radius = float(np.sqrt(profile.bending_stiffness / profile.axial_stiffness))
        slender = profile.length / radius
        _check_ratio("body.profile.axial_stiffness", slender, GYRATION, "length over radius of gyration")
    if box is not None:
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
        largest = float(np.abs(signal.bounds(0.0, end)).max())
    if not largest <= LARGEST_LOAD:
        raise InputError("scene", key, None, f"at most {LARGEST_LOAD:g} N or N m are allowed, here it is {largest:.3g}")
