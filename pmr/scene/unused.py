"""Keys that a scene file writes and that have no effect on what it describes: who writes one expects some."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from pmr.scene.choice import has_giving_walls, is_axial, model_of
from pmr.scene.members import Member, member_at, members
from pmr.scene.scene import Scene
from pmr.scene.structure_checks import refusal
from pmr.scene.tomlfiles import OPTION, TomlFile

_CELLS = ("size", "along", "tail_layer", "cells")
#: By model, keys that it has no use for.
UNUSED = {
    "beam2d": (*(f"mesh.{key}" for key in _CELLS), "body.shear_correction", "body.shear"),
    "beam3d": (*(f"mesh.{key}" for key in _CELLS), "body.shear_correction"),
    "shell": ("mesh.elements", "mesh.cells", "body.shear", "body.walls"),
    "solid": ("mesh.elements", "body.shear", "body.shear_correction", "body.walls"),
    "matrices": (
        *(f"mesh.{key}" for key in (*_CELLS, "elements")),
        *(f"body.{key}" for key in ("material", "thickness", "regions", "shear", "shear_correction", "walls")),
    ),
}
#: What a beam has a use for nevertheless that is pressed on, or compared with, as a shell.
OF_WALLS = ("mesh.size", "mesh.along", "body.shear_correction")
#: What a box loses as a planar beam: geometry, whoever wrote it.
STIFFENERS = ("body.box.frame_depth", "body.box.frame_thickness")
#: What only the POD of eigenmodes looks at.
POOLED = ("reduction.snapshots", "reduction.modes", "reduction.positions")


@dataclass(frozen=True)
class Unused:
    """A key without effect, the key that decides so ("" if it may not be written), and why."""

    key: str
    by: str
    why: str


def check_unused(file: TomlFile, scene: Scene) -> None:
    """Refuse the first key without effect that stands beside the key that decides so, or in an option.

    What a file takes over from one that it extends, sections from what all have in common, and runs from the grid of a
    study may be of use to others.
    """
    compared = scene.compare.richer not in ("auto", "none")
    if "sections" not in file.data:
        _refuse_any(file, "", file.data, _of_body(member_at(scene), compared))
    else:
        for number, (member, section) in enumerate(zip(members(scene), file.data["sections"], strict=True)):
            _refuse_any(file, f"sections[{number}].", section, _of_body(member, compared))
            if number:
                _refuse_any(file, f"sections[{number}].", section, _of_joint(scene, number))
    _refuse_any(file, "", file.data, _of_simulation(scene))


def _refuse_any(file: TomlFile, prefix: str, content: Mapping[str, Any], unused_keys: Iterator[Unused]) -> None:
    for unused in unused_keys:
        if not _stands(content, unused.key):
            continue
        writer, decided = file.origin(prefix + unused.key), _stands(content, unused.by) or not prefix
        decider = file.origin(prefix + unused.by if decided else f"section.{unused.by}") if unused.by else writer
        if writer == OPTION or writer == decider == str(file.path):
            raise refusal(f"{prefix}{unused.key}", None, f"leave it out: {unused.why}")


def _stands(data: Any, key: str) -> bool:
    for word in filter(None, key.split(".")):
        if isinstance(data, list):
            data = dict(zip(map(str, range(len(data))), data, strict=True))
        if not (isinstance(data, Mapping) and word in data):
            return False
        data = data[word]
    return bool(key)


def _of_body(member: Member, compared: bool) -> Iterator[Unused]:
    model = model_of(member)
    for key in UNUSED.get(model, ()) if member.part.body.model != "auto" else ():
        if model == "beam2d" and key == "body.shear" and not member.part.body.shear:
            continue  # as it is
        if key in OF_WALLS and (compared or has_giving_walls(member)):
            continue
        yield Unused(key, "body.model", f"it has no effect on {model}")
    if model == "beam2d":
        yield from (Unused(key, "", f"{model} knows of no frames; beam3d and shell do") for key in STIFFENERS)
    if member.part.mesh.file is not None:
        yield from (Unused(f"mesh.{key}", "mesh.file", "the mesh is read from a file") for key in _CELLS)
    if member.part.body.profile is not None:
        yield Unused("body.material", "body.profile", "a profile holds stiffness and mass itself")
    if not member.part.reduction.uses_pod:
        why = f"basis = {member.part.reduction.basis!r} has no eigenmodes at several positions"
        yield from (Unused(key, "reduction.basis", why) for key in POOLED)
    if member.part.observe.stations is None:
        yield Unused("observe.count", "observe", "without observe.start and observe.end a beam's nodes are observed")


def _of_joint(scene: Scene, number: int) -> Iterator[Unused]:
    joint, name = scene.joint(number), scene.names[number]
    if joint.follows is None:
        yield from (Unused(f"joint.{key}", "", f"{name} follows no other section") for key in ("ratio", "offset"))
    for end in ("tail", "mouth"):
        for k, ring in enumerate(getattr(joint, end)):
            if not ring.friction:
                yield Unused(f"joint.{end}.{k}.shear_stiffness", "", "without friction nothing sticks")
    if not is_axial(member_at(scene, number)):
        yield from (
            Unused(f"joint.{key}", "", f"{name} has no coordinates along the boom, and so no {key}")
            for key in ("cylinder", "rope")
        )


def _of_simulation(scene: Scene) -> Iterator[Unused]:
    if "ancf" not in scene.compare.against:
        yield Unused("compare.ancf_elements", "compare.against", "compare.against names no ANCF reference")
    if not any(name.startswith("exudyn") for name in (*scene.simulation.simulators, scene.simulation.full)):
        yield Unused(
            "simulation.newton", "simulation.simulators", "Exudyn, whose settings these are, does not simulate"
        )
