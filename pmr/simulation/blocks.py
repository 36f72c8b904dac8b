"""A simulation block by block: coordinates of all steps at once are kept only by those who ask for them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.stepping import Progress
from pmr.system.system import SystemTrajectory

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Block:
    """Some steps in a row; the first of them is the last of the block before, or the start."""

    first: int  # number of its first step
    count: int
    #: Some of its steps, by their numbers from the first one on; valid until the next block: what is kept is copied.
    at: Callable[[Indices | slice], SystemTrajectory]


#: Seconds from which on blocks get no longer, where they begin with few steps.
BRIEF = 0.05

#: Functions that each block is passed to, in order.
Take = Callable[[Block], None]


@dataclass(frozen=True)
class Ended:
    """Figures at the end of a simulation: the solver's wall time in s, and the `surplus` of a trajectory."""

    seconds: float
    surplus: float


class Recorder:
    """Takes blocks and records some of their steps (S,), ascending."""

    def __init__(self, steps: Indices) -> None:
        self._steps = steps
        self._found: SystemTrajectory | None = None

    def __call__(self, block: Block) -> None:
        low, high = np.searchsorted(self._steps, [block.first, block.first + block.count])
        if self._found is not None and low == high:
            return
        # Numbers in a row are taken as they stand, in a fifth of the time.
        some = block.at(slice(None) if high - low == block.count else self._steps[low:high] - block.first)
        if high - low == len(self._steps):
            self._found = some.map_arrays(_own)
            return
        if self._found is None:
            self._found = some.map_arrays(lambda array: np.empty((len(self._steps), *array.shape[1:]), array.dtype))
        for stored, array in zip(self._found.arrays, some.arrays, strict=True):
            stored[low:high] = array

    def trajectory(self, ended: Ended) -> SystemTrajectory:
        """The recorded steps."""
        assert self._found is not None  # as every simulation has a block
        return replace(self._found, seconds=ended.seconds, surplus=ended.surplus)


def _own(array: NDArray[Any]) -> NDArray[Any]:
    """The array, or a copy where it is a view of what others may still write to."""
    return np.ascontiguousarray(array) if array.flags.owndata else array.copy()


def in_blocks(
    end: int,
    most: int,
    heavy: int,
    advance: Callable[[int, int], None],
    taken: Callable[[int, int], None],
    progress: Progress | None,
) -> float:
    """Steps 1 to `end`, the latter excluded, `most` of them at once; the seconds that `advance` took.

    It takes steps first to last, the latter excluded; then `taken` learns of them, and `progress` of the share that is
    done.  Where steps may be as `heavy` as so many, the first blocks are smaller.
    """
    first, seconds, size = 1, 0.0, max(1, most // heavy)
    while first < end:
        last = min(first + size, end)
        begun = time.perf_counter()
        advance(first, last)
        passed = time.perf_counter() - begun
        taken(first, last)
        if progress is not None:
            progress((last - 1) / (end - 1))
        first, seconds = last, seconds + passed
        size = min(2 * size, most) if passed < BRIEF else size
    return seconds
