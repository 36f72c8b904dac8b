"""The command ``pmr new``: a folder with a commented scene to start from, of one body with a script for its mesh."""

from __future__ import annotations

from importlib import resources
from os.path import lexists
from pathlib import Path
from typing import Annotated

import typer

from pmr.cli.console import ensure_writable, out, say
from pmr.errors import InputError
from pmr.errors.text import hint, visible

SCHEMA = "scene.schema.json"
TEMPLATES = resources.files("pmr.cli") / "templates"


def kinds() -> list[str]:
    """Kinds of scenes to start from."""
    return sorted(file.name.removesuffix(".toml") for file in TEMPLATES.iterdir() if file.name.endswith(".toml"))


def new(
    kind: Annotated[
        str, typer.Argument(metavar="KIND", help="beam, boom, telescope, crane or platform.", autocompletion=kinds)
    ],
    name: Annotated[Path, typer.Argument(metavar="NAME", help="New folder, whose name is the title of the scene.")],
) -> None:
    """Write a scene with comments into a new folder, for one body also a script that draws a mesh.

    Example:

        pmr new boom mine && pmr run mine
    """
    from pmr.cli.schema import scene_schema

    if kind not in kinds():
        raise InputError("command line", "KIND", kind, f"{hint(kind, kinds())}{', '.join(kinds())} are allowed")
    if lexists(name):
        raise InputError("command line", "NAME", str(name), "the name of a folder that is not there yet is allowed")
    ensure_writable(name)
    title = visible(name.name).replace("\\", "").replace('"', "")
    scene = (TEMPLATES / f"{kind}.toml").read_text(encoding="utf-8").replace('title = "NAME"', f'title = "{title}"')
    (name / "scene.toml").write_text(f"#:schema {SCHEMA}\n{scene}", encoding="utf-8")
    (name / SCHEMA).write_text(scene_schema(), encoding="utf-8")
    about = {
        "scene.toml": f"what is built and asked, with comments; `pmr run {name}` computes it",
        SCHEMA: "from which an editor completes and checks keys",
    }
    if "[[sections]]" not in scene:
        mesh = TEMPLATES / f"mesh_of_a_{'box' if '[body.box]' in scene else 'beam'}.py"
        (name / "mesh.py").write_text(mesh.read_text(encoding="utf-8"), encoding="utf-8")
        about["mesh.py"] = "draws a mesh of its own, for a start"
    for file, what in about.items():
        say(out, f"{name / file}  {what}")
