"""Reading a scene file: what its sections allow, and what no section knows by itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pmr.errors import InputError
from pmr.scene.checks import check
from pmr.scene.sections import Scene, SceneBase
from pmr.scene.space import StructureScene
from pmr.scene.tomlfiles import Change, Dialect, TomlFile, override

#: Published figures are those of one scene, not of the ones that extend it.
DIALECT = Dialect(
    "scene file",
    own=("published",),
    alternatives={"damping": (("mass", "stiffness"), ("ratio", "frequencies"))},
)


def load(path: str | Path, overrides: Sequence[str] = ()) -> SceneBase:
    """Read a scene file.

    Parameters
    ----------
    path : str or Path
        TOML file; its ``extends`` key names a base file, relative to it, whose keys it overrides.
    overrides : sequence of str
        ``"section.key=value"`` with the value in TOML notation (a bare word is taken as a string).

    Raises
    ------
    InputError
        One line: file, key, value, what is allowed.
    """
    return vary(path, [override(text) for text in overrides])


def vary(path: str | Path, changes: Sequence[Change]) -> SceneBase:
    """Read a scene file and lay changes over it, one after the other.

    Raises
    ------
    InputError
        As `load`.
    """
    file = TomlFile.read(path, DIALECT)
    if not changes:
        return _scene(file)
    try:
        as_it_stands = _scene(file).hash
    except InputError:
        as_it_stands = ""  # a change may mend it
    for change in changes:
        file.apply(change)
    scene = _scene(file)
    if scene.hash != as_it_stands:
        scene = scene.model_copy(update={"published": None})  # published figures are those of the file as it stands
    return scene


def vary_beam(path: str | Path, changes: Sequence[Change] = ()) -> Scene:
    """The same for a scene of a planar beam.

    Raises
    ------
    InputError
        As `load`, and for any other scene.
    """
    scene = vary(path, changes)
    if not isinstance(scene, Scene):
        raise InputError(str(path), "body.model", None, "a scene with a planar beam is allowed here")
    return scene


def _scene(file: TomlFile) -> SceneBase:
    scene = file.validated(kind_of(file.data))
    try:
        check(scene)
    except InputError as error:
        raise error.found_in(file.origin(error.key)) from None
    return scene


def kind_of(data: Mapping[str, Any]) -> type[SceneBase]:
    """What kind of scene some data describes: planar beams are what has no other model."""
    body = data.get("body")
    planar = not isinstance(body, Mapping) or ("box" not in body and body.get("model", "beam2d") == "beam2d")
    return Scene if planar else StructureScene


def from_data(data: Mapping[str, Any]) -> SceneBase:
    """The scene that was dumped as `data`."""
    return kind_of(data).model_validate(data)
