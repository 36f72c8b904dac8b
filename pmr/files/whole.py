"""Files and folders that are written completely or not at all, even if a process is killed; locks; cached folders.

One file (`replacement_file`) is written under another name and renamed when it is complete.  A kill, a full disk or an
error therefore leaves the former file unchanged.

Several files of a folder that belong together (`replacement_folder`) are written into a new folder inside of it.  When
all are complete, this new folder is renamed in one step; from then on the new files count.  Then they are moved one by
one to the names of the old files, which takes less than a millisecond.  If the process is killed in this time, the next
process that opens the folder completes the moves (`finish_swap`).  So the target may be the current directory, a
symbolic link or the root of a disk, and all other files in it are not touched.

A folder that takes long to compute (`complete_folder`) is made under another name and then renamed.  A lock, which the
system releases when its process ends, lets one process make the folder while others wait.  It also distinguishes a
folder that is being made from one that a dead process left.

`user_cache_folder` is the folder in which computed results are cached for a user.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from fnmatch import fnmatch
from importlib import import_module, util
from pathlib import Path
from typing import Any, TypeVar

from pmr.errors import InputError

Made = TypeVar("Made")


PART = ".part"
#: Error numbers of the system for no room, no access, or a file that is larger than allowed.
_NO_ROOM = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO, errno.EACCES, errno.EPERM, errno.EISDIR}
_NO_ROOM |= {errno.ENAMETOOLONG, errno.ENOTDIR, errno.ELOOP}
#: Error numbers of the system for a full disk, or a file that is larger than allowed.
FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_fcntl: Any = import_module("fcntl") if util.find_spec("fcntl") else None  # Windows has none


class NotWrittenError(OSError):
    """A file or folder could not be written, and its former content is unchanged; the message is one line."""

    reason = ""  #: Message of the system; empty if the error is not the system's


def ensure_ordinary(path: Path) -> None:
    """Raise NotWrittenError unless `path` is an ordinary file or does not exist.

    Links, devices and folders are not replaced by files.
    """
    if path.is_symlink() or (path.exists() and not path.is_file()):
        kind = "a link" if path.is_symlink() else "a folder" if path.is_dir() else "a device or a pipe"
        raise NotWrittenError(f"{path} is {kind}, which is not replaced; a file, or a name that is free, is allowed")


@contextmanager
def replacement_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path to write to; the file replaces `path` in one step if the block ends without an error.

    Raises NotWrittenError in the cases of `ensure_ordinary`, or if there is no room; the temporary file is then
    removed.
    """
    ensure_ordinary(path)
    part = path.with_name(f"{path.name}.{os.getpid()}{PART}")
    try:
        with report_full_disk(path):
            yield part
            flush_file(part)
            os.replace(part, path)
    finally:
        with suppress(OSError):  # the file does not exist, or its disk can't be written to
            part.unlink()


def write_text(path: Path, text: str) -> None:
    """Write a text in UTF-8 to a file, whole or not at all, and make its folder; errors as `replacement_file`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacement_file(path) as part:
        part.write_text(text, encoding="utf-8")


@contextmanager
def report_full_disk(path: Path) -> Iterator[None]:
    """Context that raises NotWrittenError about `path` in place of the system's error for a full disk or no access."""
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
    """Write a file's content to the disk; called before the file gets the name of a complete one."""
    with path.open("rb") as file:
        os.fsync(file.fileno())


@contextmanager
def hold_lock(path: Path, wait: bool = True) -> Iterator[bool]:
    """Hold the lock of an existing file or folder during the block; yield whether the lock is held.

    The lock is not held if the file system has no locks, or if `wait` is false and another process holds the lock.  If
    `wait` is true, the call blocks until the other process releases the lock.

    Raises FileNotFoundError if the file or folder does not exist.
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


_NEW, _COMPLETE, _LIST = ".pmr-new-", ".pmr-complete", ".moves.json"


@contextmanager
def replacement_folder(folder: Path, ours: Sequence[str]) -> Iterator[Path]:
    """Yield an empty folder to write to; if the block ends without an error, its files replace files of `folder`.

    `ours` are names, or patterns of names, relative to `folder`, of all files that may ever be written.  Files of
    `folder` with such names that are not written again are removed.  `folder` is created if it does not exist.

    Raises NotWrittenError if there is no room, and ValueError if a file was written whose name is not among `ours`; the
    old files then remain, and the new ones are removed.
    """
    with report_full_disk(folder):
        folder.mkdir(parents=True, exist_ok=True)
        finish_swap(folder)
        new = Path(tempfile.mkdtemp(prefix=_NEW, dir=folder))
    try:
        with hold_lock(new), report_full_disk(folder):
            yield new
            names = _new_file_names(new, folder, ours)
            gone = [name for name in _matching_names(folder, ours) if name not in names]
            (new / _LIST).write_text(json.dumps({"names": names, "gone": gone}))
            for name in (*names, _LIST):
                flush_file(new / name)
            with hold_lock(folder):
                _finish_moves(folder)
                new.rename(folder / _COMPLETE)
                _finish_moves(folder)
    finally:
        shutil.rmtree(new, ignore_errors=True)


def finish_swap(folder: Path) -> None:
    """Complete the moves that a killed process had begun in a folder, and remove its incomplete new files.

    Raises the InputError of `_listed_moves`.
    """
    new_folders = [path for path in folder.glob(f"{_NEW}*") if path.is_dir()]
    if new_folders or (folder / _COMPLETE).exists():
        with report_full_disk(folder), hold_lock(folder):
            _finish_moves(folder)
            for new in new_folders:
                with suppress(FileNotFoundError), hold_lock(new, wait=False) as free:
                    if free:
                        shutil.rmtree(new, ignore_errors=True)


def remove_matching(folder: Path, ours: Sequence[str]) -> None:
    """Remove the files of a folder that match one of the names or patterns `ours`."""
    for name in _matching_names(folder, ours):
        (folder / name).unlink(missing_ok=True)


def _finish_moves(folder: Path) -> None:
    """Move the files of the complete new folder in `folder` to their names in `folder`, and remove old files.

    The old files are removed first, and the emptied new folder last.  A file that was moved before is passed over.
    Without a complete new folder nothing is done; one without a list of moves is removed with its content.  Raises the
    InputError of `_listed_moves`.
    """
    complete = folder / _COMPLETE
    if not complete.is_dir():
        return
    if (complete / _LIST).is_file():
        moves = _listed_moves(complete / _LIST, folder)
        for name in moves["gone"]:
            (folder / name).unlink(missing_ok=True)
        for name in moves["names"]:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            with suppress(FileNotFoundError):  # the file was moved before
                os.replace(complete / name, folder / name)
    shutil.rmtree(complete)


def _listed_moves(file: Path, folder: Path) -> dict[str, list[str]]:
    """Return two lists of files: ``names`` are to be moved into the `folder`, ``gone`` are to be removed from it.

    The lists are read from a `file` of unknown origin.  Raises InputError if the file has no such lists, or names
    anything outside of the folder; no file is touched in that case.
    """
    try:
        content = json.loads(file.read_text())
        moves = {key: [str(name) for name in content[key]] for key in ("names", "gone")}
        inside, listed = folder.resolve(), sum(moves.values(), [])
        foreign = [n for n in listed if "\0" in n or not (folder / n).parent.resolve().is_relative_to(inside)]
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise InputError(str(file), "", None, f"not written by pmr ({error}); delete its folder") from None
    if foreign:
        raise InputError(
            str(file), "", foreign[0], "this list may only name files of the folder that it is in; delete the folder"
        )
    return moves


def _new_file_names(new: Path, folder: Path, ours: Sequence[str]) -> list[str]:
    """Return the names of all files in the folder `new`, in ascending order.

    Raises ValueError if a name is not among `ours`, and NotWrittenError if a file would replace something in `folder`
    that is not an ordinary file.
    """
    names = sorted(path.relative_to(new).as_posix() for path in new.rglob("*") if path.is_file())
    unknown = [name for name in names if not any(fnmatch(name, pattern) for pattern in ours)]
    if unknown:
        raise ValueError(f"{', '.join(unknown)}: not among {', '.join(ours)}")
    for name in names:
        ensure_ordinary(folder / name)
    return names


def _matching_names(folder: Path, ours: Sequence[str]) -> list[str]:
    """Return the names of the files in a folder that match one of the names or patterns `ours`."""
    paths = [path.relative_to(folder).as_posix() for pattern in ours for path in folder.glob(pattern)]
    return [name for name in paths if not (folder / name).is_dir()]


def complete_folder(folder: Path, is_whole: Callable[[Path], bool], make: Callable[[Path], Made], comm: Any) -> Made:
    """Return the result of `make`, called with `folder` if that is complete, else with a new folder that replaces it.

    `make` loads its result from a complete folder, and fills an empty folder; it has to fail on all ranks or on none.
    `is_whole` says on rank 0 whether a folder is complete.  A complete folder that can't be loaded is made again.
    Collective: all ranks of `comm` have to call this function, and all have to see the folder's disk.

    Raises OSError on rank 0 if there is no folder that can be written to.
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
    """Return the result of `make`, called with a new folder that becomes `folder`; collective.

    Rank 0 holds a lock meanwhile, so that only one process makes the folder.  `is_whole` says whether a folder is
    complete.  If another process has completed the folder before the lock is held, `make` loads its result from this
    folder.
    """
    if comm.rank > 0:
        result = make(comm.bcast(None))
        comm.barrier()
        return result
    folder.parent.mkdir(parents=True, exist_ok=True)
    lock = folder.with_name(f"{folder.name}.lock")
    lock.touch()
    with hold_lock(lock) as alone:  # without locks two processes do the same work, each in its own folder
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
            comm.barrier()  # the other ranks load from the folder, too
            _publish(part, folder, is_whole)
        finally:
            _discard(part)
        return result


def _publish(part: Path, folder: Path, is_whole: Callable[[Path], bool]) -> None:
    """Rename the complete temporary folder `part` to `folder`; do nothing if another process has completed `folder`.

    `is_whole` tells whether a folder is complete; an incomplete `folder` is replaced.
    """
    for file in part.iterdir():
        flush_file(file)
    if not is_whole(folder):
        _discard(folder)
        with suppress(OSError):  # without a lock another process may have been faster
            part.rename(folder)


def _discard(folder: Path) -> None:
    """Remove a folder and its content, and ignore errors."""
    shutil.rmtree(folder, ignore_errors=True)


#: Largest number of files in a user's cache folder, two for each measurement of a structure.
MOST_KEPT = 100


def user_cache_folder() -> Path | None:
    """Return the folder in which computed results are cached for a user; None if it can't be created.

    The folder is ``$PMR_CACHE``, else ``pmr`` in ``$XDG_CACHE_HOME``, else ``~/.cache/pmr``.  The folder is created if
    it does not exist.  If it has more than `MOST_KEPT` files, the oldest ones are removed.
    """
    try:
        caches = os.environ.get("XDG_CACHE_HOME")
        folder = Path(os.environ.get("PMR_CACHE") or Path(caches or Path.home() / ".cache", "pmr"))
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # RuntimeError: the user has no home folder
        return None
    with contextlib.suppress(OSError):  # files that can't be listed or removed remain
        files = sorted(folder.glob("*.npz"), key=lambda file: file.stat().st_mtime)
        for file in files[:-MOST_KEPT]:
            file.unlink()
    return folder
