"""Reading a scene file: what its sections allow, and what no section knows by itself."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

from pmr.errors import InputError
from pmr.scene.boom import Boom
from pmr.scene.boom_checks import check_boom
from pmr.scene.checks import check
from pmr.scene.scene import Scene
from pmr.scene.tomlfiles import Change, Dialect, TomlFile, override
from pmr.scene.unused import check_unused
from pmr.scene.workflows import found

Whole = TypeVar("Whole", Scene, Boom)

#: Keys of earlier versions and what they are called now.
MOVED = {
    "body.length": "body.profile.length",
    "body.bending_stiffness": "body.profile.bending_stiffness",
    "body.axial_stiffness": "body.profile.axial_stiffness",
    "body.mass_per_length": "body.profile.mass_per_length",
    "body.axial": "body.profile.axial",
    "supports.at": "supports.on",
    "loads.at": "loads.on",
    "holds": "supports (with their directions)",
    "clamps": "supports (with points = 'all', and kind = 'clamped' or directions)",
    "reduction.support_rows": "reduction.basis ('paper' for 'hold', 'eigenmodes' for 'drop')",
}
#: Published figures are those of one scene, not of the ones that extend it.
DIALECT = Dialect(
    "scene file",
    own=("published",),
    alternatives={
        "damping": (("mass", "stiffness"), ("ratio", "frequencies")),
        "body": (("box",), ("profile",)),
        "gravity": (("direction",), ("inclination",)),
    },
    moved=MOVED,
)


def load(path: str | Path, overrides: Sequence[str] = ()) -> Scene:
    """Read a scene file in TOML: its path, a folder with a ``scene.toml``, or the name of a workflow of the package.

    Its ``extends`` key names a base file, relative to it, whose keys it overrides.  `overrides` are
    ``"section.key=value"`` with the value in TOML notation (a bare word is taken as a string).

    Raises InputError in one line: file, key, value, what is allowed.
    """
    return _of_one_body(_file(path), [override(text) for text in overrides])


def load_any(path: str | Path, overrides: Sequence[str] = ()) -> Scene | Boom:
    """The same for a file that may have several sections."""
    return vary(path, [override(text) for text in overrides])


def vary(path: str | Path, changes: Sequence[Change]) -> Scene | Boom:
    """The same with changes laid over it, one after the other."""
    file = _file(path)
    if "sections" not in file.data:
        return _of_one_body(file, changes)
    for change in changes:
        file.apply(change)
    return _checked(file, file.validated(Boom), check_boom)


def from_json(text: str) -> Scene | Boom:
    """The scene that `model_dump_json` gave: it was checked when it was read from its file."""
    return (Boom if "sections" in json.loads(text) else Scene).model_validate_json(text)


def has_sections(path: str | Path) -> bool:
    """Whether a file describes a boom of several sections."""
    return "sections" in _file(path).data


def beam_scene(path: str | Path) -> Scene:
    """As `load`, of a planar beam that is described by its stiffnesses, on which points slide; others are refused."""
    scene = load(path)
    if scene.body.profile is None or scene.pads:
        raise InputError(str(path), "body.profile", None, "a scene with a planar beam, without pads, is allowed here")
    return scene


def _file(path: str | Path) -> TomlFile:
    return TomlFile.read(found(Path(path), "scene.toml"), DIALECT)


def _of_one_body(file: TomlFile, changes: Sequence[Change]) -> Scene:
    as_it_stands = ""
    with suppress(InputError):  # a change may mend it
        as_it_stands = _scene(file).hash if changes else ""
    for change in changes:
        file.apply(change)
    scene = _scene(file)
    if changes and scene.hash != as_it_stands:  # published figures are those of the file as it stands
        scene = scene.model_copy(update={"published": None})
    return scene


def _scene(file: TomlFile) -> Scene:
    if "sections" in file.data:
        allowed = "a scene of one body is allowed here; pmr run takes booms of several sections"
        raise InputError(file.origin("sections"), "sections", None, allowed)
    return _checked(file, file.validated(Scene), check)


def _checked(file: TomlFile, whole: Whole, check_it: Callable[[Whole], None]) -> Whole:
    try:
        check_it(whole)
        check_unused(file, whole)
    except InputError as error:
        raise error.found_in(file.origin(error.key)) from None
    return whole
