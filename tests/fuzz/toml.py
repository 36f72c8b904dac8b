"""Write plain data of any content as TOML."""

from datetime import date
from typing import Any

import numpy as np


def written(data: dict[str, Any]) -> str:
    """Write a table with a line for each key; tables in it are inline."""
    return "".join(f"{key(name)} = {value(found)}\n" for name, found in data.items())


def key(name: str) -> str:
    """Write a key, quoted if need be."""
    return name if name.isascii() and name.replace("_", "a").isalnum() else text(name)


def text(found: str) -> str:
    """Write a quoted text; halves of surrogate pairs, which TOML excludes, become question marks."""
    letters = (ord("?") if 0xD800 <= ord(letter) < 0xE000 else ord(letter) for letter in found)
    return '"' + "".join(chr(o) if 32 <= o < 127 and chr(o) not in '"\\' else f"\\U{o:08x}" for o in letters) + '"'


def value(found: Any) -> str:
    """Write a value."""
    if isinstance(found, bool):
        return str(found).lower()
    if isinstance(found, dict):
        return "{ " + ", ".join(f"{key(name)} = {value(part)}" for name, part in found.items()) + " }"
    if isinstance(found, list | tuple):
        return "[" + ", ".join(map(value, found)) + "]"
    if isinstance(found, str):
        return text(found)
    if isinstance(found, date):
        return found.isoformat()
    if isinstance(found, np.generic):  # of NumPy 2 the text names the type
        return value(found.item())
    return repr(found)
