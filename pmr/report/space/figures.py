"""The figures of a structure in space."""

from __future__ import annotations

from collections.abc import Iterator

from pmr.report.figures import Drawing, Named, captions, drawn, histories, inputs, spectra
from pmr.report.figures.timeline import Array, reference
from pmr.report.numbers import SPACE, plain
from pmr.report.space.colour_scale import ramp
from pmr.report.space.histories import MOST_PADS, pad_forces, stress
from pmr.report.space.instants import top
from pmr.report.space.layout import end_of, forces, mouths, scene_of, tips
from pmr.report.space.sentences import where_the_peak_is
from pmr.results import Response, RunResult

_SIDEWAYS = {"y": "lateral, y", "z": "vertical, z"}


def drawings(result: RunResult, prefix: str) -> dict[str, Drawing]:
    """All figures of a case by name; `prefix` is put before every identifier."""
    return drawn(_figures(result), prefix)


def tip_names(result: RunResult) -> list[str]:
    """Names of the figures of the tip's motion."""
    return [f"tip-{direction}" for direction in tips(scene_of(result))]


def force_names(result: RunResult) -> list[str]:
    """Names of the figures of pad forces, ring by ring."""
    return [f"pads-{number}" for number, _ in enumerate(forces(result), start=1)]


def _figures(result: RunResult) -> Iterator[Named]:
    """One after the other, so that only one figure is held at a time."""
    scene = scene_of(result)
    position = inputs.position(result, mouths(scene), end_of(result), "Mouth position")
    yield "position", position, "Position of the mouth along the body over time."
    if scene.loads:
        yield "loads", inputs.loads(result, scene.loads), f"Loads over time.{_weight(result)}"
    for direction, what in tips(scene).items():
        about = "deviates most" if reference(result) else "moves most"
        title = f"Displacement of the tip, {_SIDEWAYS[direction]}"
        caption = captions.history(result, title, f", where it {about}", what)
        yield f"tip-{direction}", histories.history(result, what, f"Displacement {direction}", "m", what), caption
    if result.fields is not None and result.fields.von_mises:
        caption = "Colours of the pictures: the largest von Mises stress of each cell."
        yield "ramp", ramp(top(result.fields) / 1e6), caption
    if "reduced" in result.peak_stress:
        yield "stress", stress(result), _stress(result)
    yield from _pads(result)
    yield "energy", histories.history(result, _energy, "Total energy", "J", _energy), _energy_caption(result)
    yield "energy-parts", histories.energy_parts(result), captions.energy_parts(result)
    if result.scene.reduction.basis != "free_modes":  # M-orthonormal modes have singular values of 1, all of them
        caption = "Singular values of the snapshots. κ is the share of the sum of their squares that the basis keeps."
        yield "singular-values", spectra.singular_values(result), caption
    if result.frequencies.reduced.size:
        caption = "Lowest eigenfrequencies of the resting structure against the length that reaches beyond the mouth."
        yield "frequencies", spectra.frequencies(result, end_of(result)), caption


def _pads(result: RunResult) -> Iterator[Named]:
    for number, (ring, pads) in enumerate(forces(result).items(), start=1):
        most = f" The first {MOST_PADS} of {len(pads)}." if len(pads) > MOST_PADS else ""
        within = " Of those that only push the largest within each step." if _in_parts(result) else ""
        caption = f"Forces of the pads at the {ring}, positive where they push the body inwards.{within}{most}"
        yield f"pads-{number}", pad_forces(result, pads), caption


def _in_parts(result: RunResult) -> bool:
    """Whether a step was made in parts, for pads that only push."""
    return result.responses["reduced"].force_peaks is not None


def _energy(response: Response) -> Array:
    return response.energy.total


def _energy_caption(result: RunResult) -> str:
    return captions.history(result, "Total energy: kinetic and strain energy less the work of the loads", focus=_energy)


def _weight(result: RunResult) -> str:
    gravity = scene_of(result).gravity
    if gravity is None:
        return ""
    rise = f", which comes up within the first {plain(gravity.rise)}{SPACE}s" if gravity.rise else ""
    return f" The weight acts too{rise}."


def _stress(result: RunResult) -> str:
    below = "; below, the difference to the full model" if "full" in result.peak_stress else ""
    where = where_the_peak_is(result, "reduced")
    dot = f" The dot is the largest of all, {where}." if where else ""
    return f"Largest von Mises stress over the whole body{below}.{dot}"
