"""A folder of results that came from elsewhere moves and removes nothing but its own files.
Where what serves again is cached for a user.
"""

import errno
import json
import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pmr import InputError
from pmr.errors import non_finite_names, non_finite_remarks
from pmr.files import npz, whole
from pmr.files.whole import NotWrittenError, finish_swap, remove_matching, replacement_file, replacement_folder


def test_a_file_appears_when_it_is_whole(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("old")
    with replacement_file(file) as part:
        part.write_text("new")
        assert file.read_text() == "old"
    assert file.read_text() == "new" and list(tmp_path.iterdir()) == [file]


def test_a_disk_that_is_only_read_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """There neither a file can be made nor one that is not there be removed."""

    def refused(*_: object, **__: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system")

    monkeypatch.setattr(Path, "unlink", refused)
    with pytest.raises(NotWrittenError, match="file could not be written: Read-only file system"):
        with replacement_file(tmp_path / "file") as part:
            refused(part)


@pytest.mark.parametrize(
    ("error", "seen"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), NotWrittenError),
        (FileNotFoundError(errno.ENOENT, "no such file"), FileNotFoundError),
        (KeyboardInterrupt(), KeyboardInterrupt),
    ],
)
def test_whatever_goes_wrong_leaves_the_old_file_and_no_part(tmp_path: Path, error: BaseException, seen: type) -> None:
    file = tmp_path / "file"
    file.write_text("old")
    with pytest.raises(seen) as caught, replacement_file(file) as part:
        part.write_text("half")
        raise error
    assert file.read_text() == "old" and list(tmp_path.iterdir()) == [file]
    if seen is NotWrittenError:
        assert str(caught.value) == f"{file} could not be written: No space left on device"


OURS = ("a", "b", "c", "steps/*.vtu")
#: Writes new files into a folder and is killed at the k-th change of a name or removal; where there is none, it ends.
KILLED = """
import os, signal, sys
from pathlib import Path
from pmr.files import whole
left = int(sys.argv[2])
def counted(function):
    def call(*arguments, **options):
        global left
        left -= 1
        if left < 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return function(*arguments, **options)
    return call
os.replace, Path.rename, Path.unlink = counted(os.replace), counted(Path.rename), counted(Path.unlink)
whole.shutil.rmtree = counted(whole.shutil.rmtree)
with whole.replacement_folder(Path(sys.argv[1]), ("a", "b", "c", "steps/*.vtu")) as new:
    for name in ("a", "c", "steps/1.vtu"):
        (new / name).parent.mkdir(exist_ok=True)
        (new / name).write_text("new")
"""
#: Files may have 4,000 bytes; the second has more.
LARGE = """
import resource, sys
from pathlib import Path
from pmr.files.whole import replacement_folder
resource.setrlimit(resource.RLIMIT_FSIZE, (4000, 4000))
with replacement_folder(Path(sys.argv[1]), ("a", "b")) as new:
    (new / "a").write_bytes(bytes(1000))
    (new / "b").write_bytes(bytes(5000))
"""
OLD = {"a": "old", "b": "old", "steps/1.vtu": "old", "steps/2.vtu": "old"}
NEW = {"a": "new", "c": "new", "steps/1.vtu": "new"}
FOREIGN = {"notes.txt": "mine", "steps/mine.txt": "mine"}


def fill(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def content(folder: Path) -> dict[str, str]:
    return {path.relative_to(folder).as_posix(): path.read_text() for path in folder.rglob("*") if path.is_file()}


def test_new_files_take_the_place_of_the_old_ones_and_nothing_else_is_touched(tmp_path: Path) -> None:
    fill(tmp_path, OLD | FOREIGN)
    with replacement_folder(tmp_path, OURS) as new:
        fill(new, NEW)
        assert {name: text for name, text in content(tmp_path).items() if "pmr-new" not in name} == OLD | FOREIGN
    assert content(tmp_path) == NEW | FOREIGN
    assert not list(tmp_path.glob(".pmr*"))


def test_an_error_leaves_the_old_files(tmp_path: Path) -> None:
    fill(tmp_path, OLD | FOREIGN)
    with pytest.raises(RuntimeError), replacement_folder(tmp_path, OURS) as new:
        fill(new, NEW)
        raise RuntimeError
    assert content(tmp_path) == OLD | FOREIGN and not list(tmp_path.glob(".pmr*"))


@pytest.mark.slow
def test_killed_at_any_moment_all_files_are_the_old_or_all_are_the_new_ones(tmp_path: Path) -> None:
    seen, ended = [], False
    for k in range(40):
        folder = tmp_path / str(k)
        fill(folder, OLD | FOREIGN)
        done = subprocess.run([sys.executable, "-c", KILLED, str(folder), str(k)], check=False)
        finish_swap(folder)
        found = content(folder)
        assert found in (OLD | FOREIGN, NEW | FOREIGN)
        assert not list(folder.glob(".pmr*"))
        seen.append(found == NEW | FOREIGN)
        if done.returncode == 0:
            ended = True
            break
    assert ended and len(seen) > 5 and not seen[0] and seen[-1]
    assert seen == sorted(seen)  # once they count, they stay


def test_where_there_is_no_room_the_old_files_stay_and_one_line_says_so(tmp_path: Path) -> None:
    fill(tmp_path, {"a": "old", "notes.txt": "mine"})
    left = subprocess.run([sys.executable, "-c", LARGE, str(tmp_path)], check=False, capture_output=True, text=True)
    assert left.returncode == 1
    assert left.stderr.splitlines()[-1].endswith(f"NotWrittenError: {tmp_path} could not be written: File too large")
    assert content(tmp_path) == {"a": "old", "notes.txt": "mine"} and not list(tmp_path.glob(".pmr*"))


def test_a_folder_that_another_process_is_writing_is_left_to_it(tmp_path: Path) -> None:
    with replacement_folder(tmp_path, OURS) as new:
        fill(new, NEW)
        finish_swap(tmp_path)
        with replacement_folder(tmp_path, OURS) as second:
            fill(second, {"a": "second"})
        assert content(tmp_path)["a"] == "second"
    assert content(tmp_path) == NEW


def test_a_link_and_the_current_directory_may_be_the_target(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fill(tmp_path / "real", OLD)
    (tmp_path / "link").symlink_to(tmp_path / "real")
    with replacement_folder(tmp_path / "link", OURS) as new:
        fill(new, NEW)
    assert (tmp_path / "link").is_symlink() and content(tmp_path / "real") == NEW
    monkeypatch.chdir(tmp_path / "real")
    with replacement_folder(Path(), OURS) as new:
        fill(new, {"b": "newer"})
    assert content(tmp_path / "real") == {"b": "newer"}
    assert os.path.samefile(Path(), tmp_path / "real")


def test_what_has_no_place_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="d: not among"), replacement_folder(tmp_path, OURS) as new:
        fill(new, {"d": "new"})
    (tmp_path / "a").mkdir()
    with pytest.raises(NotWrittenError, match="a is a folder"), replacement_folder(tmp_path, OURS) as new:
        fill(new, {"a": "new"})
    remove_matching(tmp_path, OURS)
    assert (tmp_path / "a").is_dir()


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
    with pytest.raises(InputError, match="may only name files of the folder that it is in"):
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


DATA: dict[str, Any] = {
    "errors": {"reduced_vs_full": {"tip": math.nan, "beam": 0.5}},
    "list": [1.0, math.inf, {"x": -math.inf}],
    "tuple": (math.nan,),
    "numpy": np.float64("nan"),
    "none": None,
    "text": "NaN",
    "count": 3,
}


def refused(constant: str) -> Any:
    raise ValueError(constant)


def test_numbers_that_are_not_finite_are_null() -> None:
    read = json.loads(npz.json_text(DATA, indent=1), parse_constant=refused)
    assert read == {
        "errors": {"reduced_vs_full": {"tip": None, "beam": 0.5}},
        "list": [1.0, None, {"x": None}],
        "tuple": [None],
        "numpy": None,
        "none": None,
        "text": "NaN",
        "count": 3,
    }


def test_they_are_named() -> None:
    assert list(non_finite_names(DATA)) == ["errors.reduced_vs_full.tip", "list[1]", "list[2].x", "tuple[0]", "numpy"]
    assert non_finite_remarks({"a": 1.0}) == []
    assert non_finite_remarks({"a": math.inf}) == ["a is not finite; in summary.json it is null"]


def test_what_is_no_data_is_refused() -> None:
    with pytest.raises(TypeError, match="JSON"):
        npz.json_text({"a": object()})


@pytest.mark.parametrize(
    ("variables", "expected"),
    [
        ({"PMR_CACHE": "own", "XDG_CACHE_HOME": "all"}, "own"),
        ({"PMR_CACHE": "", "XDG_CACHE_HOME": "all"}, "all/pmr"),
        ({"PMR_CACHE": "", "XDG_CACHE_HOME": ""}, "home/.cache/pmr"),
    ],
)
def test_measured_structures_are_cached_where_the_user_says(variables, expected, tmp_path: Path, monkeypatch) -> None:
    for name, place in ({"HOME": "home"} | variables).items():
        monkeypatch.setenv(name, str(tmp_path / place) if place else "")
    assert whole.user_cache_folder() == tmp_path / expected


def test_a_user_without_home_has_the_folder_that_is_named_or_none(tmp_path: Path, monkeypatch) -> None:
    """As in a container whose user is in no list of users."""

    def no_home() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", no_home)
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    monkeypatch.setenv("PMR_CACHE", str(tmp_path))
    assert whole.user_cache_folder() == tmp_path
    monkeypatch.setenv("PMR_CACHE", "")
    assert whole.user_cache_folder() is None


def test_the_oldest_files_go_and_no_folder_is_no_error(tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("PMR_CACHE", str(tmp_path / "kept"))
    monkeypatch.setattr(whole, "MOST_KEPT", 2)
    folder = whole.user_cache_folder()
    assert folder == tmp_path / "kept"
    for age, name in enumerate("cba"):
        (folder / f"{name}.npz").touch()
        os.utime(folder / f"{name}.npz", (age, age))
    assert whole.user_cache_folder() is not None and sorted(file.name for file in folder.iterdir()) == [
        "a.npz",
        "b.npz",
    ]
    (tmp_path / "file").touch()
    monkeypatch.setenv("PMR_CACHE", str(tmp_path / "file" / "kept"))
    assert whole.user_cache_folder() is None
