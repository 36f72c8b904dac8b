from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pmr.files.whole import NotWrittenError, finish_swap, remove_matching, replacement_folder

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
