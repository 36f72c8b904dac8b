"""Arrays, tables and dataclasses in npz files and JSON, read safely from files of unknown origin.

The directory of a zip file states the size of each member, and the header of each member states the shape of its array.
Both may be wrong: a file of two megabytes may claim to contain two gigabytes.  `read` compares these claims with the
size of the file before it allocates memory.

JSON has no NaN and no infinity: `json_text` writes them as null, so that every reader of JSON can read it.

`record_arrays` and `record_from_arrays` convert frozen dataclasses to named arrays and back; the type of a field
decides how the field is stored:

======================================  ===============================================================
type of a field                         arrays
======================================  ===============================================================
``NDArray``                             ``name``
``PPoly``                               ``name.breaks`` and ``name.coefficients``
``float``, ``bool``, ``str``            ``name``, of no axes
``tuple[str, ...]``                     ``name``, text
``dict[str, Any]``                      ``name``, text in JSON
``Mapping[str, NDArray]``               ``name.key`` for each key
a dataclass                             ``name.field`` for each field
any of these or None                    no array if the value is None
======================================  ===============================================================

A field that is not in a file gets its default value, so files of earlier versions stay readable.
"""

from __future__ import annotations

import hashlib
import json
import logging
import math
import os
import struct
import zipfile
import zlib
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from pathlib import Path
from types import NoneType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PPoly

from pmr.files.whole import NotWrittenError, replacement_file, user_cache_folder

T = TypeVar("T")
_log = logging.getLogger(__name__)


def json_text(data: Any, indent: int | None = None) -> str:
    """Return `data` as JSON, with null in place of each number that is not finite; `indent` is that of `json.dumps`.

    Raises TypeError if `data` contains anything but numbers, text, truth values, None, lists, tuples and mappings.
    """
    return json.dumps(_replace_non_finite(data), indent=indent, allow_nan=False)


def _replace_non_finite(data: Any) -> Any:
    """Return `data` with None in place of each number that is not finite, in nested mappings and lists too."""
    if isinstance(data, float):
        return data if math.isfinite(data) else None
    if isinstance(data, Mapping):
        return {key: _replace_non_finite(value) for key, value in data.items()}
    return [_replace_non_finite(value) for value in data] if isinstance(data, list | tuple) else data


HEADER = "header"
MOST_MEMBERS = 10_000
LONGEST_HEADER = 10_000  # largest size of the header of one array in bytes
#: Least share of an array's bytes that compression has to save, and number of entries by which the share is estimated.
WORTH, SAMPLE = 0.2, 8192
#: Largest size of a model's arrays as a multiple of the size of its file, and size in bytes that is always allowed.
MOST_EXPANSION, ROOM = 100.0, 2**24
_KINDS = "biufU"  # kinds of arrays that are read: numbers and text, neither objects (pickles) nor records
_DAMAGE = (
    *(OSError, EOFError, KeyError, TypeError, ValueError, OverflowError, RecursionError, MemoryError),
    *(NotImplementedError, RuntimeError, SyntaxError, struct.error, zipfile.BadZipFile, zlib.error),
)


class DamagedError(ValueError):
    """The content of a file differs from what the file's directory or its headers state."""


def read(
    file: Path, expansion: float = 1.0, room: int = 0, only: Collection[str] | None = None
) -> dict[str, NDArray[Any]]:
    """Read the arrays (any shape) of an npz file by name: those that `only` names, or all if that is None.

    All arrays together may take `expansion` times the size of the file, which is 1 for arrays that are not compressed.
    They may take `room` bytes in any case, as zeros are compressed to almost nothing.  Nothing larger is ever
    allocated.

    Raises DamagedError if a size, a shape or a type that the file states can't be true, or if a checksum is wrong.  It
    is also raised if an array contains anything but numbers and text.
    """
    try:
        with file.open("rb") as stream, zipfile.ZipFile(stream) as archive:
            members = _checked_members(archive, os.fstat(stream.fileno()).st_size, expansion, room)
            named = {info.filename.removesuffix(".npy"): info for info in members}
            return {name: _read_array(archive, info) for name, info in named.items() if only is None or name in only}
    except DamagedError:
        raise
    except _DAMAGE as error:
        raise DamagedError(str(error) or type(error).__name__) from None


def write(
    file: Path, arrays: Mapping[str, ArrayLike], header: Mapping[str, Any] | None = None, compressed: bool = False
) -> None:
    """Write arrays by name to an npz file, completely or not at all; equal arrays give files with equal bytes.

    The arrays may have any shape.  If a `header` is given, it is stored as JSON with the arrays.  If `compressed`, an
    array is compressed if this saves at least the share `WORTH` of it; compression would only make other arrays slower
    to read.  Raises NotWrittenError if there is no room for the file.
    """
    if header is not None:
        arrays = {HEADER: np.array(json_text(header)), **arrays}
    with replacement_file(file) as part, zipfile.ZipFile(part, "w") as archive:
        for name, values in arrays.items():
            info = zipfile.ZipInfo(f"{name}.npy")  # its time is always the same
            if compressed and _is_worth_compressing(np.asanyarray(values)):
                info.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(info, "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(values), allow_pickle=False)


#: Header of a file that stores computed arrays for later runs.
STORED = {"format": "pmr-cache"}


def read_stored(file: Path) -> dict[str, NDArray[Any]] | None:
    """Read the arrays (any shape) that `store` wrote, by name.

    None is returned without such a file; None is also returned, after a logged warning, if the file is damaged or of
    another format.  No error is raised.
    """
    if not file.is_file():
        return None
    try:
        arrays = read(file)
        if pop_header(arrays) != STORED:
            raise DamagedError("another format")
    except DamagedError as error:
        _log.warning("%s is made again: %s", file, error)
        return None
    return arrays


def store(file: Path, arrays: Mapping[str, ArrayLike]) -> None:
    """Write computed arrays (any shape) by name to an npz file, from which `read_stored` reads them in later runs.

    Raises NotWrittenError if there is no room for the file.
    """
    write(file, arrays, STORED)


def stored_or_computed(
    kind: str, request: str, compute: Callable[[], Mapping[str, NDArray[Any]]]
) -> Mapping[str, NDArray[Any]]:
    """Return the arrays (any shape) of `compute`, by name; later runs read them from the user's cache folder.

    The file's name begins with `kind`.  The text `request` decides what is computed: all inputs and the code.
    """
    folder = user_cache_folder()
    if folder is None:
        return compute()
    file = folder / f"{kind}-{hashlib.blake2b(request.encode(), digest_size=12).hexdigest()}.npz"
    arrays: Mapping[str, NDArray[Any]] | None = read_stored(file)
    if arrays is None:
        arrays = compute()
        with suppress(NotWrittenError):  # a disk without room stores nothing
            store(file, arrays)
    return arrays


def _is_worth_compressing(array: NDArray[Any]) -> bool:
    """Whether compression saves at least the share `WORTH` of an array's (any shape) first `SAMPLE` entries."""
    sample = array.ravel()[:SAMPLE].tobytes()
    return len(zlib.compress(sample, 1)) < (1.0 - WORTH) * len(sample)


def pop_header(arrays: dict[str, NDArray[Any]]) -> Any:
    """Remove the header from `arrays`, those of an npz file by name, and return its content as read from JSON.

    Raises DamagedError if there is no header.
    """
    try:
        header = arrays.pop(HEADER)
        return json.loads(header.tobytes() if header.dtype == np.uint8 else str(header))
    except _DAMAGE as error:
        raise DamagedError(f"no header: {error}") from None


def _checked_members(archive: zipfile.ZipFile, size: int, expansion: float, room: int) -> Sequence[zipfile.ZipInfo]:
    """Return the members of an archive in a file of `size` bytes; raises DamagedError if their sizes can't be true.

    Together the members may claim `expansion` times `size` bytes, or `room` bytes if this is more.
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


def _read_array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> NDArray[Any]:
    """Read the array in a member of the archive, of the shape and type in the array's header.

    Raises DamagedError if the array's header does not agree with the member's size.
    """
    with archive.open(info) as stream:
        read_array: Any = np.lib.format.read_array  # NumPy 1.24 does not declare the size that it takes
        array: NDArray[Any] = read_array(stream, allow_pickle=False, max_header_size=LONGEST_HEADER)
        if array.dtype.kind not in _KINDS or array.dtype.itemsize == 0:
            raise DamagedError(f"{info.filename} holds {array.dtype}, numbers and text are allowed")
        if stream.read(1):  # at its end the checksum is compared
            raise DamagedError(f"{info.filename} is longer than it claims to be")
    return array


def record_arrays(record: Any, prefix: str = "") -> dict[str, NDArray[Any]]:
    """Return all fields of the dataclass `record` as arrays, by `prefix` and the field's name.

    Fields that are None are left out.  A field that is a dict becomes a JSON text.  The parts of a field that is a
    dataclass, a piecewise polynomial or a mapping have keys of their own: the field's name, a dot and the part's name.
    Raises TypeError if a mapping contains values that JSON does not know.
    """
    by_name: dict[str, NDArray[Any]] = {}
    cls: Any = type(record)
    for name, hint in _field_types(cls).items():
        value, key = getattr(record, name), prefix + name
        if value is None:
            continue
        if is_dataclass(hint):
            by_name |= record_arrays(value, f"{key}.")
        elif hint is PPoly:
            by_name |= {f"{key}.breaks": value.x, f"{key}.coefficients": value.c}
        elif get_origin(hint) is dict:
            by_name[key] = np.array(json_text(value))
        elif get_origin(hint) is Mapping:
            by_name |= {f"{key}.{part}": np.asarray(array) for part, array in value.items()}
        else:
            by_name[key] = np.array(value, dtype=np.str_) if get_origin(hint) is tuple else np.asarray(value)
    return by_name


def record_from_arrays(cls: Callable[..., T], data: Mapping[str, NDArray[Any]], prefix: str = "") -> T:
    """Return the dataclass `cls` from `data`, the arrays that `record_arrays` returned.

    The names of the arrays begin with `prefix`, and their shapes are those of the fields.  Numbers get the types of the
    fields.  Raises KeyError if a field without a default is missing, and TypeError or ValueError if an array is of
    another type.
    """
    values: dict[str, Any] = {}
    for field in fields(cls):  # type: ignore[arg-type]
        key, hint = prefix + field.name, _field_types(cls)[field.name]
        of_field = {name: array for name, array in data.items() if name == key or name.startswith(f"{key}.")}
        if of_field or get_origin(hint) is Mapping:
            values[field.name] = _field_value(
                hint, {name[len(key) :].lstrip("."): array for name, array in of_field.items()}
            )
        elif field.default is MISSING and field.default_factory is MISSING:
            raise KeyError(key)
    return cls(**values)


def rename_keys(data: Mapping[str, NDArray[Any]], names: Mapping[str, str]) -> dict[str, NDArray[Any]]:
    """Return the arrays of `data` under the names of this version, in place of those that earlier versions wrote.

    `names` maps beginnings of earlier names to their replacements.  If several beginnings fit a name, the first is
    replaced.  The arrays themselves are not changed.
    """
    arrays_by_name = {}
    for name, array in data.items():
        old = next((old for old in names if name.startswith(old)), "")
        arrays_by_name[names.get(old, "") + name.removeprefix(old)] = array
    return arrays_by_name


def _field_value(hint: Any, parts: Mapping[str, NDArray[Any]]) -> Any:
    """Return the value of a dataclass's field from the field's arrays.

    Parameters
    ----------
    hint : type of the field, without None
    parts : mapping
        Arrays of the field, by the part of their key that follows the field's name; this part is ``""`` for an array
        with the field's name as its key.
    """
    # NumPy's `NDArray` is an alias from NumPy 2.5 on
    alias = getattr(get_origin(hint), "__value__", None)
    hint = hint if alias is None else alias[get_args(hint)]
    origin, arguments = get_origin(hint), get_args(hint)
    nested: bool = is_dataclass(hint)
    if nested:
        return record_from_arrays(hint, parts)
    if hint is PPoly:
        return PPoly(np.asarray(parts["coefficients"], dtype=float), np.asarray(parts["breaks"], dtype=float))
    if origin is Mapping:
        return {name: _field_value(arguments[1], {"": array}) for name, array in parts.items()}
    array = parts[""]
    if origin is np.ndarray:
        return np.asarray(array, dtype=get_args(arguments[1])[0])
    if origin is None:
        return hint(array.item())
    if array.dtype.kind != "U" or array.ndim != (origin is tuple):
        raise TypeError(f"text is allowed, not {array!r:.60}")
    if origin is tuple:
        return tuple(map(str, array))
    if not isinstance(table := json.loads(str(array)), dict):
        raise TypeError(f"a table is allowed, not {table!r:.60}")
    return table


@cache
def _field_types(cls: Any) -> dict[str, Any]:
    """Return the types of a dataclass's fields, by the fields' names; an optional type is returned without its None.

    The result is cached and shared.
    """
    hints = get_type_hints(cls)
    return {field.name: _without_none(hints[field.name]) for field in fields(cls)}


def _without_none(hint: Any) -> Any:
    """Return the first type of an optional type that is not None; other types are returned unchanged."""
    types = [part for part in get_args(hint) if part is not NoneType]
    return types[0] if NoneType in get_args(hint) else hint
