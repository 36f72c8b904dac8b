"""Reading a scene file: what its sections allow, and what no section knows by itself."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from pmr.errors import InputError
from pmr.scene.checks import check
from pmr.scene.former import GONE, MOVED
from pmr.scene.scene import BodyFile, Scene
from pmr.scene.tomlfiles import Change, Dialect, TomlFile, override
from pmr.scene.unused import check_unused
from pmr.scene.workflows import resolve_path

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
    gone=GONE,
)


def load(path: str | Path, overrides: Sequence[str] = ()) -> Scene:
    """Read a scene file in TOML: its path, a folder with a ``scene.toml``, or the name of a workflow of the package.

    A file may extend another one: its key ``extends`` names a base file, relative to it, and its other keys override
    those of the base file.  `overrides` are ``"section.key=value"`` with the value in TOML notation (a bare word is
    taken as a string).

    Raises InputError in one line: file, key, value, what is allowed.  A scene of several sections is refused, too;
    `load_any` reads it.
    """
    scene = load_any(path, overrides)
    try:
        scene.alone  # noqa: B018
    except InputError as error:
        raise error.found_in(str(_file(path).path)) from None
    return scene


def load_any(path: str | Path, overrides: Sequence[str] = ()) -> Scene:
    """Read a scene file of one section or of several; arguments and errors are those of `load`."""
    return vary(path, [override(text) for text in overrides])


def vary(path: str | Path, changes: Sequence[Change]) -> Scene:
    """Load a scene with changes laid over it, one after the other."""
    file, as_it_stands = _file(path), ""
    with suppress(InputError):  # a change may mend it
        as_it_stands = _scene(file).hash if changes and "published" in file.data else ""
    for change in changes:
        file.apply(change)
    scene = _scene(file)
    if as_it_stands and scene.hash != as_it_stands and scene.published is not None:
        scene = scene.model_copy(update={"published": scene.published.of_any_motion})
    return scene


def has_sections(path: str | Path) -> bool:
    """Whether a file describes a boom of several sections."""
    sections = _file(path).data.get("sections")
    return isinstance(sections, list) and len(sections) > 1


def beam_scene(path: str | Path) -> Scene:
    """Load a planar beam that is described by its stiffnesses, on which points slide; others are refused."""
    scene = load(path)
    if scene.body.profile is None or scene.pads:
        raise InputError(str(path), "body.profile", None, "a scene with a planar beam, without pads, is allowed here")
    return scene


def _file(path: str | Path) -> TomlFile:
    return TomlFile.read(resolve_path(Path(path), "scene.toml"), DIALECT)


def _scene(file: TomlFile) -> Scene:
    """Scene of either dialect: a body at the top, or sections."""
    scene = file.validate(Scene) if "sections" in file.data else Scene.of(file.validate(BodyFile))
    try:
        check(scene)
        check_unused(file, scene)
    except InputError as error:
        error = error.called(scene.spelled(error.key))
        raise error.found_in(file.origin(error.key)) from None
    return scene
