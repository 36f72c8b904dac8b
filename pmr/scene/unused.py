"""Keys that a scene file writes and that have no effect on what it describes: who writes one expects some."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pmr.scene.boom import Boom
from pmr.scene.boom_parts import is_axial, section_scene
from pmr.scene.choice import model_of
from pmr.scene.scene import Scene
from pmr.scene.structure_checks import refusal
from pmr.scene.tomlfiles import OPTION, TomlFile

_CELLS = ("size", "along", "tail_layer", "cells")
#: By model, keys that it has no use for.
UNUSED = {
    "beam2d": (*(f"mesh.{key}" for key in _CELLS), "body.shear_correction", "body.shear"),
    "beam3d": (*(f"mesh.{key}" for key in _CELLS), "body.shear_correction"),
    "shell": ("mesh.elements", "mesh.cells", "body.shear"),
    "solid": ("mesh.elements", "body.shear", "body.shear_correction"),
    "matrices": (
        *(f"mesh.{key}" for key in (*_CELLS, "elements")),
        *(f"body.{key}" for key in ("material", "thickness", "regions", "shear", "shear_correction")),
    ),
}
#: What a box loses as a beam: geometry, whoever wrote it.
STIFFENERS = ("body.box.frames", "body.box.frame_depth")
#: What only the POD of eigenmodes looks at.
POOLED = ("reduction.snapshots", "reduction.modes", "reduction.positions")


@dataclass(frozen=True)
class Unused:
    """A key without effect, the key that decides so ("" if it may not be written), and why."""

    key: str
    by: str
    why: str


def check_unused(file: TomlFile, whole: Scene | Boom) -> None:
    """Refuse the first key without effect that stands beside the key that decides so, or in an option.

    What a file takes over from one that it extends, sections from what all have in common, and runs from the grid of a
    study may be of use to others.
    """
    if isinstance(whole, Scene):
        bodies = [("", whole, file.data)]
    else:
        bodies = [
            (f"sections[{k}].", section_scene(whole, k), file.data["sections"][k]) for k in range(len(whole.sections))
        ]
        for k in range(1, len(whole.sections)):
            _refuse_any(file, f"sections[{k}].", file.data["sections"][k], _of_joint(whole, k))
    for prefix, scene, own in bodies:
        _refuse_any(file, prefix, own, _of_body(scene))
    _refuse_any(file, "", file.data, _of_simulation(whole))


def _refuse_any(file: TomlFile, prefix: str, own: Mapping[str, Any], found: Iterator[Unused]) -> None:
    for one in found:
        if not _stands(own, one.key):
            continue
        writer, decided = file.origin(prefix + one.key), _stands(own, one.by) or not prefix
        decider = file.origin(prefix + one.by if decided else f"section.{one.by}") if one.by else writer
        if writer == OPTION or writer == decider == str(file.path):
            raise refusal(f"{prefix}{one.key}", None, f"leave it out: {one.why}")


def _stands(data: Any, key: str) -> bool:
    for word in filter(None, key.split(".")):
        if not (isinstance(data, Mapping) and word in data):
            return False
        data = data[word]
    return bool(key)


def _of_body(scene: Scene) -> Iterator[Unused]:
    model = model_of(scene)
    for key in UNUSED[model] if scene.body.model != "auto" else ():
        if model == "beam2d" and key == "body.shear" and not scene.body.shear:
            continue  # as it is
        yield Unused(key, "body.model", f"it has no effect on {model}")
    if model.startswith("beam"):
        yield from (Unused(key, "", f"{model} has no walls that frames stiffen; shell has") for key in STIFFENERS)
    if scene.mesh.file is not None:
        yield from (Unused(f"mesh.{key}", "mesh.file", "the mesh is read from a file") for key in _CELLS)
    if scene.body.profile is not None:
        yield Unused("body.material", "body.profile", "a profile holds stiffness and mass itself")
    if not scene.reduction.pooled:
        why = f"basis = {scene.reduction.basis!r} has no eigenmodes at several positions"
        yield from (Unused(key, "reduction.basis", why) for key in POOLED)
    if scene.observe.stations is None:
        yield Unused("observe.count", "observe", "without observe.start and observe.end a beam's nodes are observed")


def _of_joint(boom: Boom, number: int) -> Iterator[Unused]:
    joint, name = boom.joint(number), boom.names[number]
    if joint.follows is None:
        yield from (Unused(f"joint.{key}", "", f"{name} follows no other section") for key in ("ratio", "offset"))
    if not any(ring.friction for ring in joint.rings):
        yield Unused("joint.friction_speed", "", "no pad of this joint has friction")
    if not is_axial(boom, number):
        yield Unused("joint.cylinder", "", f"{name} has no coordinates along the boom, and so no cylinder")


def _of_simulation(whole: Scene | Boom) -> Iterator[Unused]:
    if "ancf" not in whole.compare.against:
        yield Unused("compare.ancf_elements", "compare.against", "compare.against names no ANCF reference")
    if not any(name.startswith("exudyn") for name in (*whole.simulation.simulators, whole.simulation.full)):
        yield Unused(
            "simulation.newton", "simulation.simulators", "Exudyn, whose settings these are, does not simulate"
        )
