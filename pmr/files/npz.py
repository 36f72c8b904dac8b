"""npz files of unknown origin: what they claim is compared with what they hold before anything is allocated.

A zip's directory says how large each member is, and each member's header which shape its array has.  Either may lie: a
file of two megabytes may claim two gigabytes.  Here all of them have to agree with the size of the file.
"""

from __future__ import annotations

import ast
import json
import math
import os
import struct
import zipfile
import zlib
from collections.abc import Collection, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmr.files import jsonfile
from pmr.files.whole import replacement

HEADER = "header"
OLD_HEADER = "header.json"  # text instead of an array, in results of tasks of version 1
MOST_MEMBERS = 10_000
LONGEST_HEADER = 10_000  # bytes of that of one array
#: Share of its bytes that compressing an array has to save, and entries by which this is decided.
WORTH, SAMPLE = 0.2, 8192
#: Bytes of a model over those of its file, and bytes that a small one may claim.
MOST_EXPANSION, ROOM = 100.0, 2**24
_KINDS = "biufU"  # numbers and text; neither objects (pickles) nor records
_DAMAGE = (
    *(OSError, EOFError, KeyError, TypeError, ValueError, OverflowError, RecursionError, MemoryError),
    *(NotImplementedError, RuntimeError, SyntaxError, struct.error, zipfile.BadZipFile, zlib.error),
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
                _name(info): info for info in _members(archive, os.fstat(stream.fileno()).st_size, expansion, room)
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

    Where it is `compressed`, this goes for arrays that take less by `WORTH` at least: others would only be slower to
    read.  Raises NotWrittenError if there is no room for it.
    """
    if header is not None:
        arrays = {HEADER: np.array(jsonfile.text(header)), **arrays}
    with replacement(file) as part, zipfile.ZipFile(part, "w") as archive:
        for name, values in arrays.items():
            info = zipfile.ZipInfo(f"{name}.npy")  # of a time that is always the same
            if compressed and _shrinks(np.asanyarray(values)):
                info.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(info, "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(values), allow_pickle=False)


def _shrinks(array: NDArray[Any]) -> bool:
    """Whether the first `SAMPLE` entries of an array are worth to be compressed."""
    sample = array.ravel()[:SAMPLE].tobytes()
    return len(zlib.compress(sample, 1)) < (1.0 - WORTH) * len(sample)


def without_header(arrays: dict[str, NDArray[Any]]) -> Any:
    """The header of a file, taken out of its arrays; raises DamagedError if there is none."""
    try:
        header = arrays.pop(HEADER)
        return json.loads(header.tobytes() if header.dtype == np.uint8 else str(header))
    except _DAMAGE as error:
        raise DamagedError(f"no header: {error}") from None


def _members(archive: zipfile.ZipFile, size: int, expansion: float, room: int) -> Sequence[zipfile.ZipInfo]:
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
    """Shape, whether columns stand together, and type: as `numpy.lib.format` reads them, in a tenth of its time."""
    version = np.lib.format.read_magic(stream)
    if version not in (lengths := {(1, 0): "<H", (2, 0): "<I"}):
        raise DamagedError(f"arrays of version {version} are not known")
    size = struct.calcsize(lengths[version])
    (length,) = struct.unpack(lengths[version], stream.read(size))
    if length > LONGEST_HEADER:
        raise DamagedError(f"a header of {length:,} bytes")
    return _parse_header(stream.read(length))


@lru_cache(maxsize=1024)  # many arrays are alike
def _parse_header(header: bytes) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    values = ast.literal_eval(header.decode("latin1").strip())
    if not isinstance(values, dict) or set(values) != {"descr", "fortran_order", "shape"}:
        raise DamagedError(f"{values!r:.60} is no header of an array")
    shape, fortran, kind = values["shape"], values["fortran_order"], values["descr"]
    if not isinstance(shape, tuple) or not all(type(length) is int and length >= 0 for length in shape):
        raise DamagedError(f"{shape!r:.60} is no shape")
    if not isinstance(kind, str) or not isinstance(fortran, bool):
        raise DamagedError(f"arrays of {kind!r:.60} are not known")
    return shape, fortran, np.dtype(kind)


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
