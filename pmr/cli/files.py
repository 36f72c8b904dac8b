"""Which file is meant by what stands on the command line."""

from __future__ import annotations

import tomllib
from pathlib import Path

from pmr.errors import InputError
from pmr.scene.workflows import found


def scene_file(asked: Path) -> Path:
    """A scene file: the file itself, `scene.toml` in a folder, or a workflow by its name.

    Raises
    ------
    InputError
        If it is a study, which another command computes.
    """
    file = found(asked, "scene.toml")
    if "kind" in _keys(file):
        raise InputError("command line", "SCENE", str(asked), f"that is a study: pmr study {asked} computes it")
    return file


def study_file(asked: Path) -> Path:
    """A study file: the file itself, `study.toml` in a folder, or a workflow's study by its name.

    Raises
    ------
    InputError
        If it is a scene, which another command computes.
    """
    file = found(asked, "study.toml")
    keys = _keys(file)
    if "kind" not in keys and {"body", "slider", "sections"} & set(keys):
        raise InputError("command line", "STUDY", str(asked), f"that is a scene: pmr run {asked} computes it")
    return file


def _keys(file: Path) -> dict[str, object]:
    """What stands in a file; nothing where it can't be read, which its reader says better."""
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
