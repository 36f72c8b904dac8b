"""The command ``pmr new``: a folder with a commented scene to start from, and a script that draws its mesh."""

from __future__ import annotations

from importlib import resources
from pathlib import Path
from typing import Annotated

import typer

from pmr.cli.console import ensure_writable, out, say
from pmr.errors import InputError

TEMPLATES = resources.files("pmr.cli") / "templates"


def kinds() -> list[str]:
    """What there is to start from."""
    return sorted(folder.name for folder in TEMPLATES.iterdir())


def new(
    kind: Annotated[str, typer.Argument(metavar="KIND", help="boom or crane.")],
    name: Annotated[Path, typer.Argument(metavar="NAME", help="The folder to make; its name is the scene's title.")],
) -> None:
    """Write a commented scene and a script for a mesh of one's own into a new folder.

    Example:

        pmr new boom mine && pmr run mine
    """
    if kind not in kinds():
        raise InputError("command line", "KIND", kind, f"{', '.join(kinds())} are allowed")
    if name.exists():
        raise InputError("command line", "NAME", str(name), "the name of a folder that is not there yet is allowed")
    ensure_writable(name)
    title = name.name.replace("\\", "").replace('"', "")
    for file in (TEMPLATES / kind).iterdir():
        text = file.read_text(encoding="utf-8").replace('title = "NAME"', f'title = "{title}"')
        (name / file.name).write_text(text, encoding="utf-8")
    say(out, f"{name / 'scene.toml'}  what is built and asked, with comments; `pmr run {name}` computes it")
    say(out, f"{name / 'mesh.py'}     draws a mesh of its own, for a start")
