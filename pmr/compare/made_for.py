"""Whether a scene describes the body that a reduced model was made from, and loads that it was made for."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Protocol

from pmr.errors import InputError
from pmr.scene import Scene
from pmr.scene.joints import OneBody
from pmr.scene.keys import Section
from pmr.scene.members import Member, member_at

#: What may differ from the scene that the model was made from: signals, and how reductions are computed or judged.
FREE = frozenset({
    *("signal", "acceleration", "rise", "path", "travel", "frequency_response", "solver", "estimate"),
    *("extension", "overlap", "follows", "ratio", "offset"),
})  # fmt: skip


class Made(Protocol):
    """A model or system that knows the scene it was made from, if it does."""

    @property
    def provenance(self) -> dict[str, Any]: ...


def with_models_of(scene: Scene, models: Made | Mapping[str, Made]) -> Scene:
    """The scene with the models that measurements chose for what was `made` of it, wherever it names none itself.

    That is a system, a model of a body alone, or a model of each section by its name.
    """
    parts = []
    for number, (name, part) in enumerate(scene.bodies.items()):
        model = models.get(name) if isinstance(models, Mapping) else models
        written = {} if model is None else model.provenance.get("scene") or {}
        if "sections" in written:
            written = written["sections"][number] if number < len(written["sections"]) else {}
        chosen_by_model = {key: value for key, value in written.get("body", {}).items() if key in ("model", "walls")}
        chosen = chosen_by_model if part.body.model == "auto" and chosen_by_model.get("model", "auto") != "auto" else {}
        parts.append(part.model_copy(update={"body": part.body.model_copy(update=chosen)}) if chosen else part)
    return scene.model_copy(update={"sections": tuple(parts)})


def check_made_for(model: Made, scene: Scene, number: int | None = None) -> None:
    """Bodies, supports, pads, joints, damping, what is observed, places and directions of loads are those of the model.

    That is of a whole scene, or of one of its sections by its `number`.  Raises InputError with the first key that
    differs and what the model has.  Keys that the file of an older model does not hold are not compared.
    """
    recorded_scene = model.provenance.get("scene")
    if not isinstance(recorded_scene, Mapping):
        return
    files = model.provenance.get("files") or {}
    alone = number is not None or len(scene.sections) == 1
    differing = _of_body(recorded_scene, member_at(scene, number or 0)) if alone else _of_scene(recorded_scene, scene)
    read = scene.sections[number or 0].files if alone else scene.files_read
    for key, value, of_model in (*_of_gravity(recorded_scene, scene), *differing, *_of_files(files, read)):
        shown = list(value) if isinstance(value, tuple) else value
        where = scene.key_of(number or 0, key) if alone else key
        raise InputError("scene", where, shown, f"that of the model is allowed: {of_model!r}")


def _of_gravity(recorded_scene: Mapping[str, Any], scene: Scene) -> Iterator[tuple[str, Any, Any]]:
    """Key, value, and that of the model, as all that follow."""
    if recorded_scene.get("gravity") and scene.gravity:
        yield from _part_differences(recorded_scene["gravity"], scene.gravity, "gravity")


def _of_body(recorded_scene: Mapping[str, Any], member: Member) -> Iterator[tuple[str, Any, Any]]:
    recorded_loads = {load.get("name"): load for load in recorded_scene.get("loads") or ()}
    for i, load in enumerate(member.part.loads):
        yield from _part_differences(recorded_loads.get(load.name, {}), load, f"loads[{i}]")
    fields = {name: getattr(member.part, name) for name in OneBody.model_fields if name != "loads"}
    for name, value in (fields | {"pads": member.pads, "damping": member.damping}).items():
        if name in recorded_scene and not (name == "slider" and value is None):
            yield from _part_differences(recorded_scene[name], value, name)


def _of_scene(recorded_scene: Mapping[str, Any], scene: Scene) -> Iterator[tuple[str, Any, Any]]:
    for name in ("damping", "sections"):
        if name in recorded_scene:
            yield from _part_differences(recorded_scene[name], getattr(scene, name), name)


def _of_files(recorded_digests: Mapping[str, str], read: Mapping[str, Path]) -> Iterator[tuple[str, Any, Any]]:
    for name, file in read.items():
        digest = hashlib.sha256(file.read_bytes()).hexdigest()
        if recorded_digests.get(name, digest) != digest:
            yield f"{name}.file", file.name, f"content of SHA-256 {recorded_digests[name][:12]}"


def _part_differences(recorded: Any, present: Any, key: str) -> Iterator[tuple[str, Any, Any]]:
    """Differences in one part of a scene."""
    if isinstance(present, Section) and isinstance(recorded, Mapping):
        for name in [name for name in type(present).model_fields if name in recorded and name not in FREE]:
            yield from _part_differences(recorded[name], getattr(present, name), f"{key}.{name}")
    elif isinstance(present, dict) and isinstance(recorded, Mapping) and set(present) == set(recorded):
        for name, value in present.items():
            yield from _part_differences(recorded[name], value, f"{key}.{name}")
    elif (
        isinstance(present, tuple)
        and present
        and isinstance(present[0], Section)
        and len(present) == len(recorded or ())
    ):
        for i, (recorded_entry, value) in enumerate(zip(recorded, present, strict=True)):
            yield from _part_differences(recorded_entry, value, f"{key}[{i}]")
    elif not _equal(recorded, present):
        yield key, present.name if isinstance(present, Path) else present, recorded


def _equal(recorded: Any, present: Any) -> bool:
    """Whether a value is the model's, but for round-off and what JSON makes of it."""
    if isinstance(present, tuple) and isinstance(recorded, list | tuple):
        return len(present) == len(recorded) and all(map(_equal, recorded, present))
    if isinstance(present, float) and isinstance(recorded, int | float):
        return math.isclose(present, recorded, rel_tol=1e-12)
    return bool((present.name if isinstance(present, Path) else present) == recorded)
