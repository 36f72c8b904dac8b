"""Files that are whole under their name, or not there: a kill, a full disk or an error leaves what was there before.

Locks on files and folders too, which the system takes from a process that dies.
"""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib import import_module, util
from pathlib import Path
from typing import Any

PART = ".part"
#: No room, or none for this user, or a file larger than allowed.
_NO_ROOM = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO, errno.EACCES, errno.EPERM, errno.EISDIR}
_NO_ROOM |= {errno.ENAMETOOLONG, errno.ENOTDIR, errno.ELOOP}
#: The disk is full, whatever was to be written: compiled code and drawn meshes too.
FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_fcntl: Any = import_module("fcntl") if util.find_spec("fcntl") else None  # Windows has none


class NotWrittenError(OSError):
    """Something could not be written, and what was there before still is; the message is one line."""

    reason = ""  #: The system's own words; empty where it was not asked


def ensure_ordinary(path: Path) -> None:
    """Raise NotWrittenError unless `path` is an ordinary file or not there: links, devices and folders are kept."""
    if path.is_symlink() or (path.exists() and not path.is_file()):
        kind = "a link" if path.is_symlink() else "a folder" if path.is_dir() else "a device or a pipe"
        raise NotWrittenError(f"{path} is {kind}, which is not replaced; a file, or a name that is free, is allowed")


@contextmanager
def replacement(path: Path) -> Iterator[Path]:
    """A name to write to, which takes the place of `path` in one step when the block ends without an error.

    Raises NotWrittenError as `ensure_ordinary`, or if there is no room; nothing of the new file is left.
    """
    ensure_ordinary(path)
    part = path.with_name(f"{path.name}.{os.getpid()}{PART}")
    try:
        with report_full_disk(path):
            yield part
            flush_file(part)
            os.replace(part, path)
    finally:
        with suppress(OSError):  # not there, or on a disk that can't be written to
            part.unlink()


@contextmanager
def report_full_disk(path: Path) -> Iterator[None]:
    """Raise NotWrittenError of `path` in place of the system's error where the block finds no room on the disk."""
    try:
        yield
    except OSError as error:
        reason = error.reason if isinstance(error, NotWrittenError) else str(error.strerror)
        if not reason or (not isinstance(error, NotWrittenError) and error.errno not in _NO_ROOM):
            raise
        failure = NotWrittenError(f"{path} could not be written: {reason}")
        failure.reason = reason
        raise failure from None


def flush_file(path: Path) -> None:
    """Have a file's content on the disk before its name says that it is there."""
    with path.open("rb") as file:
        os.fsync(file.fileno())


@contextmanager
def hold_lock(path: Path, wait: bool = True) -> Iterator[bool]:
    """Hold the lock of a file or folder that is there.

    False where the file system has none, and, with `wait` false, where another process holds it.

    Raises FileNotFoundError if there is nothing of this name.
    """
    if _fcntl is None:
        yield False
        return
    place = os.open(path, os.O_RDONLY)
    try:
        try:
            _fcntl.flock(place, _fcntl.LOCK_EX | (0 if wait else _fcntl.LOCK_NB))
        except OSError:
            yield False
        else:
            yield True
    finally:
        os.close(place)
