"""Which file is meant by what stands on the command line."""

from __future__ import annotations

import tomllib
from importlib import resources
from pathlib import Path

from pmr.errors import InputError

#: Where the workflows are: in an installed package below it, in a checkout beside it.
WORKFLOWS = [Path(str(resources.files("pmr"))) / "workflows", Path(str(resources.files("pmr"))).parent / "workflows"]


def scene_file(asked: Path) -> Path:
    """A scene file: the file itself, `scene.toml` in a folder, or a workflow by its name.

    Raises
    ------
    InputError
        If it is a study, which another command computes.
    """
    found = _found(asked, "scene.toml")
    if "kind" in _keys(found):
        raise InputError("command line", "SCENE", str(asked), f"that is a study: pmr study {asked} computes it")
    return found


def study_file(asked: Path) -> Path:
    """A study file: the file itself, `study.toml` in a folder, or a workflow's study by its name.

    Raises
    ------
    InputError
        If it is a scene, which another command computes.
    """
    found = _found(asked, "study.toml")
    keys = _keys(found)
    if "kind" not in keys and {"body", "slider"} & set(keys):
        raise InputError("command line", "STUDY", str(asked), f"that is a scene: pmr run {asked} computes it")
    return found


def _found(asked: Path, within: str) -> Path:
    if asked.is_dir() and (asked / within).is_file():
        return asked / within
    if asked.exists() or asked.name != str(asked):
        return asked  # what is wrong with it, its reader says
    named = [folder / part / f"{asked.stem}.toml" for folder in WORKFLOWS for part in ("", "studies", "residual")]
    return next((file for file in named if file.is_file()), asked)


def _keys(file: Path) -> dict[str, object]:
    """What stands in a file; nothing where it can't be read, which its reader says better."""
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
