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


def resolve_path(path: Path, within: str) -> Path:
    """The file itself, the one called `within` in a folder, or a workflow by its name; else what was asked for.

    A folder of results that is called as a workflow doesn't hide it.
    """
    try:
        if path.is_dir() and (path / within).is_file():
            return path / within
        is_usable = path.exists() and not path.is_dir()
    except OSError:  # a name that no file can have
        is_usable = True
    return path if is_usable else workflow(str(path)) or path  # what is wrong with it, its reader says
