"""Reading a scene file: ``extends``, overrides, and errors in one line that names file, key and value."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from pmr import signals
from pmr.errors import InputError
from pmr.scene.checks import check
from pmr.scene.sections import Scene

#: The file (or option) in which each key of the merged scene was written.
Origins = dict[tuple[str, ...], str]


def load(path: str | Path, overrides: Sequence[str] = ()) -> Scene:
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
    path = Path(path)
    origins: Origins = {}
    data = _read(path, origins, seen=())
    if not overrides:
        return _validated(data, origins, str(path))
    try:
        as_it_stands = _validated(data, origins, str(path)).hash
    except InputError:
        as_it_stands = ""  # an override may mend it
    for override in overrides:
        _override(data, override, origins)
    scene = _validated(data, origins, str(path))
    if scene.hash != as_it_stands:
        scene = scene.model_copy(update={"published": None})  # published figures are those of the file as it stands
    return scene


def _validated(data: dict[str, Any], origins: Origins, source: str) -> Scene:
    try:
        scene = Scene.model_validate(data)
    except ValidationError as error:
        raise _first_error(error, data, origins, source) from None
    try:
        check(scene)
    except InputError as error:
        raise error.found_in(_origin(re.findall(r"\w+", error.key), origins, source)) from None
    return scene


def _read(path: Path, origins: Origins, seen: tuple[Path, ...]) -> dict[str, Any]:
    if not path.is_file():
        raise InputError(str(path), "", None, "no such scene file")
    if path.resolve() in seen:
        raise InputError(str(path), "extends", None, "a file must not extend itself")
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(str(path), "", None, f"not valid TOML: {error}") from None
    _anchor_files(data, path.parent)
    base: dict[str, Any] = {}
    if "extends" in data:
        extends = data.pop("extends")
        if not isinstance(extends, str):
            raise InputError(str(path), "extends", extends, "the name of a scene file is allowed")
        if not (path.parent / extends).is_file():
            raise InputError(str(path), "extends", extends, "the name of a scene file is allowed; there is none")
        base = _read(path.parent / extends, origins, (*seen, path.resolve()))
        base.pop("published", None)  # figures of another scene
    _merge(base, data, str(path), origins)
    return base


def _anchor_files(data: Any, folder: Path) -> None:
    """Names of files are relative to the scene file in which they stand."""
    for value in data.values() if isinstance(data, dict) else data if isinstance(data, list) else ():
        _anchor_files(value, folder)
    if isinstance(data, dict) and isinstance(data.get("file"), str):
        data["file"] = str(folder / data["file"])


def _merge(
    base: dict[str, Any],
    update: Mapping[str, Any],
    source: str,
    origins: Origins,
    prefix: tuple[str, ...] = (),
) -> None:
    """Tables are merged key by key, except signals (anything with a kind), which replace each other whole."""
    for key, value in update.items():
        here = (*prefix, key)
        if isinstance(value, Mapping) and isinstance(base.get(key), dict) and "kind" not in value:
            _merge(base[key], value, source, origins, here)
        else:
            base[key] = value
            for known in [known for known in origins if known[: len(here)] == here]:
                del origins[known]
            origins[here] = source


def _override(data: dict[str, Any], text: str, origins: Origins) -> None:
    key, equals, value = text.partition("=")
    keys = key.strip().split(".")
    if not equals or not all(keys):
        raise InputError("--set", text, None, "section.key=value is allowed, e.g. reduction.coordinates=10")
    try:
        parsed = tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        parsed = value.strip()
    nested: Any = parsed
    for part in reversed(keys[1:]):
        nested = {part: nested}
    target = data.get(keys[0])
    if isinstance(target, list) and len(keys) > 1:
        raise InputError("--set", key.strip(), parsed, "lists can't be changed in part; set the list as a whole")
    _merge(data, {keys[0]: nested}, "--set", origins)


def _first_error(error: ValidationError, data: Mapping[str, Any], origins: Origins, source: str) -> InputError:
    found = error.errors()
    first = next((e for e in found if e["type"] == "extra_forbidden"), found[0])
    location = [part for part in first["loc"] if part in ("", *_spelled(data)) or isinstance(part, int)]
    if first["type"] == "missing":
        location = [*location, first["loc"][-1]] if first["loc"][-1] not in location else location
    key = _dotted(location)
    value: Any = None if first["type"] == "missing" else first["input"]
    allowed = first["msg"].removeprefix("Value error, ")
    if first["type"] == "extra_forbidden":
        known = _known_keys(first["loc"][:-1])
        close = difflib.get_close_matches(str(first["loc"][-1]), known, n=1)
        hint = f"did you mean {close[0]!r}? " if close else ""
        allowed = f"unknown key; {hint}allowed: {', '.join(known)}" if known else "unknown key"
    if isinstance(value, (dict, list)) and first["type"] == "value_error":
        value = None
    return InputError(_origin(location, origins, source), key, value, allowed[:1].lower() + allowed[1:])


def _spelled(data: Any) -> set[str]:
    """Every key in the user's data: pydantic's locations also name union branches, which the user never wrote."""
    if isinstance(data, Mapping):
        return set(data) | {key for value in data.values() for key in _spelled(value)}
    if isinstance(data, list):
        return {key for value in data for key in _spelled(value)}
    return set()


def _dotted(location: Sequence[str | int]) -> str:
    text = ""
    for part in location:
        text += f"[{part}]" if isinstance(part, int) else (f".{part}" if text else str(part))
    return text


def _origin(location: Sequence[str | int], origins: Origins, source: str) -> str:
    words = tuple(str(part) for part in location)
    for length in range(len(words), 0, -1):
        if words[:length] in origins:
            return origins[words[:length]]
    return source


def _known_keys(location: Sequence[str | int]) -> list[str]:
    """Keys that the section at `location` allows; signals are found by their kind."""
    section: Any = Scene
    kinds = {
        c.model_fields["kind"].default: c
        for c in vars(signals).values()
        if isinstance(c, type) and issubclass(c, BaseModel) and "kind" in c.model_fields
    }
    for part in location:
        if isinstance(part, int):
            continue
        if part in kinds:
            section = kinds[part]
            continue
        field = section.model_fields.get(part)
        if field is None:
            return []
        section = next((c for c in _sections_in(field.annotation)), section)
    return list(section.model_fields) + (["extends"] if section is Scene else [])


def _sections_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [c for a in getattr(annotation, "__args__", ()) for c in _sections_in(a)]
