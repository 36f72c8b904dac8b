"""Frozen dataclasses as named arrays and back: what a file holds of them follows from the types of their fields.

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
any of these or None                    nothing where it is None
======================================  ===============================================================

A field that a file lacks takes its default, so files of earlier versions stay readable.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from functools import cache
from types import NoneType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.files import jsonfile

T = TypeVar("T")


def arrays(record: Any, prefix: str = "") -> dict[str, NDArray[Any]]:
    """All that a dataclass holds, by name behind `prefix`; raises TypeError if a table holds what JSON doesn't know."""
    by_name: dict[str, NDArray[Any]] = {}
    cls: Any = type(record)
    for name, hint in _types(cls).items():
        value, key = getattr(record, name), prefix + name
        if value is None:
            continue
        if is_dataclass(hint):
            by_name |= arrays(value, f"{key}.")
        elif hint is PPoly:
            by_name |= {f"{key}.breaks": value.x, f"{key}.coefficients": value.c}
        elif get_origin(hint) is dict:
            by_name[key] = np.array(jsonfile.text(value))
        elif get_origin(hint) is Mapping:
            by_name |= {f"{key}.{part}": np.asarray(array) for part, array in value.items()}
        else:
            by_name[key] = np.array(value, dtype=np.str_) if get_origin(hint) is tuple else np.asarray(value)
    return by_name


def record(cls: Callable[..., T], data: Mapping[str, NDArray[Any]], prefix: str = "") -> T:
    """The dataclass that `arrays` gave, its numbers in the types that the fields name.

    Raises KeyError if something is missing that has no default; TypeError, ValueError if something is of another type.
    """
    values: dict[str, Any] = {}
    for field in fields(cls):  # type: ignore[arg-type]
        key, hint = prefix + field.name, _types(cls)[field.name]
        of_field = {name: array for name, array in data.items() if name == key or name.startswith(f"{key}.")}
        if of_field or get_origin(hint) is Mapping:
            values[field.name] = _value(hint, {name[len(key) :].lstrip("."): array for name, array in of_field.items()})
        elif field.default is MISSING and field.default_factory is MISSING:
            raise KeyError(key)
    return cls(**values)


def rename_keys(data: Mapping[str, NDArray[Any]], names: Mapping[str, str]) -> dict[str, NDArray[Any]]:
    """`data` with other beginnings of names, as an earlier version of a file wrote them: the first that fits."""
    arrays_by_name = {}
    for name, array in data.items():
        old = next((old for old in names if name.startswith(old)), "")
        arrays_by_name[names.get(old, "") + name.removeprefix(old)] = array
    return arrays_by_name


def _value(hint: Any, parts: Mapping[str, NDArray[Any]]) -> Any:
    """A field's value from its arrays, named by what follows the field's own name."""
    hint = _spelled_out(hint)
    origin, arguments = get_origin(hint), get_args(hint)
    nested: bool = is_dataclass(hint)
    if nested:
        return record(hint, parts)
    if hint is PPoly:
        return PPoly(np.asarray(parts["coefficients"], dtype=float), np.asarray(parts["breaks"], dtype=float))
    if origin is Mapping:
        return {name: _value(arguments[1], {"": array}) for name, array in parts.items()}
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


def _spelled_out(hint: Any) -> Any:
    """`NDArray` as the array that it stands for: from NumPy 2.5 on it is an alias with a type of its own."""
    alias = getattr(get_origin(hint), "__value__", None)
    return hint if alias is None else alias[get_args(hint)]


@cache
def _types(cls: Any) -> dict[str, Any]:
    """Types of a dataclass's fields, without None."""
    hints = get_type_hints(cls)
    return {field.name: _without_none(hints[field.name]) for field in fields(cls)}


def _without_none(hint: Any) -> Any:
    types = [part for part in get_args(hint) if part is not NoneType]
    return types[0] if NoneType in get_args(hint) else hint
