"""What a body looks like: points and cells, with no finite-element library behind them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Grid:
    """Cells of one kind in space.

    Attributes
    ----------
    cell : ``"line"``, ``"triangle"``, ``"tetra"`` or ``"hexahedron"``
    points : (N, 3) array, m
    cells : (C, k) integer array
        Points of each cell, in VTK's order.
    regions : mapping of name to (c,) integer array
        Named groups of cells.
    """

    cell: str
    points: Array
    cells: Indices
    regions: Mapping[str, Indices] = field(default_factory=dict)

    def region(self, cell: int) -> str:
        """Names of the regions that a cell is part of, joined by commas; empty if there are none."""
        return ", ".join(sorted(name for name, cells in self.regions.items() if cell in cells))
