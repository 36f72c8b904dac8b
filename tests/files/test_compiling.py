"""Compiled forms are whole or not there: where one process is killed while it compiles, the next goes on."""

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from waiting import PATIENCE, wait_until

from pmr import InputError
from pmr.fem import compat
from pmr.fem.compat import MPI
from pmr.files.whole import complete_folder

SCRIPT = Path(__file__).with_name("compiling.py")
#: Twenty interruptions take two minutes; `PMR_SWEEP=full` has them all.
INTERRUPTIONS = 20 if os.environ.get("PMR_SWEEP") == "full" else 3
MASS = "6.0"  # kg, 3 kg/m over 2 m


def start(cache: Path, *arguments: str) -> subprocess.Popen[str]:
    """The script with a cache of its own, in a group of its own as a terminal makes one."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("OMPI_", "PMIX_"))}
    return subprocess.Popen(
        [sys.executable, str(SCRIPT), *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment | {"XDG_CACHE_HOME": str(cache)},
        start_new_session=True,
    )


def finished(process: subprocess.Popen[str]) -> str:
    said, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, errors
    return said.split()[-1]


@pytest.mark.slow
def test_a_first_compilation_may_be_interrupted_at_any_time(tmp_path: Path) -> None:
    """The first one as soon as FFCx has begun to compile; a process that has compiled all waits for its end."""
    rng = np.random.default_rng(14)
    for k in range(INTERRUPTIONS):
        cache = tmp_path / str(k)
        process = start(cache, "wait")
        wait_until(lambda cache=cache: list(cache.rglob("libffcx_*.c")), process)
        time.sleep(rng.uniform(0.0, 0.5) if k else 0.0)
        interrupt(process, (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)[k % 3])
        assert finished(start(cache)).endswith(MASS)
        assert not list(cache.rglob("*.part"))  # what the dead process left


def interrupt(process: subprocess.Popen[str], signal_number: int) -> None:
    """Return when it has ended, and with it the compiler, which holds its outputs; Ctrl-C reaches the compiler, too."""
    for _ in range(100):
        if signal_number == signal.SIGINT:
            os.killpg(process.pid, signal_number)
        else:
            process.send_signal(signal_number)
        try:
            process.communicate(timeout=5.0)
            break
        except subprocess.TimeoutExpired:  # Python ignores a signal while it shuts down
            continue
    assert process.returncode != 0


@pytest.mark.slow
def test_processes_that_need_the_same_form_at_once_compile_it_once(tmp_path: Path) -> None:
    processes = [start(tmp_path) for _ in range(3)]
    assert {finished(process) for process in processes} == {MASS}
    folders = [path for path in (tmp_path / "fenics" / "pmr").iterdir() if path.is_dir()]
    assert folders and not list(tmp_path.rglob("*.part"))
    modules = [file.name for file in tmp_path.rglob("libffcx_*.c.cached")]
    assert len(modules) == len(set(modules)) == len(folders)


@pytest.mark.slow
def test_a_damaged_cache_is_made_anew(tmp_path: Path) -> None:
    """A module cut off, as a power failure leaves it, and one without FFCx' mark."""
    assert finished(start(tmp_path)) == MASS
    modules = sorted(tmp_path.rglob("libffcx_*.so"))
    modules[0].write_bytes(b"")
    next(modules[-1].parent.glob("*.c.cached")).unlink()
    assert finished(start(tmp_path)) == MASS
    assert finished(start(tmp_path)) == MASS


@pytest.mark.parametrize("code", [errno.EROFS, errno.EACCES, errno.ENOTDIR])
def test_a_folder_for_compiled_forms_that_is_only_read_is_refused(code: int, monkeypatch: pytest.MonkeyPatch) -> None:
    def stored(*_: object) -> None:
        raise OSError(code, os.strerror(code))

    def create(jit_params: object = None, jit_options: object = None) -> None: ...

    monkeypatch.setattr(compat, "complete_folder", stored)
    with pytest.raises(InputError, match=f"XDG_CACHE_HOME = .* needed that can be written to .{os.strerror(code)}"):
        compat._compile_once(compat.MPI.COMM_SELF, "form", create)


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
