from __future__ import annotations

import os
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

from pmr.files.npz import DamagedError, write
from pmr.studies.results import STALE_AFTER, Store
from pmr.studies.tasks import TaskResult

ARRAYS = {"x": np.linspace(0.0, 1.0, 1000), "names": np.array(["a", "b"]), "none": np.empty((0, 3))}
RESULT = TaskResult({"a": 0.1, "b": None, "c": True, "d": "text"}, ARRAYS, {"task": 2.0}, ("a note",))


@pytest.fixture
def store(tmp_path: Path) -> Store:
    store = Store(tmp_path / "tasks")
    store.prepare()
    store.write("abc", "key", RESULT)
    return store


def test_what_was_written_is_read_again(store: Store) -> None:
    back = store.read("abc")
    assert store.is_sound("abc") and back.warnings == ("a note",)
    assert back.record == RESULT.record and list(back.record) == ["a", "b", "c", "d"]
    assert back.seconds == {"task": 2.0} and list(back.arrays) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert np.array_equal(back.arrays[name], array)
        assert not back.arrays[name].flags.writeable  # shared by all tasks of a process
    assert store.read_without_arrays("abc").record == RESULT.record


def test_no_part_of_a_result_is_taken_for_the_whole(store: Store) -> None:
    content = store.path("abc").read_bytes()
    for length in range(0, len(content), 97):
        store.path("abc").write_bytes(content[:length])
        assert not store.is_sound("abc")
        with pytest.raises(DamagedError, match="abc.npz is missing or damaged"):
            store.read("abc")


def test_a_flipped_bit_anywhere_in_the_content_is_noticed(store: Store) -> None:
    content = store.path("abc").read_bytes()
    array = ARRAYS["x"].tobytes()
    assert array in content
    start = content.index(array)
    for at in range(start, start + len(array), 501):
        flipped = bytearray(content)
        flipped[at] ^= 1
        store.path("abc").write_bytes(flipped)
        assert not store.is_sound("abc")
        with pytest.raises(DamagedError):
            store.read("abc")


def test_objects_are_not_stored(store: Store) -> None:
    with pytest.raises(ValueError, match="allow_pickle"):
        store.write("def", "key", TaskResult(arrays={"x": np.array([{}])}))
    assert not store.is_sound("def")


def test_equal_arrays_give_equal_files(tmp_path: Path) -> None:
    for name in "ab":
        write(tmp_path / name, ARRAYS)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    with zipfile.ZipFile(tmp_path / "a") as file:
        assert {info.date_time[0] for info in file.infolist()} == {1980}  # and not the time of writing
    with np.load(tmp_path / "a", allow_pickle=False) as data:
        assert np.array_equal(data["x"], ARRAYS["x"])


def test_a_file_is_replaced_in_one_step(store: Store) -> None:
    with store.path("abc").open("rb") as reader:  # someone reads while another one writes
        beginning = reader.read(100)
        store.write("abc", "other", TaskResult({"other": True}))
        assert beginning + reader.read() != store.path("abc").read_bytes()
        reader.seek(0)
        assert reader.read(100) == beginning
    assert store.read("abc").record == {"other": True}


def test_what_was_left_half_written_is_cleared_away_later(store: Store) -> None:
    fresh, stale = store.folder / "a.npz.1.part", store.folder / "b.npz.1.part"
    for file in (fresh, stale):
        file.write_bytes(b"PK")
    os.utime(stale, (0.0, time.time() - 2.0 * STALE_AFTER))
    store.prepare()
    assert fresh.exists() and not stale.exists() and store.is_sound("abc")
