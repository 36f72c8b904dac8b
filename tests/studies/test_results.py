import json
import os
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

from pmr.files.npz import HEADER, DamagedError, write
from pmr.studies.study import STALE_AFTER, CountedWarning, RunRecord, Store, StudyResults
from pmr.studies.tasks import TaskResult

FIGURES = {"e": 0.1, "ok": True, "count": 3}
PULLED = (
    "the rope of fly would have to push with up to 1.5e3 N at t = 7.31 s: the model holds both ways",
    "the model is off by up to 57 % beside a coarse shell; a richer one is closer",
)


def results(folder: Path) -> StudyResults:
    return StudyResults(
        folder,
        (
            RunRecord(
                "a",
                "done",
                {"n": 1, "solver": "x, y"},
                {"e": 0.1, "ok": True, "count": 3},
                {"task": 1.0},
                warnings=PULLED,
            ),
            RunRecord("b", "failed", {"n": 2, "solver": None}, {}, {}, 'said "no"', "Traceback"),
            RunRecord(
                "c",
                "done",
                {"n": 3, "solver": "z"},
                {"e": 1e-17, "ok": False, "more": 2.0},
                {"task": 2.0},
                warnings=("the rope of fly would have to push with up to 3 N at t = 1 s: the model holds both ways",),
            ),
        ),
    )


def test_columns_come_in_the_order_in_which_they_come_up(tmp_path: Path) -> None:
    found = results(tmp_path)
    found.save({})
    assert (tmp_path / "runs.csv").read_text() == (
        "run,status,reason,n,solver,e,ok,count,more,warnings\n"
        f'a,done,,1,"x, y",0.1,true,3,,{PULLED[0]} | {PULLED[1]}\n'
        'b,failed,"said ""no""",2,,,,,,\n'
        f"c,done,,3,z,1e-17,false,,2.0,{found.runs[2].warnings[0]}\n"
    )
    assert (tmp_path / "seconds.csv").read_text() == "run,task\na,1.0\nb,\nc,2.0\n"


def test_a_column_has_the_type_that_holds_all_its_values(tmp_path: Path) -> None:
    found = results(tmp_path)
    assert found.column("n").tolist() == [1, 2, 3] and found.column("n").dtype.kind == "i"
    assert found.column("solver").tolist() == ["x, y", "", "z"]
    e, ok = found.column("e"), found.column("ok")
    assert e[2] == 1e-17 and np.isnan(e[1]) and ok[0] == 1.0 and np.isnan(ok[1])
    found.save({})
    with np.load(tmp_path / "runs.npz", allow_pickle=False) as table:
        assert all(np.array_equal(table[name], found.column(name), equal_nan=name in {"e", "ok", "count", "more"})
                   for name in table)  # fmt: skip


def test_what_was_saved_is_loaded(tmp_path: Path) -> None:
    found = results(tmp_path)
    found.save({"title": "Three"})
    assert StudyResults.load(tmp_path) == found and not found.is_complete
    assert json.loads((tmp_path / "summary.json").read_text())["title"] == "Three"


def test_warnings_are_counted_by_their_kind(tmp_path: Path) -> None:
    """Numbers differ from run to run; what is said is the text of the run with the largest figure."""
    rope, model = results(tmp_path).warnings
    assert (rope.runs, rope.text) == (("a", "c"), PULLED[0])
    assert rope.line(3) == f"in 2 of 3 runs, first in a: {PULLED[0]}"
    assert model.line(3) == f"in a: {PULLED[1]}" and model.line(1) == PULLED[1]


def test_the_worst_of_a_kind_of_warning_is_shown() -> None:
    """Figures in different units are compared, too."""
    texts = {"a": "pads pull with up to 900 N", "b": "pads pull with up to 1.2 kN", "c": "pads pull with up to 35 N"}
    worst = CountedWarning.of_runs(texts)
    assert worst.line(5) == "in 3 of 5 runs, worst in b: pads pull with up to 1.2 kN"
    assert CountedWarning.of_runs({"a": "no figure", "b": "no figure"}).line(2) == "in all 2 runs: no figure"


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
    assert store.read("abc", only=(HEADER,)).record == RESULT.record


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
