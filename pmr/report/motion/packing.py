"""Series as the players of the page read them, and how fast these play."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.report.numbers import round_number

PLAYING = 30.0  # s that the whole motion plays at the speed set first
_FULL_SCALE = 32767


def packed(values: NDArray[np.float64]) -> dict[str, Any]:
    """Little-endian 16-bit integers in base64, and the value of one count."""
    largest = float(np.abs(values).max(initial=0.0)) or 1.0
    counts = np.round(values / largest * _FULL_SCALE).astype("<i2")
    return {"count": largest / _FULL_SCALE, "data": base64.b64encode(counts.tobytes()).decode()}


def speeds(duration: float) -> dict[str, Any]:
    """Playback speeds as multiples of real time; the one set first is round and plays for about `PLAYING`."""
    first = round_number(max(duration / PLAYING, 1e-6))
    choices = [first / 5.0, first / 2.0, first, 2.0 * first, 4.0 * first]
    return {"first": first, "choices": [float(f"{choice:.3g}") for choice in choices]}
