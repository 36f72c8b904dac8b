"""The command ``pmr schema``: the keys of a file, for editors that complete and check."""

from __future__ import annotations

import json
import sys
from typing import Annotated

import typer

from pmr.errors import InputError
from pmr.errors.text import hint
from pmr.scene import Scene
from pmr.studies.files import schemas


def schema(
    kind: Annotated[
        str, typer.Argument(metavar="[KIND]", help="scene, or a kind of study: combinations, scenes, ...")
    ] = "scene",
) -> None:
    """Print the JSON schema of a scene file, or of a kind of study file.

    An editor that knows TOML (Even Better TOML, Taplo) reads it from the first line of a file:

        #:schema ./scene.schema.json

    Example:

        pmr schema > scene.schema.json
    """
    known = {
        "scene": Scene.model_json_schema,
        **{name: lambda s=found: s for name, found in schemas().items()},
    }
    if kind not in known:
        raise InputError("command line", "KIND", kind, f"{hint(kind, known)}one of {', '.join(known)} is allowed")
    json.dump(known[kind](), sys.stdout, indent=2)
    sys.stdout.write("\n")
