"""Results of tasks on disk, one npz file with a JSON header each, named by the digest of what decides the result.

A file appears under its name only when it is complete, and a damaged one counts as none; so a study that was cut off
goes on with what is there.  Equal tasks of several studies share a file.  Nothing in it is pickled.
"""

from __future__ import annotations

import json
import time
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.files import npz
from pmr.files.whole import replaced
from pmr.studies.engine.task import TaskResult

FORMAT = "pmr-task-result"
FORMAT_VERSION = 1
HEADER = "header.json"
STALE_AFTER = 3600.0  # s, age at which a file under construction counts as abandoned
_DAMAGE = (OSError, KeyError, TypeError, ValueError, RecursionError, zipfile.BadZipFile, zlib.error, EOFError)


class DamagedError(ValueError):
    """A stored result can't be read."""


@dataclass(frozen=True)
class Stored:
    """A result as read back, with the key it was computed under and the warnings that came up."""

    key: str
    result: TaskResult
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Store:
    """The folder of results."""

    folder: Path

    def path(self, digest: str) -> Path:
        """File of the result with this digest."""
        return self.folder / f"{digest}.npz"

    def prepare(self) -> None:
        """Make the folder, and clear away what interrupted processes left half-written."""
        self.folder.mkdir(parents=True, exist_ok=True)
        for file in self.folder.glob("*.part"):
            if time.time() - file.stat().st_mtime > STALE_AFTER:
                file.unlink(missing_ok=True)

    def sound(self, digest: str) -> bool:
        """Whether the result is there, and undamaged to the last byte."""
        try:
            with _opened(self.path(digest)) as file:
                return file.testzip() is None and _header(file, digest) is not None
        except _DAMAGE:
            return False

    def write(self, digest: str, stored: Stored) -> None:
        """Put a result in its place, all of it or nothing."""
        result = stored.result
        header = {
            "format": FORMAT,
            "version": FORMAT_VERSION,
            "digest": digest,
            "key": stored.key,
            "record": dict(result.record),
            "seconds": dict(result.seconds),
            "notes": list(stored.notes),
        }
        text = json.dumps(header, allow_nan=False)
        write_arrays(self.path(digest), {f"array.{name}": array for name, array in result.arrays.items()}, text)

    def read(self, digest: str) -> Stored:
        """The result with this digest; its arrays are read-only.

        Raises
        ------
        DamagedError
            If the file is missing or damaged.
        """
        path = self.path(digest)
        try:
            with _opened(path) as file:
                header = _header(file, digest)
                members = [info for info in file.infolist() if info.filename.startswith("array.")]
                arrays = {_name(info): _array(file, info) for info in members}
            result = TaskResult(header["record"], arrays, header["seconds"])
            return Stored(header["key"], result, tuple(header["notes"]))
        except _DAMAGE as error:
            raise DamagedError(f"{path.name} is missing or damaged ({error})") from None

    def headline(self, digest: str) -> Stored:
        """As `read`, without the arrays."""
        try:
            with _opened(self.path(digest)) as file:
                header = _header(file, digest)
            return Stored(header["key"], TaskResult(header["record"], {}, header["seconds"]), tuple(header["notes"]))
        except _DAMAGE as error:
            raise DamagedError(f"{self.path(digest).name} is missing or damaged ({error})") from None


def write_arrays(path: Path, arrays: Mapping[str, NDArray[Any]], header: str = "") -> None:
    """Write an npz file, with a header if there is one, in one step; equal arrays give equal bytes."""
    with replaced(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_STORED) as file:
        if header:
            file.writestr(zipfile.ZipInfo(HEADER), header)
        for name, array in arrays.items():
            content = BytesIO()
            np.lib.format.write_array(content, np.asanyarray(array), allow_pickle=False)
            file.writestr(zipfile.ZipInfo(f"{name}.npy"), content.getvalue())


def _header(file: zipfile.ZipFile, digest: str) -> dict[str, Any]:
    header = json.loads(file.read(HEADER))
    if (header["format"], header["version"], header["digest"]) != (FORMAT, FORMAT_VERSION, digest):
        raise ValueError("another file's header")
    return dict(header)


@contextmanager
def _opened(path: Path) -> Iterator[zipfile.ZipFile]:
    """A file whose sizes are what its directory claims."""
    with zipfile.ZipFile(path) as file:
        npz.checked(file, path.stat().st_size)
        yield file


def _name(info: zipfile.ZipInfo) -> str:
    return info.filename.removeprefix("array.").removesuffix(".npy")


def _array(file: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[Any]:
    array = npz.array(file, info)
    array.setflags(write=False)
    return array
