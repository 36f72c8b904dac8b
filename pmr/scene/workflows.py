"""The workflows that come with the package, by their names."""

from __future__ import annotations

from importlib import resources
from pathlib import Path

_HERE = Path(str(resources.files("pmr")))


def workflows() -> dict[str, Path]:
    """All of them: in an installed package below it, in a checkout beside it."""
    folders = (_HERE.parent / "workflows", _HERE / "workflows")
    return {file.stem: file for folder in folders for file in (*folder.glob("*/*.toml"), *folder.glob("*.toml"))}


def experiments() -> dict[str, Path]:
    """Scripts of the paper's experiments by their names; each has a function ``main``."""
    files = [file for folder in (_HERE.parent, _HERE) for file in (folder / "workflows" / "paper").glob("*.py")]
    return {file.stem: file for file in files if "__main__" in file.read_text(encoding="utf-8")}


def workflow(name: str) -> Path | None:
    """The file of a workflow, if there is one of this name."""
    return workflows().get(name.removesuffix(".toml"))


def found(asked: Path, within: str) -> Path:
    """The file itself, the one called `within` in a folder, or a workflow by its name; else what was asked for.

    A folder of results that is called as a workflow doesn't hide it.
    """
    try:
        if asked.is_dir() and (asked / within).is_file():
            return asked / within
        there = asked.exists() and not asked.is_dir()
    except OSError:  # a name that no file can have
        there = True
    return asked if there else workflow(str(asked)) or asked  # what is wrong with it, its reader says
