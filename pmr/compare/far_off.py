"""Warnings of a run whose reduction is far off, or whose model or mesh is by more than its scene allows."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pmr.compare import covered
from pmr.compare.model_part import error
from pmr.errors.text import rounded
from pmr.results.quantities import QUANTITIES
from pmr.results.reduction_error import reduction_error
from pmr.scene import Scene
from pmr.scene.choice import has_walls_that_could_give
from pmr.scene.members import members


def warnings_of_reduction(summary: Mapping[str, Any]) -> list[str]:
    """A line where the reduced model is off by more than `covered.FAR` beside the full one, or as it is estimated."""
    source, errors = reduction_error(summary)
    far = {kind: error for kind, error in errors.items() if error > covered.FAR}
    if not far:
        return []
    errors_text = ", ".join(f"{_percent(error)} in {QUANTITIES[kind].label}" for kind, error in far.items())
    return [f"the reduced model is off by {errors_text} ({source}): it has too few coordinates, or its motion grows"]


def _percent(error: float) -> str:
    return f"{rounded(100.0 * error)} %"


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
        yield f"the model is off by up to {rounded(100.0 * most)} % beside a {model['beside']}, {beyond}; {better}"
    if scene.goal is None and isinstance(mesh, Mapping) and mesh:
        kind, most = max(mesh.items(), key=lambda item: item[1])
        if most > allowed:
            where = QUANTITIES[kind].label
            yield f"the mesh is off by up to {rounded(100.0 * most)} % in {where}, {beyond}; a finer one is closer"
