r"""Grids and fields over them at several times, axes that move with a boom, and held bodies for other programs.

A displacement u at a point r of the moving axes becomes in space

.. math:: X = R(t)\, (o(t) + r), \qquad U = R(t)\, u

with the rotation R of the axes and o, the vector from the pivot to their origin, in components along the moving axes.

A body with its sliders held at one path coordinate is exported on frames (superelements, `FramedBody`) or on nodes
(`NodalBody`).
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
MOST_EXPANSION = 100.0  # most bytes of fields over those of their compressed file; moving fields take 4/3
ROOM = 2**28  # bytes that any file may claim: fields at rest take up to 1000 times their file


@dataclass(frozen=True)
class Grid:
    """Cells of one kind in space.

    Attributes
    ----------
    cell : ``"line"``, ``"triangle"``, ``"tetra"`` or ``"hexahedron"``
    points : (N, 3) array, m
    cells : (C, k) integer array
        Indices of the k points of each cell, in VTK's order.
    regions : mapping of name to (c,) integer array
        Indices of the c cells of each named region.
    """

    cell: str
    points: Array
    cells: Indices
    regions: Mapping[str, Indices] = field(default_factory=dict)

    def region(self, cell: int) -> str:
        """Return the names of the regions that contain a cell, joined by commas; empty if there are none."""
        return ", ".join(sorted(name for name, cells in self.regions.items() if cell in cells))


@dataclass(frozen=True)
class Boxes:
    """P boxes drawn beside a body at S times, such as its pads.

    Attributes
    ----------
    names : tuple of str
        Names of the P boxes.
    corners : (S, P, 8, 3) array, m
        Corners of each box at each time, in VTK's order of a hexahedron.
    values : mapping of name to (S, P) array
        Quantities of each box at each time.
    """

    names: tuple[str, ...]
    corners: Array
    values: Mapping[str, Array]


@dataclass(frozen=True)
class Fields:
    """Displacements and stresses on a grid of N points and C cells at S times, in single precision.

    Attributes
    ----------
    grid : Grid
    t : (S,) array, s
    displacement : (S, N, 3) array, m
    von_mises : mapping of a face's name to (S, C) array
        Von Mises stress in Pa on that face of the cells; empty where no stress is known.
    stress : mapping of a face and a component to (S, C) array
        Signed stress in Pa where the von Mises stress is largest in the cell; empty unless the scene asks for it.
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
        """Write all fields to a compressed npz file."""
        npz.write(file, npz.record_arrays(self), compressed=True)

    @classmethod
    def load(cls, file: Path) -> Fields:
        """Return the fields in a file that `save` wrote."""
        data = npz.read(file, MOST_EXPANSION, ROOM)
        return npz.record_from_arrays(
            cls, npz.rename_keys(data, {"region.": "grid.regions."})
        )  # as version 0.1 wrote them


@dataclass(frozen=True)
class Frames:
    """Names of F frames and their origins `points` (F, 3) in m."""

    names: tuple[str, ...]
    points: Array


@dataclass(frozen=True)
class FramedBody:
    """A body M y'' + C y' + K y = f on F frames, of which the first is the ground.

    The coordinates y (6 F + m) are three displacements (m) and three rotations (rad) of each frame, then m modes.  The
    ground frame carries the pads and supports, at the path coordinate s.

    Attributes
    ----------
    s : float, m
        Path coordinate at which the sliders are held.
    frames : Frames
    M, C, K : (6 F + m, 6 F + m) arrays, symmetric, SI units
        K leaves six rigid motions of all frames together free.
    """

    s: float
    frames: Frames
    M: Array
    C: Array
    K: Array

    @property
    def modes(self) -> int:
        """Number of modes m."""
        return len(self.M) - 6 * len(self.frames.names)

    @property
    def omega(self) -> Array:
        """Lowest m angular frequencies (m,) in rad/s, ascending, with the ground frame fixed and the others free."""
        values = scipy.linalg.eigh(self.M[6:, 6:], self.K[6:, 6:], eigvals_only=True)[::-1]
        return np.asarray(1.0 / np.sqrt(values[: self.modes]))


@dataclass(frozen=True)
class Places:
    """P named points of a body that loads and other bodies act on: means over groups, or sections of the body.

    Attributes
    ----------
    names : tuple of str
    points : (P, 3) array, m
    displacement, rotation : (P, 3, m) arrays, 1 and 1/m
        Displacement and rotation of each point under each of the body's m modes.
    """

    names: tuple[str, ...]
    points: Array
    displacement: Array
    rotation: Array


@dataclass(frozen=True)
class NodalBody:
    """Mass and stiffness on N nodes with three displacements each, node by node, and m modes of the body.

    Attributes
    ----------
    s : float, m
        Path coordinate at which the sliders are held.
    points : (N, 3) array, m
    M, K : (3 N, 3 N) sparse matrices
        K includes the springs of flexible pads and supports at s; rigid ones are not in K, but the modes satisfy them.
    modes : (3 N, m) array
        Lowest modes at s, M-orthonormal, in 1/sqrt(kg).
    omega : (m,) array, rad/s
        modes^T K modes = diag(omega^2).
    damping : (m, m) array, 1/s
        modes^T D modes; not diagonal, as flexible moving pads have no damping.
    frames : Places
    """

    s: float
    points: Array
    M: sp.csr_matrix
    K: sp.csr_matrix
    modes: Array
    omega: Array
    damping: Array
    frames: Places


@dataclass(frozen=True)
class Pose:
    """Axes that move, at S times.

    Attributes
    ----------
    rotation : (S, 3, 3) array
        Matrix R from components along the moving axes to components in space.
    origin : (S, 3) array, m
        Vector o from the pivot to the origin of the axes, in components along the moving axes.
    """

    rotation: Array
    origin: Array

    def positions(self, points: ArrayLike) -> Array:
        """Return R (p + o) (S, n, 3) in m, positions in space from the pivot, of points p (S, n, 3) or (n, 3) in m.

        The points are in components along the moving axes, from their origin.
        """
        from_pivot = np.asarray(points, float) + self.origin[:, None, :]
        return np.asarray(np.einsum("sij,snj->sni", self.rotation, from_pivot))

    def positions_at(self, k: int, points: ArrayLike) -> Array:
        """Return R (p + o) (..., 3) in m, positions in space at time number k, of points p (..., 3) in m.

        The points are in components along the moving axes, from their origin.
        """
        return self.rotate_at(k, np.asarray(points, float) + self.origin[k])

    def rotate_at(self, k: int, vectors: ArrayLike) -> Array:
        """Return R v (..., 3), in components in space at time number k, of vectors v (..., 3) along the moving axes."""
        return np.asarray(np.asarray(vectors, float) @ self.rotation[k].T)
