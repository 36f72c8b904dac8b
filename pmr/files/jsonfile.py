"""JSON that every reader of JSON can read: it knows no NaN and no infinity, which become null."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any


def text(data: Any, indent: int | None = None) -> str:
    """`data` as JSON, null where a number is not finite; raises TypeError at what is no plain value, list or table."""
    return json.dumps(_finite(data), indent=indent, allow_nan=False)


def _finite(data: Any) -> Any:
    if isinstance(data, float):
        return data if math.isfinite(data) else None
    if isinstance(data, Mapping):
        return {key: _finite(value) for key, value in data.items()}
    return [_finite(value) for value in data] if isinstance(data, list | tuple) else data
