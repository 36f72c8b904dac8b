r"""Grids and fields over them at a few times, axes that move, and bodies as other programs take them.

A body held where its sliders stand, as other programs take it: on frames (superelements) or on nodes.

Where axes that move with a boom are in space.

.. math:: X = R(t)\, (o(t) + r), \qquad U = R(t)\, u

r and u are a place and a displacement along the moving axes, o is where their origin is from the pivot, along them too.

What a body looks like, and fields over it at a few times, as pictures and files of them take them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from pmr.files import npz

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
        npz.write(file, npz.arrays(self), compressed=True)

    @classmethod
    def load(cls, file: Path) -> Fields:
        """Read what `save` wrote."""
        data = npz.read(file, MOST_EXPANSION, ROOM)
        return npz.record(cls, npz.rename_keys(data, {"region.": "grid.regions."}))  # as version 0.1 wrote them


@dataclass(frozen=True)
class Frames:
    """F frames by name, and their origins (F, 3) in m."""

    names: tuple[str, ...]
    points: Array


@dataclass(frozen=True)
class FramedBody:
    """M y'' + C y' + K y = f, y (6 F + m) being six displacements (m) and rotations (rad) of each frame, then m modes.

    The first frame is the ground: what pads and supports at s are attached to.

    Attributes
    ----------
    s : float, m
        Where the sliders stand.
    places : Frames
    M, C, K : (6 F + m, 6 F + m) arrays, symmetric, SI units
        K has six rigid motions, those of all frames together.
    """

    s: float
    places: Frames
    M: Array
    C: Array
    K: Array

    @property
    def modes(self) -> int:
        """Number of modes m."""
        return len(self.M) - 6 * len(self.places.names)

    @property
    def omega(self) -> Array:
        """The m lowest frequencies (m,) in rad/s with the ground at rest and all other frames free."""
        values = scipy.linalg.eigh(self.M[6:, 6:], self.K[6:, 6:], eigvals_only=True)[::-1]
        return np.asarray(1.0 / np.sqrt(values[: self.modes]))


@dataclass(frozen=True)
class Places:
    """P named places that other bodies and loads act on: the mean over a group, or a section of the body.

    Attributes
    ----------
    names : tuple of str
    points : (P, 3) array, m
    displacement, rotation : (P, 3, m) arrays, 1 and 1/m
        Of the place under each of the body's modes.
    """

    names: tuple[str, ...]
    points: Array
    displacement: Array
    rotation: Array


@dataclass(frozen=True)
class NodalBody:
    """Mass and stiffness on N nodes with three displacements each, node by node, and m modes of it.

    Attributes
    ----------
    s : float, m
        Where the sliders stand.
    points : (N, 3) array, m
    M, K : sparse (3 N, 3 N)
        K has the springs of all that gives way at s; what is rigid the modes know.
    modes : (3 N, m) array
        The lowest at s, M-orthonormal, in 1/sqrt(kg).
    omega : (m,) array, rad/s
        K on the modes is diag(omega^2).
    damping : (m, m) array, 1/s
        D on the modes: not diagonal, as nothing damps what gives way at moving pads.
    places : Places
    """

    s: float
    points: Array
    M: sp.csr_matrix
    K: sp.csr_matrix
    modes: Array
    omega: Array
    damping: Array
    places: Places


@dataclass(frozen=True)
class Pose:
    """Moving axes at S times: their rotation (S, 3, 3) and their origin (S, 3) in m."""

    rotation: Array
    origin: Array

    def places(self, points: ArrayLike) -> Array:
        """Places (S, n, 3) in m from the pivot in space, of places (S, n, 3) or (n, 3) in the moving axes."""
        from_pivot = np.asarray(points, float) + self.origin[:, None, :]
        return np.asarray(np.einsum("sij,snj->sni", self.rotation, from_pivot))

    def at(self, k: int, points: ArrayLike) -> Array:
        """Places (..., 3) in m in space at time number k, of places (..., 3) in the moving axes."""
        return self.turned(k, np.asarray(points, float) + self.origin[k])

    def turned(self, k: int, vectors: ArrayLike) -> Array:
        """Vectors (..., 3) in space at time number k, of vectors (..., 3) in the moving axes."""
        return np.asarray(np.asarray(vectors, float) @ self.rotation[k].T)
