"""Where the sections of a boom are: the columns of their vertical displacements, and their places along the boom."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.results import Response, RunResult

Array = NDArray[np.float64]

#: Of the sections from the base out (Okabe and Ito), the first one again after the last.
COLOURS = ("#1c2733", "#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")


@dataclass(frozen=True)
class SectionLine:
    """A section's axis: places (o,) m along it, its displacement (T, o) m, and its tail along the boom (T,) m."""

    name: str
    colour: str
    x: Array
    moved: Array
    tail: Array


def lines(result: RunResult, response: Response) -> list[SectionLine]:
    """Of all sections, from the base out; vertical displacements."""
    boom, found = result.scene, []
    tails = np.cumsum(np.hstack([np.zeros((len(response.t), 1)), result.paths.values]), axis=1)
    for number, (part, tail) in enumerate(zip(boom.sections, tails.T, strict=True)):
        names = response.output_names
        tip = f"{part.name}: {part.observe.tip_along('z')}"
        columns = [k for k, name in enumerate(names) if name == tip or name.startswith(f"{part.name}: z at ")]
        columns.sort(key=lambda k: float(response.x[k]))
        found.append(
            SectionLine(
                part.name, COLOURS[number % len(COLOURS)], response.x[columns], response.displacement[:, columns], tail
            )
        )
    return found


def tip(result: RunResult, response: Response, direction: str) -> Array | None:
    """Displacement (T,) m of the last section's tip along y or z; None where there is none."""
    last = result.scene.sections[-1]
    name = f"{last.name}: {last.observe.tip_along(direction)}"
    return response.displacement[:, response.output_names.index(name)] if name in response.output_names else None
