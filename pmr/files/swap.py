"""Several files of one folder that belong together: all of them are the old ones or all are the new ones.

The new ones are written into a folder inside the target.  When they are complete it gets another name, in one step:
from then on they count.  Then they move to where the old ones stand, one after the other, which takes less than a
millisecond; who is killed meanwhile leaves the rest to who opens the folder next (`finish_swap`).  So the target may
be the current directory, a symbolic link or the root of a disk, and what else lies in it is not touched.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from fnmatch import fnmatch
from pathlib import Path

from pmr.errors import InputError
from pmr.files.whole import ensure_ordinary, flush_file, hold_lock, report_full_disk

_NEW, _COMPLETE, _LIST = ".pmr-new-", ".pmr-complete", ".moves.json"


@contextmanager
def fresh(folder: Path, ours: Sequence[str]) -> Iterator[Path]:
    """An empty folder to write to; when the block ends without an error its files take the place of `ours`.

    These are names, or patterns of names, of all that may ever be written, relative to `folder`, which is made if need
    be: old files among them that are not written again go.

    Raises NotWrittenError if there is no room: the old files are still there, of the new ones nothing is; ValueError if
    a file was written whose name is not among `ours`.
    """
    with report_full_disk(folder):
        folder.mkdir(parents=True, exist_ok=True)
        finish_swap(folder)
        new = Path(tempfile.mkdtemp(prefix=_NEW, dir=folder))
    try:
        with hold_lock(new), report_full_disk(folder):
            yield new
            names = _names(new, folder, ours)
            gone = [name for name in _matching_names(folder, ours) if name not in names]
            (new / _LIST).write_text(json.dumps({"names": names, "gone": gone}))
            for name in (*names, _LIST):
                flush_file(new / name)
            with hold_lock(folder):
                _finish(folder)
                new.rename(folder / _COMPLETE)
                _finish(folder)
    finally:
        shutil.rmtree(new, ignore_errors=True)


def finish_swap(folder: Path) -> None:
    """Finish what a process that was killed had begun in a folder, and remove what it had not completed."""
    new_folders = [path for path in folder.glob(f"{_NEW}*") if path.is_dir()]
    if new_folders or (folder / _COMPLETE).exists():
        with report_full_disk(folder), hold_lock(folder):
            _finish(folder)
            for new in new_folders:
                with suppress(FileNotFoundError), hold_lock(new, wait=False) as free:
                    if free:
                        shutil.rmtree(new, ignore_errors=True)


def remove_files(folder: Path, ours: Sequence[str]) -> None:
    """Remove files by their names or patterns."""
    for name in _matching_names(folder, ours):
        (folder / name).unlink(missing_ok=True)


def _finish(folder: Path) -> None:
    complete = folder / _COMPLETE
    if not complete.is_dir():
        return
    if (complete / _LIST).is_file():
        names, gone = _moves(complete / _LIST, folder)
        for name in gone:
            (folder / name).unlink(missing_ok=True)
        for name in names:
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            with suppress(FileNotFoundError):  # moved before
                os.replace(complete / name, folder / name)
    shutil.rmtree(complete)


def _moves(file: Path, folder: Path) -> tuple[list[str], list[str]]:
    """Files of the folder that are to be moved, and to be removed, whoever wrote the list.

    Raises InputError if it names anything outside of the folder: then no file is touched.
    """
    try:
        moves = json.loads(file.read_text())
        names, gone = (list(map(str, moves[key])) for key in ("names", "gone"))
        inside, listed = folder.resolve(), (*names, *gone)
        foreign = [n for n in listed if "\0" in n or not (folder / n).parent.resolve().is_relative_to(inside)]
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise InputError(str(file), "", None, f"not written by pmr ({error}); delete its folder") from None
    if foreign:
        raise InputError(str(file), "", foreign[0], "files of this folder are allowed; delete the list's folder")
    return names, gone


def _names(new: Path, folder: Path, ours: Sequence[str]) -> list[str]:
    names = sorted(path.relative_to(new).as_posix() for path in new.rglob("*") if path.is_file())
    unknown = [name for name in names if not any(fnmatch(name, pattern) for pattern in ours)]
    if unknown:
        raise ValueError(f"{', '.join(unknown)}: not among {', '.join(ours)}")
    for name in names:
        ensure_ordinary(folder / name)
    return names


def _matching_names(folder: Path, ours: Sequence[str]) -> list[str]:
    paths = [path.relative_to(folder).as_posix() for pattern in ours for path in folder.glob(pattern)]
    return [name for name in paths if not (folder / name).is_dir()]
