"""Whether a scene describes the body that a reduced model was made from, and loads that it was made for."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Protocol

from pmr.errors import InputError
from pmr.scene import Scene
from pmr.scene.members import Member, member_at
from pmr.scene.parts import OneBody
from pmr.scene.section import Section

#: What may differ from the scene that the model was made from: signals, and how reductions are computed or judged.
FREE = frozenset({
    *("signal", "acceleration", "rise", "path", "travel", "frequency_response", "solver", "estimate"),
    *("extension", "overlap", "follows", "ratio", "offset"),
})  # fmt: skip


class Made(Protocol):
    """A model or system that knows the scene it was made from, if it does."""

    @property
    def provenance(self) -> dict[str, Any]: ...


def with_models_of(scene: Scene, made: Made | Mapping[str, Made]) -> Scene:
    """The scene with the models that measurements chose for what was `made` of it, wherever it names none itself.

    That is a system, a model of a body alone, or a model of each section by its name.
    """
    parts = []
    for number, (name, part) in enumerate(scene.bodies.items()):
        one = made.get(name) if isinstance(made, Mapping) else made
        written = {} if one is None else one.provenance.get("scene") or {}
        if "sections" in written:
            written = written["sections"][number] if number < len(written["sections"]) else {}
        known = {key: value for key, value in written.get("body", {}).items() if key in ("model", "walls")}
        chosen = known if part.body.model == "auto" and known.get("model", "auto") != "auto" else {}
        parts.append(part.model_copy(update={"body": part.body.model_copy(update=chosen)}) if chosen else part)
    return scene.model_copy(update={"sections": tuple(parts)})


def check_made_for(model: Made, scene: Scene, number: int | None = None) -> None:
    """Bodies, supports, pads, joints, damping, what is observed, places and directions of loads are those of the model.

    That is of a whole scene, or of one of its sections by its `number`.  Raises InputError with the first key that
    differs and what the model has.  Keys that the file of an older model does not hold are not compared.
    """
    made = model.provenance.get("scene")
    if not isinstance(made, Mapping):
        return
    files = model.provenance.get("files") or {}
    alone = number is not None or len(scene.sections) == 1
    found = _of_body(made, member_at(scene, number or 0)) if alone else _of_scene(made, scene)
    read = scene.sections[number or 0].files if alone else scene.files_read
    for key, value, known in (*_of_gravity(made, scene), *found, *_of_files(files, read)):
        shown = list(value) if isinstance(value, tuple) else value
        where = scene.key_of(number or 0, key) if alone else key
        raise InputError("scene", where, shown, f"that of the model is allowed: {known!r}")


def _of_gravity(made: Mapping[str, Any], scene: Scene) -> Iterator[tuple[str, Any, Any]]:
    """Key, value, and that of the model, as all that follow."""
    if made.get("gravity") and scene.gravity:
        yield from _between(made["gravity"], scene.gravity, "gravity")


def _of_body(made: Mapping[str, Any], one: Member) -> Iterator[tuple[str, Any, Any]]:
    known = {load.get("name"): load for load in made.get("loads") or ()}
    for i, load in enumerate(one.part.loads):
        yield from _between(known.get(load.name, {}), load, f"loads[{i}]")
    asked = {name: getattr(one.part, name) for name in OneBody.model_fields if name != "loads"}
    for name, value in (asked | {"pads": one.pads, "damping": one.damping}).items():
        if name in made and not (name == "slider" and value is None):
            yield from _between(made[name], value, name)


def _of_scene(made: Mapping[str, Any], scene: Scene) -> Iterator[tuple[str, Any, Any]]:
    for name in ("damping", "sections"):
        if name in made:
            yield from _between(made[name], getattr(scene, name), name)


def _of_files(known: Mapping[str, str], read: Mapping[str, Path]) -> Iterator[tuple[str, Any, Any]]:
    for name, file in read.items():
        digest = hashlib.sha256(file.read_bytes()).hexdigest()
        if known.get(name, digest) != digest:
            yield f"{name}.file", file.name, f"content of SHA-256 {known[name][:12]}"


def _between(made: Any, asked: Any, key: str) -> Iterator[tuple[str, Any, Any]]:
    """The same of one part of a scene."""
    if isinstance(asked, Section) and isinstance(made, Mapping):
        for name in [name for name in type(asked).model_fields if name in made and name not in FREE]:
            yield from _between(made[name], getattr(asked, name), f"{key}.{name}")
    elif isinstance(asked, dict) and isinstance(made, Mapping) and set(asked) == set(made):
        for name, value in asked.items():
            yield from _between(made[name], value, f"{key}.{name}")
    elif isinstance(asked, tuple) and asked and isinstance(asked[0], Section) and len(asked) == len(made or ()):
        for i, (one, value) in enumerate(zip(made, asked, strict=True)):
            yield from _between(one, value, f"{key}[{i}]")
    elif not _equal(made, asked):
        yield key, asked.name if isinstance(asked, Path) else asked, made


def _equal(made: Any, asked: Any) -> bool:
    """Whether a value is the model's, but for round-off and what JSON makes of it."""
    if isinstance(asked, tuple) and isinstance(made, list | tuple):
        return len(asked) == len(made) and all(map(_equal, made, asked))
    if isinstance(asked, float) and isinstance(made, int | float):
        return math.isclose(asked, made, rel_tol=1e-12)
    return bool((asked.name if isinstance(asked, Path) else asked) == made)
