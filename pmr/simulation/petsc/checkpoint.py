"""Checkpoints of a long simulation: a file that is complete or not there, npz with a JSON header, never a pickle."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.files import npz
from pmr.files.whole import NotWrittenError

Array = NDArray[np.float64]
_log = logging.getLogger(__name__)

FORMAT = "pmr-checkpoint"
FORMAT_VERSION = 2
#: Version 1 has one number of parts for all steps, and path and loads at the steps only.
READ = (1, FORMAT_VERSION)
#: Numbers that describe the model agree to this if it is the same, assembled on however many ranks.
SAME = 1e-9
_DAMAGE = (KeyError, TypeError, ValueError, OverflowError, RecursionError)


@dataclass(frozen=True)
class Checkpoint:
    """Folder in which a simulation is stored from time to time, and from which it resumes.

    Attributes
    ----------
    file : Path
        Replaced at each checkpoint, and last when the simulation ends: a simulation that is started again ends at
        once with the same result.  Whoever has stored the result may delete it.
    seconds : float
        Wall time between two checkpoints.
    """

    file: Path
    seconds: float = 60.0


@dataclass(frozen=True)
class Saved:
    """A simulation after `step` steps, which took `seconds`: arrays by name, whole, and what it belongs to."""

    step: int
    seconds: float
    identity: Mapping[str, Any]
    arrays: Mapping[str, Array]


def save(checkpoint: Checkpoint, saved: Saved) -> None:
    """Write a checkpoint and put it in the place of the one before, in one go.

    Where there is no room for it the simulation goes on without, and what was saved before stays.
    """
    header = {
        "format": FORMAT,
        "version": FORMAT_VERSION,
        "step": saved.step,
        "seconds": saved.seconds,
        "identity": dict(saved.identity),
    }
    checkpoint.file.parent.mkdir(parents=True, exist_ok=True)
    try:
        npz.write(checkpoint.file, saved.arrays, header)
    except NotWrittenError as error:
        _log.warning("no checkpoint: %s", error)


def load(checkpoint: Checkpoint, identity: Mapping[str, Any]) -> Saved | None:
    """The checkpoint of the simulation with this identity; None if there is no file.

    Raises
    ------
    InputError
        If the file is damaged or belongs to another simulation.
    """
    name = str(checkpoint.file)
    if not checkpoint.file.exists():
        return None
    try:
        arrays = npz.read(checkpoint.file)
        header = npz.without_header(arrays)
        if header["format"] != FORMAT or header["version"] not in READ:
            raise ValueError("another format")
        saved = Saved(int(header["step"]), float(header["seconds"]), dict(header["identity"]), arrays)
    except _DAMAGE as error:
        allowed = f"a checkpoint is allowed, this is none ({error}); delete it to start from t = 0"
        raise InputError(name, "", None, allowed) from None
    if different := _differences(saved.identity, identity):
        allowed = f"another simulation's checkpoint: {different} differs; delete it or name another file"
        raise InputError(name, "", None, allowed)
    return saved


def _differences(stored: Mapping[str, Any], expected: Mapping[str, Any]) -> str:
    names = [key for key, value in expected.items() if not _same(stored.get(key), value)]
    return ", ".join(names)


def _same(a: Any, b: Any) -> bool:
    if isinstance(b, list) and isinstance(b[0], str):
        return bool(a in (b, b[0]))
    if isinstance(b, list):
        return isinstance(a, list) and len(a) == len(b) and np.allclose(a, b, rtol=SAME, atol=0.0)
    return bool(a == b)
