"""What the commands share: where they print, and the check of where they write."""

from __future__ import annotations

import tempfile
from pathlib import Path

from rich.console import Console

from pmr.errors import InputError

out, err = Console(), Console(stderr=True)


def say(console: Console, text: str) -> None:
    """Print a line as it is, neither coloured nor wrapped."""
    console.print(text, highlight=False, soft_wrap=True, markup=False)


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
