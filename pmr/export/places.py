"""State spaces of a saved model with its sliders held at the places that a file is asked for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.reduced.model import ReducedModel
from pmr.simulate.state_space import StateSpace, state_space

Array = NDArray[np.float64]
#: Along the path where none are asked for.
PLACES = 21


def held_at(npz_path: Path, asked: str | None) -> StateSpace:
    """A reduced model at each of its `places`; raises InputError as these, and as `state_space`."""
    model = ReducedModel.load(npz_path)
    return state_space(model, places(model, asked), npz_path.name)


def places(model: ReducedModel, asked: str | None) -> Array:
    """Path coordinates (S,) in m: a grid, or those asked for, separated by commas; raises InputError off the path."""
    low, high = model.domain
    if asked is None:
        return np.linspace(low, high, PLACES)
    allowed = f"places from {low:g} to {high:g} m, separated by commas, are allowed"
    try:
        found = np.array(sorted({float(part) for part in asked.split(",")}))
    except ValueError:
        raise InputError("command line", "--at", asked, allowed) from None
    if not np.all((found >= low) & (found <= high)):  # NaN neither
        raise InputError("command line", "--at", asked, allowed)
    return found
