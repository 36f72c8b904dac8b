"""What drives the bodies of the tests, by position: their inputs are called the tip load F, and a moment T."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pmr.scene.signals import SignalBase
from pmr.simulation import Excitation, TimeStepping

Array = NDArray[np.float64]
Loads = SignalBase | Sequence[SignalBase]


def named(loads: Loads, names: Sequence[str] = ("F", "T")) -> dict[str, SignalBase]:
    """Loads by the names of the inputs that they drive, in order; a single one for the first."""
    signals = (loads,) if isinstance(loads, SignalBase) else tuple(loads)
    return dict(zip(names, signals, strict=False))


def driven(path: SignalBase, loads: Loads, stepping: TimeStepping, names: Sequence[str] = ("F", "T")) -> Excitation:
    """A path, loads in the order of the inputs called `names`, and a time grid."""
    return Excitation({"slider": path}, named(loads, names), stepping)


def loads_at(loads: Loads, t: Array) -> Array:
    """Loads (T, i) at the times t (T,), one column a load."""
    signals = (loads,) if isinstance(loads, SignalBase) else tuple(loads)
    return np.stack([load.value(t) for load in signals], axis=1)
