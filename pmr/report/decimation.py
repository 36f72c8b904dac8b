"""Less for the same picture: long signals are thinned so that every peak stays, and packed for players."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmr.report.numbers import round_number

Array = NDArray[np.float64]
PLAYING = 30.0  # s that the whole motion plays at the speed set first
_FULL_SCALE = 32767


def extremes(values: ArrayLike, bins: int) -> NDArray[np.intp]:
    """Indices of samples that keep every peak.

    Plain thinning would alias whatever oscillates faster than the new step.  Here the signal is cut into
    `bins` equal intervals, and of each the smallest and the largest sample stay, in their order in time.

    Parameters
    ----------
    values : (T,) array
    bins : int
        Intervals; about one for each point of line width in the picture.

    Returns
    -------
    (n,) array of int
        Increasing, with the first and the last sample; n <= 2 bins + 2, and all T where that is no more.
    """
    values = np.asarray(values, dtype=float)
    count = len(values)
    if count <= 2 * bins + 2:
        return np.arange(count)
    pieces = _pieces(count, bins)
    low = [start + int(np.argmin(values[start:stop])) for start, stop in pieces]
    high = [start + int(np.argmax(values[start:stop])) for start, stop in pieces]
    return np.unique([0, *low, *high, count - 1])


def upper_envelope(values: ArrayLike, bins: int) -> NDArray[np.intp]:
    """Indices of the largest sample in each of `bins` intervals: the upper envelope of a noisy signal."""
    values = np.asarray(values, dtype=float)
    count = len(values)
    if count <= bins:
        return np.arange(count)
    return np.array([start + int(np.argmax(values[start:stop])) for start, stop in _pieces(count, bins)])


def spread(count: int, most: int) -> NDArray[np.intp]:
    """At most `most` indices, evenly spread over ``range(count)``, with both ends."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(int))


def onto(t: Array, times: Array, values: Array) -> Array:
    """Columns of `values`, known at `times`, at the times `t`; the same array where these are the same."""
    if len(t) == len(times) and np.allclose(t, times, rtol=0.0, atol=1e-9 * abs(t[-1])):
        return values
    if values.ndim == 1:
        return np.interp(t, times, values)
    return np.stack([np.interp(t, times, column) for column in values.T], axis=1)


def _pieces(count: int, bins: int) -> list[tuple[int, int]]:
    """`bins` intervals that make up ``range(count)``."""
    edges = np.linspace(0, count, bins + 1).astype(int).tolist()
    return list(zip(edges[:-1], edges[1:], strict=True))


def pack(values: NDArray[np.float64]) -> dict[str, Any]:
    """Little-endian 16-bit integers in base64, and the value of one count."""
    largest = float(np.abs(values).max(initial=0.0)) or 1.0
    counts = np.round(values / largest * _FULL_SCALE).astype("<i2")
    return {"count": largest / _FULL_SCALE, "data": base64.b64encode(counts.tobytes()).decode()}


def speeds(duration: float) -> dict[str, Any]:
    """Playback speeds as multiples of real time; the one set first is round and plays for about `PLAYING`."""
    first = round_number(max(duration / PLAYING, 1e-6))
    choices = [first / 5.0, first / 2.0, first, 2.0 * first, 4.0 * first]
    return {"first": first, "choices": [float(f"{choice:.3g}") for choice in choices]}
