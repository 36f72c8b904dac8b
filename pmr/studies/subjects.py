"""What a study is made of: a body alone or a boom of sections; which kinds take which, and why others are refused."""

from __future__ import annotations

from pathlib import Path

from pmr import scene as scenes
from pmr.errors import InputError
from pmr.scene import Scene

#: Why a kind of study takes no boom of sections.  All other kinds do.
OF_ONE_BODY = {
    "combinations": "eigenmodes are taken with the slider held on its path, and each section has a path of its own",
    "error_map": "eigenmodes are taken with the slider held on its path, and each section has a path of its own",
}


def beam(path: Path, kind: str, key: str) -> Scene:
    """The scene of a planar beam that a study names under a key.

    Raises InputError with the reason if it has sections and the kind takes none; errors of `pmr.scene.beam_scene` else.
    """
    if kind in OF_ONE_BODY and scenes.has_sections(path):
        raise InputError("study", key, path.name, f"a scene of one body is allowed: {OF_ONE_BODY[kind]}")
    return scenes.beam_scene(path)


def boom(path: Path) -> Scene | None:
    """The boom that a file describes; None where it is a body alone."""
    return scenes.load_any(path) if scenes.has_sections(path) else None
