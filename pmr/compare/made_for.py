"""Whether a scene's loads are those that a reduced model was made for."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pmr.errors import InputError
from pmr.reduced.model import ReducedModel
from pmr.scene import Scene


def check_directions(reduced: ReducedModel, scene: Scene) -> None:
    """Loads act where and as they did when the model was made: their columns are in it.

    Raises InputError with the key and what the model has.
    """
    reduced.ensure_whole("model")
    made = reduced.provenance.get("scene")
    if not isinstance(made, Mapping):
        return
    down = (made.get("gravity") or {}).get("direction")
    if down and scene.gravity and not np.allclose(down, scene.gravity.direction, atol=1e-9):
        allowed = f"that of the model is allowed: {down}"
        raise InputError("scene", "gravity.direction", list(scene.gravity.direction), allowed)
    known = {load.get("name"): load for load in made.get("loads") or ()}  # older models say less of them
    for i, load in enumerate(scene.loads):
        for key in ("on", "direction"):
            there = known.get(load.name, {}).get(key)
            if there is not None and there != getattr(load, key):
                allowed = f"that of the model is allowed: {there!r}"
                raise InputError("scene", f"loads[{i}].{key}", getattr(load, key), allowed)
