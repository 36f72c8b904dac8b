"""Results of tasks on disk, one npz file with a JSON header each, named by the digest of what decides the result.

A file appears under its name only when it is complete, and a damaged one counts as none; so a study that was cut off
goes on with what is there.  Equal tasks of several studies share a file.  Nothing in it is pickled.
"""

from __future__ import annotations

import json
import time
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from pmr.files import npz
from pmr.studies.engine.task import TaskResult

FORMAT = "pmr-task-result"
FORMAT_VERSION = 3  # warnings belong to the result
STALE_AFTER = 3600.0  # s, age at which a file under construction counts as abandoned


@dataclass(frozen=True)
class Stored:
    """A result as read back, with the key it was computed under."""

    key: str
    result: TaskResult


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
            if file.is_file() and time.time() - file.stat().st_mtime > STALE_AFTER:
                file.unlink(missing_ok=True)

    def sound(self, digest: str) -> bool:
        """Whether the result is there, and undamaged to the last byte."""
        try:
            self.read(digest)
        except npz.DamagedError:
            return False
        return True

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
            "warnings": list(result.warnings),
        }
        json.dumps(header, allow_nan=False)  # a record that is not finite is an error
        npz.write(self.path(digest), {f"array.{name}": array for name, array in result.arrays.items()}, header)

    def headline(self, digest: str) -> Stored:
        """Read a result without its arrays."""
        return self.read(digest, only=(npz.HEADER,))

    def read(self, digest: str, only: Collection[str] | None = None) -> Stored:
        """The result with this digest, with `only` some members of its file; arrays are read-only.

        Raises DamagedError if the file is missing or damaged.
        """
        file = self.path(digest)
        try:
            data = npz.read(file, only=only)
            header = npz.without_header(data)
            if (header["format"], header["digest"]) != (FORMAT, digest) or not 1 <= header["version"] <= FORMAT_VERSION:
                raise ValueError("another file's header")
            arrays = {name.removeprefix("array."): array for name, array in data.items()}
            for array in arrays.values():
                array.setflags(write=False)
            warnings = tuple(header["warnings"] if header["version"] > 2 else header["notes"])
            return Stored(header["key"], TaskResult(header["record"], arrays, header["seconds"], warnings))
        except (KeyError, TypeError, ValueError) as error:
            raise npz.DamagedError(f"{file.name} is missing or damaged ({error})") from None
