"""What the commands share: where they print, and the check of where they write."""

from __future__ import annotations

import logging
import sys
import tempfile
from pathlib import Path
from typing import Any, NoReturn

from rich.console import Console

from pmr.errors import InputError
from pmr.errors.text import visible

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
    """Make sure of the folder before anything is computed.

    Raises
    ------
    InputError
        If it can't be made or written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        allowed = f"a folder that can be written to is allowed ({error.strerror})"
        raise InputError("command line", "--out", str(folder), allowed) from None


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
