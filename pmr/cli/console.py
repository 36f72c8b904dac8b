"""What the commands share: options, which file is meant, where they print, and the check of where they write."""

from __future__ import annotations

import logging
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from rich.console import Console

from pmr.errors import InputError
from pmr.errors.text import visible

Model = Annotated[Path, typer.Argument(metavar="reduced.npz", help="A reduced model that `pmr run` wrote.")]
Overrides = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Override a key of the file; repeatable.")
]
Folder = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="Where results go.  [default: reports/NAME of the file]")
]

# What is printed is text: [brackets] are no markup and :names: no pictures.
PLAIN: dict[str, Any] = {"markup": False, "emoji": False, "highlight": False}
out, err = Console(**PLAIN), Console(stderr=True, **PLAIN)


def say(console: Console, text: str) -> None:
    """Print a line as it is, neither coloured nor wrapped, what would steer the terminal spelled out."""
    console.print(visible(text), soft_wrap=True)


class VisibleText(logging.Formatter):
    """Messages as `say` prints them."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802  (the name that logging calls)
        return visible(super().formatMessage(record))


def no_report(error: Exception, folder: Path) -> str:
    """What to say where everything is computed and stored but the report can't be drawn."""
    reason = " ".join(f"{type(error).__name__}: {error}".split())
    return f"the report can't be drawn ({reason}); the results themselves are in {folder}"


def ensure_writable(folder: Path) -> None:
    """Make sure of the folder before anything is computed."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        allowed = f"a folder that can be written to is allowed ({error.strerror})"
        raise InputError("command line", "--out", str(folder), allowed) from None


def ensure_file(file: Path) -> None:
    """The same of a file that is to be written."""
    if file.is_dir():
        raise InputError("command line", "--out", str(file), "the name of a file is allowed")
    ensure_writable(file.parent)


def scene_file(asked: Path) -> Path:
    """A scene file: the file itself, `scene.toml` in a folder, or a workflow by its name; studies are refused."""
    file = _found(asked, "scene.toml")
    if "kind" in _keys(file):
        raise InputError("command line", "SCENE", str(asked), f"that is a study: pmr study {asked} computes it")
    return file


def study_file(asked: Path) -> Path:
    """A study file: the file itself, `study.toml` in a folder, or a workflow by its name; scenes are refused."""
    file = _found(asked, "study.toml")
    keys = _keys(file)
    if "kind" not in keys and {"body", "slider", "sections"} & set(keys):
        raise InputError("command line", "STUDY", str(asked), f"that is a scene: pmr run {asked} computes it")
    return file


def _found(asked: Path, within: str) -> Path:
    from pmr.scene.workflows import found  # what reads scenes takes longer to load than a help text to print

    return found(asked, within)


def _keys(file: Path) -> dict[str, object]:
    """What stands in a file; nothing where it can't be read, which its reader says better."""
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}


def leave(message: str, code: int) -> NoReturn:
    """Say why, and end this process and all other ranks."""
    say(err, f"pmr: {message}")
    err.file.flush()
    if ranks() > 1:
        sys.modules["mpi4py.MPI"].COMM_WORLD.Abort(code)
    sys.exit(code)


def ranks() -> int:
    """Ranks of this run, without starting MPI for commands that do without it."""
    mpi = sys.modules.get("mpi4py.MPI")
    return mpi.COMM_WORLD.size if mpi else 1
