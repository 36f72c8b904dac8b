"""The sides of a closed profile, flat plates and arcs, as what meshes a boom asks of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Pair = tuple[float, float]
#: What is added to the names of walls that are not parallel to the axis.
TAPERED = " tapered"


class Side(Protocol):
    """A flat plate or the arc of a corner, as one walks around a profile counter-clockwise, seen from the tip."""

    @property
    def name(self) -> str:
        """Name of the group that the side becomes."""

    @property
    def start(self) -> Pair:
        """Y and z of the mid-surface, m."""

    @property
    def end(self) -> Pair: ...

    @property
    def centre(self) -> Pair | None:
        """Centre of an arc, (2,) m; None for a flat side."""

    @property
    def angle(self) -> float:
        """Angle of an arc, rad."""

    @property
    def length(self) -> float: ...

    @property
    def thickness(self) -> float: ...

    def cells(self, size: float) -> int:
        """How many cells of about that size, in m, it is divided into."""


@dataclass(frozen=True)
class Part:
    """From one place along x to another one, m: layers of cells end there; in between sides change linearly."""

    start: float
    end: float
    first: tuple[Side, ...]
    last: tuple[Side, ...]

    @property
    def tapers(self) -> bool:
        """Whether the sides are not parallel to the axis."""
        pairs = zip(self.first, self.last, strict=True)
        return any((a.start, a.end, a.centre) != (b.start, b.end, b.centre) for a, b in pairs)


def ends_of(sides: Sequence[Side], k: int, outward: Callable[[Side], float]) -> tuple[Array, Array]:
    """Ends (2,) m of a side, each side as far outward from its mid-surface as is said of it."""
    side, neighbours = sides[k], (sides[k - 1], sides[(k + 1) % len(sides)])
    ends = []
    for at, other in zip((side.start, side.end), neighbours, strict=True):
        sharp = side.centre is None and other.centre is None
        normals, apart = [out(side, at), out(other, at)], [outward(side), outward(other)]
        ends.append(at + (np.linalg.solve(normals, apart) if sharp else apart[0] * normals[0]))
    return ends[0], ends[1]


def out(side: Side, at: Pair) -> Array:
    """Unit vector (2,) out of a side at one of its ends."""
    if side.centre is not None:
        arm = np.subtract(at, side.centre)
        return np.asarray(arm / np.hypot(*arm))
    along = np.subtract(side.end, side.start) / side.length
    return np.array([along[1], -along[0]])
