"""What other installed packages add: signals, models, bases, export formats and limits, by their entry points."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pmr.errors import InputError

#: Group of entry points, and what each of them has to be.
GROUPS = {
    "pmr.models": "a module, or an object, with KINDS of cells and of(body, mesh), as pmr.models.shell has them",
    "pmr.bases": "a function of a full model and a pmr.scene.Reduction that returns this rank's rows of vectors (n, k)",
    "pmr.signals": "a subclass of pmr.scene.signals.SignalBase whose `kind` is the entry point's name",
    "pmr.exports": "a pmr.export.formats.Format",
    "pmr.limits": "a function of a pmr.studies.limits.AtRest that returns a number",
}


@cache
def plugin_objects(group: str, reserved: frozenset[str]) -> dict[str, Any]:
    """Objects of a group by their names, of all installed distributions; `own` are the names that pmr has itself.

    Raises InputError where one can't be imported, or its name is taken.
    """
    objects: dict[str, Any] = {}
    for point in sorted(_points(group)):
        if point.name in reserved or point.name in objects:
            raise plugin_error(group, point.name, f"a name that nothing else has is allowed ({point.value})")
        try:
            objects[point.name] = point.load()
        except Exception as error:
            raise plugin_error(group, point.name, f"{point.value} can't be imported ({error})") from None
    return objects


def one_of(group: str, name: str, reserved: frozenset[str]) -> Any:
    """The object of that name.

    Raises InputError as `plugin_objects`, or where no package has the name: a file may come from another machine.
    """
    objects = plugin_objects(group, reserved)
    if name not in objects:
        raise plugin_error(group, name, "a name that an installed package offers is allowed")
    return objects[name]


def plugin_names(group: str) -> set[str]:
    """Names of all that installed distributions offer; nothing is imported."""
    return {point.name for point in _points(group)}


def plugin_error(group: str, name: str, says: str | None = None) -> InputError:
    """Return the error of an entry point; without `says`, that it is not what its group expects."""
    return InputError("installed plug-ins", group, name, says or f"{GROUPS[group]} is allowed")


def versions() -> list[str]:
    """Distributions that offer something and their versions: what a result depends on beside `pmr`."""
    points = [point for group in GROUPS for point in _points(group)]
    return sorted({f"{point.dist.name} {point.dist.version}" for point in points if point.dist})


def code_digest() -> str:
    """Digest of the versions and all files of installed plug-ins: what stored results depend on beside `pmr`.

    It holds the packages that entry points name, modules beside those that are single files, and what their
    distributions list as installed.  Files are read once in a process, as their code is.
    """
    return _code_digest(tuple(sys.path))


@cache
def _code_digest(path: tuple[str, ...]) -> str:
    points = _points_on(path)
    contents = {content for point in points for content in _contents_of(point)}
    named_by = sorted((point.group, point.name, point.value) for point in points)
    return hashlib.sha256(repr((named_by, versions(), sorted(contents))).encode()).hexdigest()


def _contents_of(point: metadata.EntryPoint) -> Iterator[tuple[str, str]]:
    """Names and digests of the files of the package or module that an entry point names, and of its distribution."""
    listed = (point.dist.files if point.dist else None) or ()
    files = {Path(str(file.locate())): str(file) for file in listed if ".dist-info/" not in str(file)}
    for place in _places_of(point.module):
        inside = place.rglob("*") if place.is_dir() else place.parent.glob("*.py")
        files |= {file: file.relative_to(place.parent).as_posix() for file in (*inside, place)}
    for file, name in files.items():
        if file.is_file() and "__pycache__" not in file.parts:
            yield name, hashlib.sha256(file.read_bytes()).hexdigest()


def _places_of(module: str) -> list[Path]:
    """Folders of the outermost regular package of a module, or its file; none where it is not there."""
    parts = module.split(".")
    for depth in range(1, len(parts) + 1):
        try:
            spec = find_spec(".".join(parts[:depth]))
        except (ImportError, ValueError):
            return []
        if spec is None:
            return []
        if spec.submodule_search_locations is not None and (spec.has_location or depth == len(parts)):
            return [Path(folder) for folder in spec.submodule_search_locations]
        if spec.submodule_search_locations is None:
            return [Path(spec.origin)] if spec.has_location and spec.origin else []
    return []


def _points(group: str) -> list[metadata.EntryPoint]:
    return [point for point in _points_on(tuple(sys.path)) if point.group == group]


@cache
def _points_on(path: tuple[str, ...]) -> list[metadata.EntryPoint]:
    """Entry points of all groups in the distributions on `path`; Python reads a file of each, so they are read once."""
    points = metadata.entry_points()
    return [point for group in GROUPS for point in points.select(group=group)]
