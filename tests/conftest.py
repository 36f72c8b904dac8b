from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from pmr import scene
from pmr.scene import Scene

WORKFLOWS = Path(__file__).parents[1] / "workflows"


@pytest.fixture(scope="session")
def load_scene() -> Callable[..., Scene]:
    """A scene of ``workflows/`` with overrides."""

    def load(name: str = "paper_simple", overrides: Sequence[str] = ()) -> Scene:
        return scene.load(WORKFLOWS / f"{name}.toml", overrides)

    return load
