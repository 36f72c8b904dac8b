"""Blocks of named arrays from which the kernel reads a system (src/system.c describes the layout of the bytes)."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAGIC = b"PMRSYS2\n"
#: Alignment of arrays in bytes, and size of the block's header and of each array's header.
LINE = 64
_INTEGERS, _NUMBERS, _BYTES = range(3)
_HEAD, _ARRAY = struct.Struct("=8siiqQ32x"), struct.Struct("=40siiqq")


def pack(arrays: Mapping[str, NDArray[Any] | str]) -> bytearray:
    """Pack arrays of integers or real numbers, and texts, into a block whose checksum is zero until `seal` sets it."""
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
    """Text of ASCII letters with one name per line; other letters are escaped as in Python."""
    return "\n".join(name.encode("unicode_escape").decode("ascii") for name in names)


def seal(block: bytearray, checksum: int) -> None:
    """Write `checksum` into a block, in place; it has to be the checksum of the bytes after the first `LINE` bytes."""
    block[24:32] = struct.pack("=Q", checksum)


def _encode(array: NDArray[Any] | str) -> tuple[int, bytes, int]:
    """Kind (`_INTEGERS`, `_NUMBERS` or `_BYTES`), bytes, and number of entries of an array or text."""
    if isinstance(array, str):
        text = array.encode()
        return _BYTES, text, len(text)
    if array.dtype.kind in "iub":
        return _INTEGERS, np.ascontiguousarray(array, np.int32).tobytes(), array.size
    return _NUMBERS, np.ascontiguousarray(array, np.float64).tobytes(), array.size


def unpack(block: bytes) -> dict[str, NDArray[Any] | str]:
    """Arrays and texts of a block by name, as `pack` took them, but without shapes; the block is not checked.

    Integers are int32, real numbers float64.
    """
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
