"""Commands to begin with: ``new`` and ``schema``, and ``compile`` of earlier versions."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from importlib import resources
from os.path import lexists
from pathlib import Path
from typing import Annotated

import typer

from pmr.cli.console import out, prepare_folder, print_text
from pmr.errors import InputError
from pmr.errors.text import escape_controls, similar_name_hint


def scene_schema() -> str:
    """Return the JSON schema of a scene file as text."""
    from pmr.scene.hints import scene_file_schema

    return json.dumps(scene_file_schema(), indent=1) + "\n"


def study_schema(*kinds: str) -> str:
    """Return as text the JSON schema of a study file of the given kinds; without kinds, that of all kinds."""
    from pmr.scene.hints import union_schema
    from pmr.studies.files import schemas

    schemas_by_kind = schemas()
    return (
        json.dumps(union_schema([schemas_by_kind[kind] for kind in kinds or schemas_by_kind], "Study of pmr"), indent=1)
        + "\n"
    )


def schema(
    kind: Annotated[
        str, typer.Argument(metavar="[KIND]", help="scene, study, or one kind of study: scenes, ...")
    ] = "scene",
) -> None:
    """Print the JSON schema of a scene file or a study file.

    An editor that knows TOML (Even Better TOML, Taplo) reads it from the first line of a file:

        #:schema scene.schema.json

    Example:

        pmr schema > scene.schema.json
    """
    from pmr.studies.files import kind_names

    makers: dict[str, Callable[[], str]] = {"scene": scene_schema, "study": study_schema}
    makers |= {name: partial(study_schema, name) for name in kind_names()}
    if kind not in makers:
        raise InputError(
            "command line", "KIND", kind, f"{similar_name_hint(kind, makers)}one of {', '.join(makers)} is allowed"
        )
    out.print(makers[kind](), soft_wrap=True, end="")


SCHEMA = "scene.schema.json"
TEMPLATES = resources.files("pmr.cli") / "templates"


def scene_kinds() -> list[str]:
    """Return the names of the scenes that ``pmr new`` offers."""
    return sorted(file.name.removesuffix(".toml") for file in TEMPLATES.iterdir() if file.name.endswith(".toml"))


def new(
    kind: Annotated[
        str,
        typer.Argument(metavar="KIND", help="beam, boom, telescope, crane or platform.", autocompletion=scene_kinds),
    ],
    name: Annotated[Path, typer.Argument(metavar="NAME", help="New folder, whose name is the title of the scene.")],
) -> None:
    """Write a scene with comments into a new folder.

    For one body there is also a script that draws a mesh.

    Example:

        pmr new boom mine && pmr run mine
    """
    if kind not in scene_kinds():
        raise InputError(
            "command line",
            "KIND",
            kind,
            f"{similar_name_hint(kind, scene_kinds())}{', '.join(scene_kinds())} are allowed",
        )
    if lexists(name):
        raise InputError("command line", "NAME", str(name), "the name of a folder that is not there yet is allowed")
    prepare_folder(name)
    title = escape_controls(name.name).replace("\\", "").replace('"', "")
    scene = (TEMPLATES / f"{kind}.toml").read_text(encoding="utf-8").replace('title = "NAME"', f'title = "{title}"')
    (name / "scene.toml").write_text(f"#:schema {SCHEMA}\n{scene}", encoding="utf-8")
    (name / SCHEMA).write_text(scene_schema(), encoding="utf-8")
    about = {
        "scene.toml": f"the scene: the structure and what is computed, with comments; `pmr run {name}` computes it",
        SCHEMA: "from which an editor completes and checks keys",
    }
    if "[[sections]]" not in scene:
        mesh = TEMPLATES / f"mesh_of_a_{'box' if '[body.box]' in scene else 'beam'}.py"
        (name / "mesh.py").write_text(mesh.read_text(encoding="utf-8"), encoding="utf-8")
        about["mesh.py"] = "draws a mesh, as a start for one of your own"
    for file, what in about.items():
        print_text(out, f"{name / file}  {what}")


def compile_() -> None:
    """Say that nothing is left to be compiled before a first run.

    pip has compiled the step.  Version 0.2 removes this command of earlier versions.
    """
    print_text(out, "nothing is to be compiled: the step was compiled when pmr was installed")
