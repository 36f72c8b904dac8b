"""npz files of unknown origin: what they claim is compared with what they hold before anything is allocated.

A zip's directory says how large each member is, and each member's header which shape its array has.  Either may lie: a
file of two megabytes may claim two gigabytes.  Here all of them have to agree with the size of the file.
"""

from __future__ import annotations

import json
import math
import os
import zipfile
import zlib
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmr.files import jsonfile
from pmr.files.whole import replaced

HEADER = "header"
OLD_HEADER = "header.json"  # text instead of an array, in results of tasks of version 1
MOST_MEMBERS = 10_000
_KINDS = "biufU"  # numbers and text; neither objects (pickles) nor records
_DAMAGE = (
    *(OSError, EOFError, KeyError, TypeError, ValueError, OverflowError, RecursionError, MemoryError),
    *(NotImplementedError, RuntimeError, zipfile.BadZipFile, zlib.error),
)


class DamagedError(ValueError):
    """A file does not hold what it claims to hold."""


def read(
    file: Path, expansion: float = 1.0, room: int = 0, only: Collection[str] | None = None
) -> dict[str, NDArray[Any]]:
    """All arrays of an npz file by name, or those that `only` names.

    The content may take `expansion` times the size of the file, 1 for files that are not compressed, or `room` bytes
    however small the file is: what is all zeros is compressed to almost nothing.

    Raises DamagedError if a size, a shape or a type in it can't be true, a checksum is wrong, or it holds anything but
    numbers and text; nothing larger than this is ever allocated.
    """
    try:
        with file.open("rb") as stream, zipfile.ZipFile(stream) as archive:
            members = {
                _name(info): info for info in _checked(archive, os.fstat(stream.fileno()).st_size, expansion, room)
            }
            return {name: _array(archive, info) for name, info in members.items() if only is None or name in only}
    except DamagedError:
        raise
    except _DAMAGE as error:
        raise DamagedError(str(error) or type(error).__name__) from None


def write(
    file: Path, arrays: Mapping[str, ArrayLike], header: Mapping[str, Any] | None = None, compressed: bool = False
) -> None:
    """Write an npz file, all of it or nothing, with a header in JSON if there is one; equal arrays give equal bytes.

    Raises NotWrittenError if there is no room for it.
    """
    kind = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
    if header is not None:
        arrays = {HEADER: np.array(jsonfile.text(header)), **arrays}
    with replaced(file) as part, zipfile.ZipFile(part, "w") as archive:
        for name, values in arrays.items():
            info = zipfile.ZipInfo(f"{name}.npy")  # of a time that is always the same
            info.compress_type = kind
            with archive.open(info, "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(values), allow_pickle=False)


def without_header(arrays: dict[str, NDArray[Any]]) -> Any:
    """The header of a file, taken out of its arrays; raises DamagedError if there is none."""
    try:
        header = arrays.pop(HEADER)
        return json.loads(header.tobytes() if header.dtype == np.uint8 else str(header))
    except _DAMAGE as error:
        raise DamagedError(f"no header: {error}") from None


def _checked(archive: zipfile.ZipFile, size: int, expansion: float, room: int) -> Sequence[zipfile.ZipInfo]:
    """Members of an archive in a file of `size` bytes, whose sizes can be true."""
    members = archive.infolist()
    if len(members) > MOST_MEMBERS or len({info.filename for info in members}) < len(members):
        raise DamagedError(f"it has {len(members)} members, at most {MOST_MEMBERS} with different names are allowed")
    if sum(info.compress_size for info in members) > size or any(info.flag_bits & 1 for info in members):
        raise DamagedError("its directory does not fit the file")
    claimed = sum(info.file_size for info in members)
    if claimed > max(expansion * size, room):
        raise DamagedError(f"it claims to hold {claimed:,} bytes, at most {expansion:g} times its {size:,} are allowed")
    return members


def _name(info: zipfile.ZipInfo) -> str:
    return HEADER if info.filename == OLD_HEADER else info.filename.removesuffix(".npy")


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[Any]:
    """The array of a member, whose header has to agree with the member's size."""
    if info.filename == OLD_HEADER:
        return np.array(archive.read(info).decode())
    with archive.open(info) as stream:
        shape, fortran, dtype = _header(stream)
        count = math.prod(shape)
        if dtype.kind not in _KINDS or dtype.itemsize == 0:
            raise DamagedError(f"{info.filename} holds {dtype}, numbers and text are allowed")
        if count * dtype.itemsize != info.file_size - stream.tell():
            raise DamagedError(f"{info.filename} claims the shape {shape}, which is not what it holds")
        flat = np.empty(count, dtype)
        _fill(stream, memoryview(flat.view(np.uint8).data))
    return flat.reshape(shape, order="F" if fortran else "C")


def _header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    version = np.lib.format.read_magic(stream)
    readers = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
    if version not in readers:
        raise DamagedError(f"arrays of version {version} are not known")
    shape, fortran, dtype = readers[version](stream)
    if not all(isinstance(length, int) and length >= 0 for length in shape):
        raise DamagedError(f"{shape} is no shape")
    return shape, fortran, dtype


def _fill(stream: Any, room: memoryview) -> None:
    """Read until `room` is full; the end of the member, where its checksum is compared, has to be there."""
    filled = 0
    while filled < len(room):
        got = stream.readinto(room[filled:])
        if not got:
            raise DamagedError("it ends too early")
        filled += got
    if stream.read(1):
        raise DamagedError("it is longer than it claims to be")
