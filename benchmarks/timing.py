"""Times of several functions, called in turn so that a busy machine slows all alike; and memory of a process."""

from __future__ import annotations

import re
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: Does the work and may return the seconds that its solver took; otherwise the call is timed.
Way = Callable[[], float | None]


@dataclass(frozen=True)
class Times:
    """Wall seconds of each repeat."""

    seconds: tuple[float, ...]

    @property
    def least(self) -> float:
        """Least of all repeats in s."""
        return min(self.seconds)

    @property
    def median(self) -> float:
        """Median of all repeats in s."""
        return statistics.median(self.seconds)

    def times(self, factor: float) -> Times:
        """Multiply all times by a factor, as where only a share of the work was timed."""
        return Times(tuple(factor * seconds for seconds in self.seconds))

    def summary(self) -> dict[str, float | int]:
        """Least and median time in s and number of repeats, for the results file."""
        return {"min": self.least, "median": self.median, "repeats": len(self.seconds)}


def side_by_side(ways: Mapping[str, Way], repeats: int = 5) -> dict[str, Times]:
    """Times of all `ways`, called one after the other in each repeat."""
    taken: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(repeats):
        for name, way in ways.items():
            begin = time.perf_counter()
            seconds = way()
            taken[name].append(time.perf_counter() - begin if seconds is None else seconds)
    return {name: Times(tuple(seconds)) for name, seconds in taken.items()}


def exponent(x: Array, y: Array) -> float:
    """Slope of log y over log x by least squares."""
    return float(np.polyfit(np.log(x), np.log(y), 1)[0])


def peak_memory() -> float:
    """Peak memory of this process in MB.

    It is not read from getrusage, whose value may be that of the process which started this one.
    """
    found = re.search(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text())
    assert found is not None
    return int(found[1]) / 1024.0
