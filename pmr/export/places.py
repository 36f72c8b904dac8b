"""State spaces of a saved system with its places held: where its paths are asked to be, or a section of it alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.export.formats import Options
from pmr.reduced.model import ReducedModel
from pmr.scene.names import ALONE
from pmr.simulation.moving import path_ranges
from pmr.simulation.state_space import StateSpace, state_space
from pmr.system.saved import read
from pmr.system.system import System

Array = NDArray[np.float64]
#: Along the paths where none are asked for.
PLACES = 21


def held_at(npz_path: Path, options: Options) -> StateSpace:
    """State space of a saved system at its places; errors as of `load_places` and `state_space`."""
    return state_space(*load_places(npz_path, options), npz_path.name)


def load_places(npz_path: Path, options: Options) -> tuple[System, Mapping[str, Array]]:
    """A saved system and its `places`, or one of its sections without the contacts of its joints.

    Raises InputError as `places` and `section_alone`.
    """
    if options.section is None:
        system = System.load(npz_path).ensure_constant(npz_path.name)
        return system, places(system, options.at)
    if options.at is not None:
        allowed = "none is allowed with --section: without its joints nothing of a section depends on a place"
        raise InputError("command line", "--at", options.at, allowed)
    return section_alone(npz_path, options.section), {}


def section_alone(npz_path: Path, name: str) -> System:
    """One section of a saved boom, or of the file of a section, on its own supports or free; an InputError if not."""
    saved = read(npz_path)
    bodies = {saved.section.name if saved.section else "": saved} if isinstance(saved, ReducedModel) else saved.bodies
    sections = [body for body, model in bodies.items() if model.section is not None]
    if name not in sections:
        allowed = f"{', '.join(map(repr, sections))} is allowed, of which {npz_path.name} has the model"
        if not sections:
            allowed = "none is allowed: this is the model of a whole body"
        raise InputError("command line", "--section", name, allowed)
    alone = System.of(bodies[name].without_joints())
    held = tuple(replace(contact, inner=replace(contact.inner, body=name)) for contact in alone.contacts)
    return System({name: alone.bodies[ALONE]}, held)


def places(system: System, text: str | None) -> Mapping[str, Array]:
    """Coordinates (S,) in m of each path: those asked for, or a grid from the first to the last ends of all.

    One path is asked for as ``1.5,2,4``, several as ``mid=2,fly=3; mid=2.5,fly=3``; an InputError is raised off them.
    """
    ranges = system.ranges
    if text is None:
        ends = path_ranges(system)
        count = PLACES if any(high > low for low, high in ends.values()) else 1
        return {path: np.linspace(low, high, count) for path, (low, high) in ends.items()}
    if not ranges:
        raise InputError("command line", "--at", text, "none is allowed: nothing travels")
    allowed = f"places from {', '.join(f'{low:g} to {high:g} m' for low, high in ranges.values())}"
    allowed += ", separated by commas, are allowed"
    if len(ranges) > 1:
        of_each = ",".join(f"{path}={low:g}" for path, (low, _) in ranges.items())
        allowed_ranges = ", ".join(f"{path} from {low:g} to {high:g} m" for path, (low, high) in ranges.items())
        allowed = f"each path by its name, places separated by ;, is allowed, such as {of_each!r}: {allowed_ranges}"
    try:
        points = _parse(text, list(ranges)) if "=" in text or len(ranges) > 1 else _plain(text, next(iter(ranges)))
    except ValueError:
        raise InputError("command line", "--at", text, allowed) from None
    for path, (low, high) in ranges.items():
        if not np.all((points[path] >= low) & (points[path] <= high)):  # NaN neither
            raise InputError("command line", "--at", text, allowed)
    return points


def _plain(text: str, path: str) -> Mapping[str, Array]:
    """Places on the one path, ascending."""
    return {path: np.array(sorted({float(part) for part in text.split(",")}))}


def _parse(text: str, paths: list[str]) -> Mapping[str, Array]:
    """Places on several paths as they were asked for; a ValueError is raised where they are not all of them."""
    places_by_path = [
        {name.strip(): float(value) for name, value in (part.split("=") for part in place.split(","))}
        for place in text.split(";")
    ]
    if any(set(place) != set(paths) for place in places_by_path):
        raise ValueError(text)
    return {path: np.array([place[path] for place in places_by_path]) for path in paths}
