"""JSON that every reader of JSON can read: it knows no NaN and no infinity, which become null."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from typing import Any


def text(data: Any, indent: int | None = None) -> str:
    """`data` as JSON, null where a number is not finite; raises TypeError at what is no plain value, list or table."""
    return json.dumps(_finite(data), indent=indent, allow_nan=False)


def not_finite(data: Any, name: str = "") -> Iterator[str]:
    """Dotted names of all numbers in `data` that are not finite, such as ``errors.reduced_vs_full.tip``."""
    if isinstance(data, float) and not math.isfinite(data):
        yield name
    elif isinstance(data, Mapping):
        for key, value in data.items():
            yield from not_finite(value, f"{name}.{key}" if name else str(key))
    elif isinstance(data, list | tuple):
        for number, value in enumerate(data):
            yield from not_finite(value, f"{name}[{number}]")


def remarks(data: Any) -> list[str]:
    """A line for each number that is not finite."""
    return [f"{name} is not finite; in summary.json it is null" for name in not_finite(data)]


def _finite(data: Any) -> Any:
    if isinstance(data, float):
        return data if math.isfinite(data) else None
    if isinstance(data, Mapping):
        return {key: _finite(value) for key, value in data.items()}
    return [_finite(value) for value in data] if isinstance(data, list | tuple) else data
