"""Grids in study files: lists under the keys they vary, and their cartesian product."""

from __future__ import annotations

import itertools
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from pmr.errors import InputError
from pmr.scene.tomlfiles import Change
from pmr.studies.engine.task import KEY, Scalar


@dataclass(frozen=True)
class Point:
    """One combination: the changes it asks for, and what they are called in keys of tasks and in the table."""

    changes: tuple[Change, ...]
    words: tuple[str, ...]
    parameters: Mapping[str, Scalar]


def points(grid: Mapping[str, Any]) -> Iterator[Point]:
    """All combinations of a grid's lists, the last list varying fastest; of an empty grid the one without changes.

    ``{"reduction": {"modes": [4, 6], "coordinates": [10, 20]}}`` has four, the first called ``modes=4`` and
    ``coordinates=10``; a name is the shortest end of a dotted key that tells it from the others.  Raises InputError
    with source ``"study"``, if something else than a list with values stands at the end of a key.
    """
    lists = dict(_lists(grid, ""))
    last = Counter(key.rpartition(".")[2] for key in lists)
    names = [key if last[key.rpartition(".")[2]] > 1 else key.rpartition(".")[2] for key in lists]
    for numbered in itertools.product(*map(enumerate, lists.values())):
        values = {key: value for key, (_, value) in zip(lists, numbered, strict=True)}
        yield Point(
            tuple(Change(_nest(key, value), "grid") for key, value in values.items()),
            tuple(f"{name}={_word(value, number)}" for name, (number, value) in zip(names, numbered, strict=True)),
            {key: value if _is_plain(value) else json.dumps(value) for key, value in values.items()},
        )


def _lists(tables: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Sequence[Any]]]:
    for key, value in tables.items():
        if isinstance(value, Mapping):
            yield from _lists(value, f"{prefix}{key}.")
        elif isinstance(value, list) and value:
            yield f"{prefix}{key}", value
        else:
            raise InputError("study", f"grid.{prefix}{key}", value, "a list of values is allowed, one for each run")


def _nest(key: str, value: Any) -> dict[str, Any]:
    for part in reversed(key.split(".")):
        value = {part: value}
    return dict(value)


def _is_plain(value: Any) -> bool:
    return isinstance(value, (float, int, str))


def _word(value: Any, number: int) -> str:
    """A value as part of a key; where it can't be, its place in the list."""
    text = str(value).lower() if isinstance(value, bool) else str(value)
    return text if _is_plain(value) and KEY.fullmatch(f"0{text}") else f"no{number + 1}"
