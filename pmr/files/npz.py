"""npz files of unknown origin: what they claim is compared with what they hold before anything is allocated.

A zip's directory says how large each member is, and each member's header which shape its array has.  Either may lie: a
file of two megabytes may claim two gigabytes.  Here all of them have to agree with the size of the file.
"""

from __future__ import annotations

import math
import os
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

MOST_MEMBERS = 10_000
_KINDS = "biufU"  # numbers and text; neither objects (pickles) nor records
_DAMAGE = (
    *(OSError, EOFError, KeyError, TypeError, ValueError, OverflowError, RecursionError, MemoryError),
    *(NotImplementedError, RuntimeError, zipfile.BadZipFile, zlib.error),
)


class DamagedError(ValueError):
    """A file does not hold what it claims to hold."""


def read(file: Path, expansion: float = 1.0, room: int = 0) -> dict[str, NDArray[Any]]:
    """All arrays of an npz file by name.

    Parameters
    ----------
    file : Path
    expansion : float
        How many times the size of the file its content may take: 1 for files that are not compressed.
    room : int
        Bytes that it may take however small the file is: what is all zeros is compressed to almost nothing.

    Raises
    ------
    DamagedError
        If a size, a shape or a type in it can't be true, a checksum is wrong, or it holds anything but numbers and
        text; nothing larger than this is ever allocated.
    """
    try:
        with file.open("rb") as stream, zipfile.ZipFile(stream) as archive:
            members = checked(archive, os.fstat(stream.fileno()).st_size, expansion, room)
            return {info.filename.removesuffix(".npy"): array(archive, info) for info in members}
    except DamagedError:
        raise
    except _DAMAGE as error:
        raise DamagedError(str(error) or type(error).__name__) from None


def write(file: Path, arrays: Mapping[str, ArrayLike], compressed: bool = False) -> None:
    """Write an npz file as `numpy.savez` does; where it finds no room, the error is the only thing that is said."""
    kind = zipfile.ZIP_DEFLATED if compressed else zipfile.ZIP_STORED
    with zipfile.ZipFile(file, "w", kind) as archive:
        for name, values in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(values), allow_pickle=False)


def checked(archive: zipfile.ZipFile, size: int, expansion: float = 1.0, room: int = 0) -> Sequence[zipfile.ZipInfo]:
    """Members of an archive in a file of `size` bytes, if their sizes can be true.

    Raises
    ------
    DamagedError
        If they can't.
    """
    members = archive.infolist()
    if len(members) > MOST_MEMBERS or len({info.filename for info in members}) < len(members):
        raise DamagedError(f"it has {len(members)} members, at most {MOST_MEMBERS} with different names are allowed")
    if sum(info.compress_size for info in members) > size or any(info.flag_bits & 1 for info in members):
        raise DamagedError("its directory does not fit the file")
    claimed = sum(info.file_size for info in members)
    if claimed > max(expansion * size, room):
        raise DamagedError(f"it claims to hold {claimed:,} bytes, at most {expansion:g} times its {size:,} are allowed")
    return members


def array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[Any]:
    """The array of a member, whose header has to agree with the member's size.

    Raises
    ------
    DamagedError
        If it doesn't.
    """
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
