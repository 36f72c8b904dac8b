"""The figures of one case, as SVG."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from matplotlib.figure import Figure

from pmr.report.figures import captions, histories, inputs, shapes, spectra
from pmr.report.figures.canvas import style
from pmr.report.figures.timeline import Array
from pmr.report.figures.vector import svg
from pmr.results import Response, RunResult

__all__ = ["Drawing", "Named", "drawings", "drawn"]

#: Name, figure and caption.
Named = tuple[str, Figure, str]


@dataclass(frozen=True)
class Drawing:
    """A figure as it stands in the report: its identifier, an ``<svg>`` element and the sentence below it."""

    name: str
    svg: str
    caption: str


def drawings(result: RunResult, prefix: str) -> dict[str, Drawing]:
    """All figures of a case by name.

    Parameters
    ----------
    result : RunResult
    prefix : str
        Put before every identifier in the SVG; unique among the cases of a page.
    """
    return drawn(_figures(result), prefix)


def drawn(figures: Iterable[Named], prefix: str) -> dict[str, Drawing]:
    """Figures with their names and captions as SVG, in the report's style."""
    with style():
        return {
            name: Drawing(f"{prefix}-{name}", svg(figure, f"{prefix}-{name}", caption), caption)
            for name, figure, caption in figures
        }


def _figures(result: RunResult) -> Iterator[Named]:
    """One after the other, so that only one figure is held at a time."""
    offsets, length = result.scene.slider.offsets, result.beam.body.length
    yield "position", inputs.position(result, offsets, length), "Slider position over time."
    yield "loads", inputs.loads(result, result.beam.loads), "Loads over time."
    yield "snapshots", shapes.snapshots(result), captions.snapshots(result)
    yield "tip", histories.history(result, _tip, "Displacement", "m"), captions.tip(result)
    yield "energy", histories.history(result, _energy, "Total energy", "J"), captions.energy(result)
    yield "energy-parts", histories.energy_parts(result), captions.energy_parts(result)
    yield (
        "slider-force",
        histories.slider_force(result),
        "Slider force: the multiplier λ of the constraint. The slider pushes with −λ on the beam.",
    )
    for name, what, unit in (("position", _residual_position, "m"), ("velocity", _residual_velocity, "m/s")):
        figure = histories.residual(result, what, f"Residual of {name} in {unit}")
        yield f"residual-{name}", figure, captions.residual(result, what, name)
    yield "basis", shapes.basis(result), captions.basis(result)
    if result.scene.reduction.basis != "free_modes":  # M-orthonormal modes have singular values of 1, all of them
        yield (
            "singular-values",
            spectra.singular_values(result),
            "Singular values of the snapshots. κ is the share of the sum of their squares that the basis keeps.",
        )
    if result.frequencies.reduced.size:
        yield "frequencies", spectra.frequencies(result), captions.frequencies(result)


def _tip(response: Response) -> Array:
    return response.tip


def _energy(response: Response) -> Array:
    return response.energy.total


def _residual_position(response: Response) -> Array:
    return response.residual_position


def _residual_velocity(response: Response) -> Array:
    return response.residual_velocity
