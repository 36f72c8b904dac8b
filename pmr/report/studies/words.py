"""Names of scenes and lists as they stand in sentences."""

from __future__ import annotations

from collections.abc import Iterable


def case_name(scene: str) -> str:
    """A scene's file as it is called in a sentence: ``paper_evolved`` is the evolved case."""
    name = scene.removeprefix("paper_").replace("_", " ")
    return f"{name} case" if scene.startswith("paper_") else name


def listed(words: Iterable[str]) -> str:
    """``a, b and c``."""
    *most, last = words
    return f"{', '.join(most)} and {last}" if most else last
