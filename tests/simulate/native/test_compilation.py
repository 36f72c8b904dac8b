"""The cache on disk: used again, and not once a source has changed."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import pytest

from pmr.simulate.native import compilation as compiled

SOURCE = """
from pmr.simulate.native.compilation import compiled

@compiled
def twice(x):
    return 2.0 * x
"""


def load(folder: Path) -> Any:
    specification = importlib.util.spec_from_file_location("some_kernel", folder / "some_kernel.py")
    assert specification and specification.loader
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module.twice


def test_compiled_once_and_again_after_a_change_in_the_room(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "some_kernel.py").write_text(SOURCE)
    hits = []
    for sources in ("one", "one", "another"):
        monkeypatch.setattr(compiled, "_SOURCES", sources)
        twice = load(tmp_path)
        assert twice(1.5) == 3.0
        hits.append(sum(twice.stats.cache_hits.values()))
    assert hits == [0, 1, 0]
