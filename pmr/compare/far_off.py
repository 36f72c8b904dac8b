"""Warnings of a run whose model or mesh is off by more than its scene allows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pmr.compare.model_part import error
from pmr.scene import Scene
from pmr.scene.choice import has_walls_that_could_give
from pmr.scene.members import members


def warnings(scene: Scene, budget: Mapping[str, Any]) -> Iterator[str]:
    """A line for each part of ``budget`` above `compare.model_tolerance`; with `[accuracy]` the mesh has a line of its
    own (`pmr.compare.accuracy.order.warnings`).
    """
    allowed = scene.compare.model_tolerance
    model, mesh = budget.get("model") or {}, budget.get("mesh")
    beyond = f"more than compare.model_tolerance = {allowed:g}"
    if model.get("beside") is not None and (most := error(model)) > allowed:
        giving = model["beside"].endswith("shell") and any(map(has_walls_that_could_give, members(scene)))
        better = 'body.walls = "give" adds the compliance of walls under pads' if giving else "a richer model is closer"
        yield f"the model is off by up to {100.0 * most:.2g} % beside a {model['beside']}, {beyond}; {better}"
    if scene.ordered is None and isinstance(mesh, Mapping) and (known := [one for one in mesh.values() if one]):
        if (most := max(known)) > allowed:
            yield f"the mesh is off by up to {100.0 * most:.2g} %, {beyond}; a finer one is closer"
