"""What a body looks like, and fields over it at a few times, as pictures and files of them take them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmr.files import npz, records

Indices = NDArray[np.int64]
Array = NDArray[np.float64]
Single = NDArray[np.float32]
MOST_EXPANSION = 100.0  # of a compressed file; fields that move take a third more than their file,
ROOM = 2**28  # fields at rest up to a thousand times as much: bytes that any file may claim


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


@dataclass(frozen=True)
class Boxes:
    """Boxes that stand beside a body at S times, as its pads do.

    Attributes
    ----------
    names : tuple of str
        Of the P boxes.
    corners : (S, P, 8, 3) array, m
        In VTK's order of a hexahedron.
    values : mapping of name to (S, P) array
    """

    names: tuple[str, ...]
    corners: Array
    values: Mapping[str, Array]


@dataclass(frozen=True)
class Fields:
    """Displacements and fields over the cells at S times, in single precision.

    Attributes
    ----------
    grid : Grid
    t : (S,) array, s
    displacement : (S, N, 3) array, m
    von_mises : mapping of a face's name to (S, C) array
        Von Mises' stress in Pa on that face of the cells; empty where no stress is known.
    stress : mapping of a face and a component to (S, C) array
        Signed stress in Pa where von Mises' is largest in the cell; empty unless it is asked for.
    """

    grid: Grid
    t: Array
    displacement: Single
    von_mises: Mapping[str, Single]
    stress: Mapping[str, Single] = field(default_factory=dict)

    @property
    def points(self) -> Array:
        """Points of the grid, (N, 3) m."""
        return self.grid.points

    @property
    def cells(self) -> NDArray[np.int64]:
        """Cells of the grid, (C, k): points of each cell, in VTK's order."""
        return self.grid.cells

    @property
    def kind(self) -> str:
        """Kind of the grid's cells: line, triangle, tetra or hexahedron."""
        return self.grid.cell

    def save(self, file: Path) -> None:
        """Write everything as compressed npz."""
        npz.write(file, records.arrays(self), compressed=True)

    @classmethod
    def load(cls, file: Path) -> Fields:
        """Read what `save` wrote."""
        data = npz.read(file, MOST_EXPANSION, ROOM)
        return records.record(cls, records.rename_keys(data, {"region.": "grid.regions."}))  # as version 0.1 wrote them
