"""Which column of a response is what, for a structure in space."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.report.figures.timeline import Quantity
from pmr.results import Fields, Response, RunResult
from pmr.scene import StructureScene
from pmr.scene.choice import model_of, transverse
from pmr.system.body import force_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Force:
    """A pad's force: what a response calls it, and what it is called within its ring.

    `column` is where it stands in a response without names.
    """

    column: int
    name: str
    called: str

    def of(self, response: Response) -> Array:
        """The force over time, (T,) N."""
        return response.force(self.called, self.column)


def scene_of(result: RunResult) -> StructureScene:
    """The scene of a structure in space."""
    assert isinstance(result.scene, StructureScene)
    return result.scene


def tips(scene: StructureScene) -> Mapping[str, Quantity]:
    """The tip's displacement, (T,) m, along each transverse direction: the last columns, where none has a name."""
    directions = transverse(scene)
    return {d: _column(scene.observe.tip_along(d), k - len(directions)) for k, d in enumerate(directions)}


def forces(result: RunResult) -> dict[str, list[Force]]:
    """Pads by ring, those that stay first: all whose force the reduced model's response holds."""
    scene, known = scene_of(result), result.responses["reduced"].force_names
    columns = {name: column for column, name in enumerate(known or _unnamed(scene))}
    found: dict[str, list[Force]] = {}
    for ring in sorted(scene.pads, key=lambda ring: ring.moving):
        for name, _, _ in ring.places:
            if (called := force_of(name)) in columns:
                pad = Force(columns[called], name.removeprefix(f"{ring.name} "), called)
                found.setdefault(ring.name, []).append(pad)
    return found


def _unnamed(scene: StructureScene) -> list[str]:
    """Forces in the order of results that don't say it: outputs before rows, those of rows that move last."""
    faces = ("bottom", "top") if model_of(scene) == "beam2d" else ("bottom", "top", "left", "right")
    staying = [ring for ring in scene.pads if not ring.moving and ring.stiffness != "rigid"]
    rings = [*sorted(staying, key=lambda ring: ring.unilateral), *(ring for ring in scene.pads if ring.moving)]
    return [force_of(name) for ring in rings for name, face, _ in ring.places if face in faces]


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


def _column(name: str, unnamed: int) -> Quantity:
    def displacement(response: Response) -> Array:
        column = response.output_names.index(name) if response.output_names else unnamed
        return response.displacement[:, column]

    return displacement
