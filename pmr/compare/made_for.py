"""Whether a scene describes the body that a reduced model was made from, and loads that it was made for."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Protocol

from pmr.errors import InputError
from pmr.scene import Boom, Scene
from pmr.scene.scene import OneBody
from pmr.scene.section import Section

#: What may differ from the scene that the model was made from: signals, and how reductions are computed or judged.
FREE = frozenset({
    *("signal", "acceleration", "rise", "path", "travel", "frequency_response", "solver", "estimate"),
    *("extension", "overlap", "follows", "ratio", "offset", "friction_speed"),
})  # fmt: skip
#: What a model is made from: tables of a scene.
BUILT = (*OneBody.model_fields, "damping", "slider", "sections")


class Made(Protocol):
    """A model or system that knows the scene it was made from, if it does."""

    @property
    def provenance(self) -> dict[str, Any]: ...


def check_made_for(model: Made, scene: Scene | Boom) -> None:
    """Bodies, supports, pads, joints, damping, what is observed, places and directions of loads are those of the model.

    Raises InputError with the first key that differs and what the model has.  Keys that the file of an older model does
    not hold are not compared.
    """
    made = model.provenance.get("scene")
    if not isinstance(made, Mapping):
        return
    for key, value, known in _differences(made, scene, model.provenance.get("files") or {}):
        shown = list(value) if isinstance(value, tuple) else value
        raise InputError("scene", key, shown, f"that of the model is allowed: {known!r}")


def _differences(
    made: Mapping[str, Any], scene: Scene | Boom, files: Mapping[str, str]
) -> Iterator[tuple[str, Any, Any]]:
    """Key, value, and that of the model."""
    if made.get("gravity") and scene.gravity:
        yield from _between(made["gravity"], scene.gravity, "gravity")
    known = {load.get("name"): load for load in made.get("loads") or ()}
    for i, load in enumerate(getattr(scene, "loads", ())):
        yield from _between(known.get(load.name, {}), load, f"loads[{i}]")
    for name in BUILT:
        if name != "loads" and name in made and hasattr(scene, name):
            yield from _between(made[name], getattr(scene, name), name)
    for name, digest in scene.recorded["files"].items():
        if files.get(name, digest) != digest:
            yield f"{name}.file", scene.files_read[name].name, f"content of SHA-256 {files[name][:12]}"


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
