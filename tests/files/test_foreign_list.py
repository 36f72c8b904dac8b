"""A folder of results that came from elsewhere moves and removes nothing but its own files."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from pmr.errors import InputError
from pmr.files.whole import finish_swap


def begun(folder: Path, moves: Any) -> None:
    """What a process that was killed leaves, or somebody who would like to be taken for one."""
    (folder / ".pmr-complete").mkdir(parents=True)
    (folder / ".pmr-complete" / "new.txt").write_text("new")
    (folder / ".pmr-complete" / ".moves.json").write_text(moves if isinstance(moves, str) else json.dumps(moves))


@pytest.mark.parametrize("key", ["names", "gone"])
@pytest.mark.parametrize("way", ["../kept.txt", "a/../../kept.txt", "absolute", "link/kept.txt"])
def test_nothing_outside_of_the_folder_is_touched(tmp_path: Path, key: str, way: str) -> None:
    (tmp_path / "kept.txt").write_text("kept")
    folder = tmp_path / "results"
    name = str(tmp_path / "kept.txt") if way == "absolute" else way
    begun(folder, {"names": [], "gone": []} | {key: [name]})
    (folder / "link").symlink_to(tmp_path)
    with pytest.raises(InputError, match="only files of this folder"):
        finish_swap(folder)
    assert (tmp_path / "kept.txt").read_text() == "kept"


@pytest.mark.parametrize("moves", ["", "[]", "{}", '{"names": 1, "gone": []}', '{"names": ["a\\u0000"], "gone": []}'])
def test_a_list_that_is_none_is_one_line(tmp_path: Path, moves: str) -> None:
    begun(tmp_path / "results", moves)
    with pytest.raises(InputError) as caught:
        finish_swap(tmp_path / "results")
    assert len(str(caught.value).splitlines()) == 1


def test_what_a_killed_process_had_begun_is_finished(tmp_path: Path) -> None:
    folder = tmp_path / "results"
    begun(folder, {"names": ["new.txt"], "gone": ["old.txt"]})
    (folder / "old.txt").write_text("old")
    finish_swap(folder)
    assert sorted(path.name for path in folder.iterdir()) == ["new.txt"]
