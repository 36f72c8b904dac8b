"""What a study is made of: a body alone, or a boom of sections."""

from __future__ import annotations

from pathlib import Path

from pmr import scene as scenes
from pmr.scene import Scene


def boom(path: Path) -> Scene | None:
    """The boom that a file describes; None where it is a body alone."""
    return scenes.load_any(path) if scenes.has_sections(path) else None


def either(path: Path) -> Scene:
    """The boom that a file describes, or the planar beam; errors as for `pmr.scene.beam_scene`."""
    return boom(path) or scenes.beam_scene(path)
