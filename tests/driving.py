"""Excitations of the bodies of the tests, whose inputs are a tip load F and a moment T."""

from collections.abc import Sequence

import numpy as np

from pmr.files.arrays import Array
from pmr.scene.signals import SignalBase
from pmr.simulation import Excitation, TimeStepping

Loads = SignalBase | Sequence[SignalBase]


def named(loads: Loads, names: Sequence[str] = ("F", "T")) -> dict[str, SignalBase]:
    """Assign loads to the names of the inputs that they drive, in order; a single load drives the first input."""
    signals = (loads,) if isinstance(loads, SignalBase) else tuple(loads)
    return dict(zip(names, signals, strict=False))


def driven(path: SignalBase, loads: Loads, stepping: TimeStepping, names: Sequence[str] = ("F", "T")) -> Excitation:
    """Excitation by a path of the slider, loads in the order of the inputs `names`, and a time grid."""
    return Excitation({"slider": path}, named(loads, names), stepping)


def loads_at(loads: Loads, t: Array) -> Array:
    """Values (T, i) of i loads at the times t (T,) in s."""
    signals = (loads,) if isinstance(loads, SignalBase) else tuple(loads)
    return np.stack([load.value(t) for load in signals], axis=1)
