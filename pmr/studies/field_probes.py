"""Probes at all stress points of the walls of bodies: a load chart's limit of the field looks at them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from pmr.errors import InputError
from pmr.scene import Scene
from pmr.scene.choice import model_of
from pmr.scene.keys import named
from pmr.scene.members import members
from pmr.scene.structures import Probe

#: What their names begin with, behind the body's; faces that are looked at, where cells have them.
FIELD, FACES = "field of ", ("outer", "inner")
#: Bodies that have one; what a mesh without regions is called.
MODELS, WHOLE = ("shell", "solid"), "walls"
#: Numbers that the places of a chart may need in all.
MOST = 2**27


def bodies_with_field(scene: Scene) -> list[str]:
    """Names of shells and solids, as limits choose among them."""
    named_members = zip(scene.names, members(scene), strict=True)
    return [name or WHOLE for name, member in named_members if model_of(member) in MODELS]


def with_fields(scene: Scene, patterns: Sequence[str], places: int) -> Scene:
    """The scene with probes at all stress points of bodies, or of their regions, whose name fits one of the patterns.

    A region is called as its body and itself, ``fly: flange``.  An InputError is raised where nothing fits, or where so
    many points at so many places would fill the memory.
    """
    if not patterns:
        return scene
    from pmr.studies import shared

    built, parts, count = shared.bodies_of(scene), list[Any](), 0
    for name, part in zip(scene.names, scene.sections, strict=True):
        probes = list(_probes(name, built[name].structure.model, patterns))
        count += len(probes)
        parts.append(part.model_copy(update={"probes": (*part.probes, *probes)}))
    if not count:
        raise InputError("study", "limits.which", ", ".join(patterns), "a body or region with walls is allowed")
    contacts = 12 * len(scene.sections)
    if 3 * count * places * contacts > MOST:
        allowed = f"fewer places or a coarser mesh: {places} places look at {count} points each"
        raise InputError("study", "limits.which", ", ".join(patterns), allowed)
    return scene.model_copy(update={"sections": tuple(parts)})


def _probes(name: str, model: Any, patterns: Sequence[str]) -> Iterator[Probe]:
    rows = model.stresses() if hasattr(model, "stresses") else None
    if rows is None or not set(FACES) & set(rows.faces) and len(rows.components) < 6:
        return
    regions = dict(model.grid.regions) or {WHOLE: np.unique(rows.cell)}
    faces = [face_or_region for face_or_region in FACES if face_or_region in rows.faces] or list(rows.faces)
    for region, cells in regions.items():
        if not any(
            fnmatchcase(face_or_region, p) for face_or_region in (name or WHOLE, named(name, region)) for p in patterns
        ):
            continue
        for face in faces:
            at = rows.on(face)
            for number in at[np.isin(rows.cell[at], cells)].tolist():
                point = tuple(float(x) for x in rows.points[number])
                yield Probe(name=f"{FIELD}{region} {number}", at=point, face=face, measures=("stress",))
