"""The workflows that come with the package, by their names."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

#: Where they are: in an installed package below it, in a checkout beside it.
WORKFLOWS = [Path(str(resources.files("pmr"))) / "workflows", Path(str(resources.files("pmr"))).parent / "workflows"]


def found(asked: Path, within: str) -> Path:
    """The file itself, the one called `within` in a folder, or a workflow by its name; else what was asked for."""
    if asked.is_dir() and (asked / within).is_file():
        return asked / within
    if asked.exists() or asked.name != str(asked):
        return asked  # what is wrong with it, its reader says
    named = [folder / part / f"{asked.stem}.toml" for folder in WORKFLOWS for part in ("", "studies", "residual")]
    return next((file for file in named if file.is_file()), asked)
