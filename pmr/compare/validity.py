"""Where the theory that all models share ends: rotations and displacements are small against the body."""

from __future__ import annotations

import numpy as np

from pmr.results import RunResult

SMALL = 0.1  # of the body's length: a tip's path is then shortened by about half a per cent of it


def large_motion(result: RunResult) -> list[str]:
    """A line where the body moves by more than `SMALL` of its length, which no linear model describes."""
    length = result.scene.length
    largest = max(float(np.abs(response.displacement).max(initial=0.0)) for response in result.responses.values())
    if not largest > SMALL * length:
        return []
    return [
        f"the largest displacement, {largest:.3g} m, is {largest / length:.2g} times the body's length: "
        f"beyond {SMALL:g} times the theory of small motions does not hold"
    ]
