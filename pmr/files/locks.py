"""Locks on files and folders, which the system takes from a process that dies."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module, util
from pathlib import Path
from typing import Any

_fcntl: Any = import_module("fcntl") if util.find_spec("fcntl") else None  # Windows has none


@contextmanager
def locked(path: Path, wait: bool = True) -> Iterator[bool]:
    """Hold the lock of a file or folder that is there.

    False where the file system has none, and, with `wait` false, where another process holds it.

    Raises FileNotFoundError if there is nothing of this name.
    """
    if _fcntl is None:
        yield False
        return
    place = os.open(path, os.O_RDONLY)
    try:
        try:
            _fcntl.flock(place, _fcntl.LOCK_EX | (0 if wait else _fcntl.LOCK_NB))
        except OSError:
            yield False
        else:
            yield True
    finally:
        os.close(place)
