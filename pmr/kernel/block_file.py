"""Blocks of named arrays, as the kernel reads a system from (src/system.c has the layout of their bytes)."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAGIC = b"PMRSYS2\n"
#: Bytes that an array begins on a multiple of, and that the heads of a block and of each array take.
LINE = 64
_INTEGERS, _NUMBERS, _BYTES = range(3)
_HEAD, _ARRAY = struct.Struct("=8siiqQ32x"), struct.Struct("=40siiqq")


def pack(arrays: Mapping[str, NDArray[Any] | str]) -> bytearray:
    """Pack arrays of integers, of real numbers, and texts; without its checksum, for which eight bytes are left."""
    at, heads, parts = LINE * (1 + len(arrays)), bytearray(), list[tuple[int, bytes]]()
    for name, array in arrays.items():
        kind, content, count = _encode(array)
        at += -at % LINE
        heads += _ARRAY.pack(name.encode(), kind, 0, count, at)
        parts.append((at, content))
        at += len(content)
    block = bytearray(at)
    block[:LINE] = _HEAD.pack(MAGIC, 1, len(arrays), at, 0)
    block[LINE : LINE + len(heads)] = heads
    for first, content in parts:
        block[first : first + len(content)] = content
    return block


def lines(names: Iterable[str]) -> str:
    """Names as a text of plain letters, one a line; what else they have is escaped as in Python."""
    return "\n".join(name.encode("unicode_escape").decode("ascii") for name in names)


def seal(block: bytearray, checksum: int) -> None:
    """Write the checksum of the bytes behind the head into a block."""
    block[24:32] = struct.pack("=Q", checksum)


def _encode(array: NDArray[Any] | str) -> tuple[int, bytes, int]:
    """Kind, bytes and number of entries."""
    if isinstance(array, str):
        text = array.encode()
        return _BYTES, text, len(text)
    if array.dtype.kind in "iub":
        return _INTEGERS, np.ascontiguousarray(array, np.int32).tobytes(), array.size
    return _NUMBERS, np.ascontiguousarray(array, np.float64).tobytes(), array.size


def unpack(block: bytes) -> dict[str, NDArray[Any] | str]:
    """Read the arrays of a block back; nothing is checked, which the kernel does."""
    _, _, count, _, _ = _HEAD.unpack_from(block)
    arrays = dict[str, NDArray[Any] | str]()
    for k in range(count):
        name, kind, _, size, at = _ARRAY.unpack_from(block, LINE * (1 + k))
        key = name.rstrip(b"\0").decode()
        if kind == _BYTES:
            arrays[key] = bytes(block[at : at + size]).decode()
        else:
            arrays[key] = np.frombuffer(block, (np.int32, np.float64)[kind], size, at)
    return arrays
