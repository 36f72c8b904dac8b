"""Sizes that double precision carries, and proportions that equations know."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from pmr.errors import InputError
from pmr.scene.scene import Scene
from pmr.scene.section import Section, quantity_of
from pmr.scene.signals import SignalBase, bounds

Range = tuple[float, float]

#: Of a box: what its length is over its smaller side, and that side over its wall.
SLENDER, THIN = (0.01, 1e4), (0.0, 1e4)
#: Of a beam: its length over a section's radius of gyration.
GYRATION = (0.01, 1e6)
LARGEST_LOAD = 1e120  # N or N m; models are linear in it, their energies are its squares


def check_magnitudes(scene: Scene) -> None:
    """Refuse sizes that no computation in double precision can carry.

    Raises
    ------
    InputError
        With the key and its range.
    """
    check_sizes(scene)
    _proportions(scene)
    for i, load in enumerate(scene.loads):
        _check_load(load.signal, f"loads[{i}].signal", scene.time.end)


def check_sizes(part: Section) -> None:
    """Refuse any number, in a section or in those within it, that is out of its range.

    Raises
    ------
    InputError
        With the key and its range.
    """
    for key, value, (low, high) in _sized(part, ""):
        if not low <= value <= high:
            raise InputError("scene", key, value, f"a number from {low:g} to {high:g} is allowed (SI units)")


def _sized(part: Any, key: str) -> Iterator[tuple[str, float, Range]]:
    """Key, value and range of every number in a section and in those within it."""
    if isinstance(part, (tuple, list)):
        for i, one in enumerate(part):
            yield from _sized(one, f"{key}[{i}]")
    elif isinstance(part, dict):
        for name, one in part.items():
            yield from _sized(one, f"{key}.{name}")
    elif isinstance(part, Section):
        for name in type(part).model_fields:
            value, here, known = getattr(part, name), f"{key}.{name}" if key else name, quantity_of(type(part), name)
            if known is not None:
                yield from ((where, number, (known.low, known.high)) for where, number in _numbers(value, here))
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
        largest = float(np.abs(bounds(signal, 0.0, end)).max())
    if not largest <= LARGEST_LOAD:
        raise InputError("scene", key, None, f"at most {LARGEST_LOAD:g} N or N m are allowed, here it is {largest:.3g}")
