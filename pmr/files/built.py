"""Folders that take long to make and are stored: whole under their name or not there, whoever is killed meanwhile.

A folder is made under another name and then renamed.  A lock, which the system takes from a process that dies, lets
one process make it while the others wait for it, and tells what a dead process left from what a living one is making.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar

from pmr.files.whole import hold_lock

Made = TypeVar("Made")


def stored(folder: Path, is_whole: Callable[[Path], bool], make: Callable[[Path], Made], comm: Any) -> Made:
    """Result of `make`, given `folder` if it is whole, or a new folder that then replaces it; collective.

    The folder lies on a disk that all ranks of `comm` see; what rank 0 says counts, which asks `is_whole` whether it
    holds what it should.  `make` loads from a folder that is whole and fills an empty one; it fails on all ranks or on
    none, and a folder that was taken for whole and can't be loaded is made anew.

    Raises OSError on rank 0 if there is no folder to write to.
    """
    first = comm.rank == 0
    complete = comm.bcast(is_whole(folder) if first else None)
    if complete:
        try:
            return make(folder)
        except Exception:
            if first:
                _discard(folder)
    return _make_locked(folder, is_whole, make, comm)


def _make_locked(folder: Path, is_whole: Callable[[Path], bool], make: Callable[[Path], Made], comm: Any) -> Made:
    if comm.rank > 0:
        result = make(comm.bcast(None))
        comm.barrier()
        return result
    folder.parent.mkdir(parents=True, exist_ok=True)
    lock = folder.with_name(f"{folder.name}.lock")
    lock.touch()
    with hold_lock(lock) as alone:  # without locks two processes do the same work, each in a folder of its own
        if is_whole(folder):  # another process has made it while this one waited for the lock
            result = make(comm.bcast(folder))
            comm.barrier()
            return result
        if alone:
            for partial in folder.parent.glob(f"{folder.name}.*.part"):
                _discard(partial)
        part = Path(tempfile.mkdtemp(prefix=f"{folder.name}.", suffix=".part", dir=folder.parent))
        try:
            result = make(comm.bcast(part))
            comm.barrier()  # the other ranks load from it, too
            _publish(part, folder, is_whole)
        finally:
            _discard(part)
        return result


def _publish(part: Path, folder: Path, is_whole: Callable[[Path], bool]) -> None:
    for file in part.iterdir():
        with file.open("rb") as content:
            os.fsync(content.fileno())
    if not is_whole(folder):
        _discard(folder)
        with suppress(OSError):  # without a lock another process may have been faster
            part.rename(folder)


def _discard(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
