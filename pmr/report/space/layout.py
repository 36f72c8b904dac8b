"""Which column of a response is what, for a structure in space."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.report.figures.timeline import Quantity
from pmr.results import Fields, RunResult
from pmr.scene import StructureScene
from pmr.scene.choice import model_of, transverse
from pmr.scene.space import PadRing

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Force:
    """A pad's force: its column among the forces of a response, and what it is called within its ring."""

    column: int
    name: str


def scene_of(result: RunResult) -> StructureScene:
    """The scene of a structure in space."""
    assert isinstance(result.scene, StructureScene)
    return result.scene


def tips(scene: StructureScene) -> Mapping[str, Quantity]:
    """The tip's displacement, (T,) m, along each transverse direction: the last columns."""
    directions = transverse(scene)
    return {d: _column(k - len(directions)) for k, d in enumerate(directions)}


def forces(scene: StructureScene) -> dict[str, list[Force]]:
    """Pads by ring: those that stay and give way come first, then those that move.  Nothing else has a force."""
    faces = ("bottom", "top") if model_of(scene) == "beam2d" else ("bottom", "top", "left", "right")
    found: dict[str, list[Force]] = {}
    column = 0
    for ring in (*_staying(scene), *(ring for ring in scene.pads if ring.moving)):
        for name, face, _ in ring.places:
            if face in faces:
                found.setdefault(ring.name, []).append(Force(column, name.removeprefix(f"{ring.name} ")))
                column += 1
    return found


def mouths(scene: StructureScene) -> tuple[float, ...]:
    """Distances in m ahead of s at which rings move."""
    return tuple(dict.fromkeys(ring.at for ring in scene.pads if ring.moving)) or (0.0,)


def end_of(result: RunResult) -> float:
    """Where the body ends along its axis, m."""
    scene = scene_of(result)
    if scene.body.box is not None:
        return scene.body.box.length
    return float(result.fields.points[:, 0].max()) if result.fields is not None else scene.observe.end


def fields_of(result: RunResult) -> Fields | None:
    """The fields with the vertical along z, as pictures have it: the planar beam's own vertical is y."""
    fields = result.fields
    if fields is None or model_of(scene_of(result)) != "beam2d" or np.any(fields.displacement[..., 2]):
        return fields
    return replace(fields, displacement=fields.displacement[..., [0, 2, 1]])


def stress_times(result: RunResult) -> Array:
    """Times (F,) in s of the largest stresses."""
    count = max(map(len, result.peak_stress.values()), default=0)
    if result.fields is not None and len(result.fields.t) == count:
        return result.fields.t
    recovery = scene_of(result).recovery
    return np.arange(count) * (recovery.every if recovery else 0.0)


def _staying(scene: StructureScene) -> list[PadRing]:
    return [ring for ring in scene.pads if not ring.moving and ring.stiffness != "rigid"]


def _column(k: int) -> Quantity:
    return lambda response: response.displacement[:, k]
