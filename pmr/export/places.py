"""State spaces of a saved model with its sliders held at the places that a file is asked for."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.export.formats import Options
from pmr.reduced.model import ReducedModel
from pmr.simulation.state_space import StateSpace, state_space

Array = NDArray[np.float64]
#: Along the path where none are asked for.
PLACES = 21


def held_at(npz_path: Path, options: Options) -> StateSpace:
    """A reduced model at each of its `places`, or a section of a boom without the rows of its joints.

    Raises InputError as `places` and `state_space`, and if the model is of another section than the one asked for.
    """
    model, name = ReducedModel.load(npz_path), options.section
    if name is None:
        return state_space(model, places(model, options.at), npz_path.name)
    if model.section is None or name != model.section.name:
        allowed = "none is allowed: this is the model of a whole body"
        if model.section is not None:
            allowed = f"{model.section.name!r} is allowed, which {npz_path.name} is the model of"
        raise InputError("command line", "--section", name, allowed)
    if options.at is not None:
        allowed = "none is allowed with --section: without its joints nothing of a section depends on a place"
        raise InputError("command line", "--at", options.at, allowed)
    alone = state_space(model.without_joints(), np.array(model.domain[:1]), npz_path.name)
    inputs, outputs = (tuple(f"{name}.{one}" for one in names) for names in (alone.inputs, alone.outputs))
    return replace(alone, inputs=inputs, outputs=outputs)


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
