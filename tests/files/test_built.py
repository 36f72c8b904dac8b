from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from pmr.fem.compat import MPI
from pmr.files.whole import complete_folder

#: Takes the lock of a folder, begins to make it, and is killed.
KILLED = """
import os, sys, signal
from pathlib import Path
from pmr.files.whole import complete_folder
from pmr.fem.compat import MPI
def make(folder):
    (folder / "half").write_text("")
    os.kill(os.getpid(), signal.SIGKILL)
complete_folder(Path(sys.argv[1]), Path.is_dir, make, MPI.COMM_SELF)
"""


def whole(folder: Path) -> bool:
    return (folder / "content").is_file()


def filled(folder: Path) -> str:
    """Fill an empty folder, read a whole one."""
    if not list(folder.iterdir()):
        (folder / "content").write_text("made once")
        return "made"
    return (folder / "content").read_text()


def test_a_folder_is_made_once_and_read_from_then_on(tmp_path: Path) -> None:
    folder = tmp_path / "deep" / "folder"
    assert complete_folder(folder, whole, filled, MPI.COMM_SELF) == "made"
    assert complete_folder(folder, whole, filled, MPI.COMM_SELF) == "made once"


def test_nothing_is_left_of_what_fails(tmp_path: Path) -> None:
    def fail(folder: Path) -> None:
        (folder / "half").write_text("")
        raise RuntimeError("no compiler")

    with pytest.raises(RuntimeError, match="no compiler"):
        complete_folder(tmp_path / "folder", whole, fail, MPI.COMM_SELF)
    assert [path.name for path in tmp_path.iterdir()] == ["folder.lock"]


@pytest.mark.slow
def test_what_a_dead_process_left_is_removed_and_its_lock_is_free(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    died = subprocess.run([sys.executable, "-c", KILLED, str(folder)], check=False)
    assert died.returncode < 0
    assert list(tmp_path.glob("*.part"))
    assert complete_folder(folder, whole, filled, MPI.COMM_SELF) == "made"
    assert not list(tmp_path.glob("*.part"))


def test_a_folder_that_is_not_whole_is_made_anew(tmp_path: Path) -> None:
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "half").write_text("")
    assert complete_folder(folder, whole, filled, MPI.COMM_SELF) == "made"
    assert [path.name for path in folder.iterdir()] == ["content"]


@pytest.mark.mpi
def test_all_ranks_read_what_the_first_has_made(tmp_path: Path) -> None:
    comm = MPI.COMM_WORLD
    folder = Path(comm.bcast(str(tmp_path))) / "folder"

    def make(place: Path) -> str:
        if comm.rank == 0 and not list(place.iterdir()):
            (place / "content").write_text("made once")
        comm.barrier()
        return (place / "content").read_text()

    assert [complete_folder(folder, whole, make, comm) for _ in range(2)] == ["made once"] * 2
