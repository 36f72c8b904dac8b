"""Where the theory that all models share ends: rotations and displacements are small against the body."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from pmr.results import Response

SMALL = 0.1  # of the body's length: a tip's path is then shortened by about half a per cent of it


def large_motion(length: float, responses: Iterable[Response]) -> list[str]:
    """A line where a body of this length in m moves by more than `SMALL` of it, which no linear model describes."""
    largest = max(float(np.abs(response.displacement).max(initial=0.0)) for response in responses)
    if not largest > SMALL * length:
        return []
    return [
        f"the largest displacement, {largest:.3g} m, is {largest / length:.2g} times the body's length: "
        f"beyond {SMALL:g} times the theory of small motions does not hold"
    ]
