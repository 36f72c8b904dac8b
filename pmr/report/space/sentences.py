"""What a structure in space says in a few sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from pmr.report import sentences
from pmr.report.numbers import MINUS, SPACE, percent, quantity
from pmr.report.space.layout import scene_of
from pmr.results import RunResult
from pmr.scene.choice import choose, model_of

#: Places beside the first one that are named, if they share the largest stress; more are counted.
MOST_PLACES = 2
MODELS = {"beam2d": "a planar beam", "beam3d": "a beam in space", "shell": "a shell", "solid": "a solid"}


def paragraph(result: RunResult) -> str:
    """Which model and why, how small it became, how well it follows, what it bears, how fast it is."""
    return " ".join(_sentences(result))


def where_the_peak_is(result: RunResult, simulator: str) -> str:
    """Time and place of the largest von Mises stress; empty where they are not known."""
    peak = result.summary.get("stress_peak", {}).get(simulator)
    if peak is None:
        return ""
    kind = "corner" if model_of(scene_of(result)).startswith("beam") else "face"
    on = f", {peak['face']} {kind}" if peak.get("face") else ""
    of = f" of {peak['region']}" if peak.get("region") else ""
    return f"at {peak['t']:.2f}{SPACE}s and {_place(peak['position'])}{on}{of}{_others(peak.get('shared', ()))}"


def _others(places: Sequence[Sequence[float]]) -> str:
    """Where the same stress is found too."""
    if len(places) > MOST_PLACES:
        return f", and as large at {len(places)} other places"
    return f", and as large at {' and '.join(map(_place, places))}" if places else ""


def _place(position: Sequence[float]) -> str:
    x, y, z = (f"{round(value, 2) + 0.0:.2f}".replace("-", MINUS) for value in position)  # zero has no sign
    return f"({x}, {y}, {z}){SPACE}m"


def _sentences(result: RunResult) -> Iterator[str]:
    scene = scene_of(result)
    chosen = choose(scene)
    named = scene.body.model != "auto"
    because = "as the scene names it" if named else f"since {'; '.join(chosen.reasons)}"
    yield f"The structure is represented by {MODELS[chosen.model]}, {because}."
    yield sentences.size(result)
    yield from sentences.accuracy(result)
    force = result.summary.get("errors", {}).get("reduced_vs_full", {}).get("pad_force")
    if force is not None:
        yield f"The forces of all pads are within {percent(force)}."
    yield from _stress(result)
    if said := sentences.estimate(result):
        yield said
    if said := sentences.step(result):
        yield said
    yield from sentences.speed(result)


def _stress(result: RunResult) -> Iterator[str]:
    largest = result.summary.get("max_von_mises", {})
    if "reduced" not in largest:
        return
    where = where_the_peak_is(result, "reduced")
    said = f"The largest von Mises stress is {quantity(largest['reduced'], 'Pa')}{f', {where}' if where else ''}"
    if largest.get("full"):
        apart = percent(abs(largest["reduced"] / largest["full"] - 1.0), 2)
        said += f"; the full model has {quantity(largest['full'], 'Pa')}, {apart} apart"
    yield f"{said}."
