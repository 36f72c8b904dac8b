"""The command ``pmr schema``: the keys of a file, for editors that complete and check."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from typing import Annotated

import typer

from pmr.cli.console import out
from pmr.errors import InputError
from pmr.errors.text import hint


def scene_schema() -> str:
    """Schema of a scene file."""
    from pmr.scene.schema import scenes

    return json.dumps(scenes(), indent=1) + "\n"


def study_schema(*kinds: str) -> str:
    """Schema of a study file of these kinds, of any by default."""
    from pmr.scene.schema import union_schema
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
        raise InputError("command line", "KIND", kind, f"{hint(kind, makers)}one of {', '.join(makers)} is allowed")
    out.print(makers[kind](), soft_wrap=True, end="")
