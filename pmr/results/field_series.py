r"""Grids and fields on them at several times, pads around them, moving axes, and flexible bodies for other programs.

Let r be a point and u its displacement, both in components along moving axes.  Let R(t) be the rotation of these axes
at the time t, and o(t) the vector from the pivot to their origin, in components along them.  In space, the point is at
X and its displacement is U:

.. math:: X = R(t)\, (o(t) + r), \qquad U = R(t)\, u

A body whose sliders are held at one path coordinate is exported either on frames (superelements, `FramedBody`) or on
nodes (`NodalBody`).
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
from pmr.files.arrays import Array, Indices
from pmr.scene.box import Box
from pmr.scene.built import Face, PadRing

Single = NDArray[np.float32]
MOST_EXPANSION = 100.0  # largest size of fields as a multiple of their compressed file; moving fields take 4/3 of it
ROOM = 2**28  # bytes that fields may take whatever the size of their file; fields at rest take up to 1000 times of it
THICK = 0.025  # m, thickness of a pad in drawings: the gap between both sections
#: Corners of the unit cube in VTK's order of a hexahedron.
CUBE = np.array([(x, y, z) for z in (0.0, 1.0) for x, y in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))])


@dataclass(frozen=True)
class Grid:
    """Grid of cells of one kind in space, with N points and C cells.

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

    def region_names(self, cell: int) -> str:
        """Return the names of the regions that contain the cell number `cell`, in alphabetical order, joined by commas.

        The text is empty if no region contains this cell.
        """
        return ", ".join(sorted(name for name, cells in self.regions.items() if cell in cells))


@dataclass(frozen=True)
class Boxes:
    """P boxes that are drawn with a body at S times, such as its pads.

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


def pad_corners(ring: PadRing, place: tuple[str, Face, float], body: Array, box: Box | None, cube: Array) -> Array:
    """Return the k corners (k, 3) in m of a pad of `ring` at s = 0: a plate on a face of a body.

    `cube` (k, 3) are the corners of a unit cube, which is moved and scaled to become the pad.  `place` has the pad's
    name, its face and its position in m across the face.  `body` (2, 3) are the least and the largest coordinates of
    the body in m.  The faces bottom and top are normal to z, right and left are normal to y; all other faces are
    slanted faces of `box`, which is None for a body without such faces.
    """
    _, face, across = place
    size, local = np.array([ring.length, ring.width, THICK]), cube - [0.5, 0.5, 0.0]
    if box is not None and " " in face:  # the face is slanted
        side = box.faces[face]
        along, out = ([0.0, *pair] for pair in (side.across_direction, side.normal))
        reach = float(side.normal @ side.start) + side.thickness / 2.0
        centre = np.array([ring.at, *(across * side.across_direction + reach * side.normal)])
    else:
        normal, tangent = (2, 1) if face in ("bottom", "top") else (1, 2)
        outwards = -1.0 if face in ("bottom", "right") else 1.0
        along, out = np.eye(3)[tangent], outwards * np.eye(3)[normal]
        centre = body.mean(axis=0) + across * along
        centre[0], centre[normal] = ring.at, (body[0] if outwards < 0.0 else body[1])[normal]
    return np.asarray(centre + (local * size) @ np.array([[1.0, 0.0, 0.0], along, out]))


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
    stress : mapping of ``"FACE COMPONENT"`` to (S, C) array
        Signed component of stress in Pa, at the point of each cell where the von Mises stress is largest; empty unless
        the scene asks for it.
    """

    grid: Grid
    t: Array
    displacement: Single
    von_mises: Mapping[str, Single]
    stress: Mapping[str, Single] = field(default_factory=dict)

    @property
    def points(self) -> Array:
        """Points (N, 3) of the grid in m."""
        return self.grid.points

    @property
    def cells(self) -> Indices:
        """Indices (C, k) of the k points of each cell of the grid, in VTK's order."""
        return self.grid.cells

    @property
    def kind(self) -> str:
        """Kind of the grid's cells: ``line``, ``triangle``, ``tetra`` or ``hexahedron``."""
        return self.grid.cell

    def save(self, file: Path) -> None:
        """Write all fields to a compressed npz file."""
        npz.write(file, npz.record_arrays(self), compressed=True)

    @classmethod
    def load(cls, file: Path) -> Fields:
        """Return the fields from a file that `save` wrote."""
        data = npz.rename_keys(npz.read(file, MOST_EXPANSION, ROOM), {"region.": "grid.regions."})  # an earlier name
        return npz.record_from_arrays(cls, data)


@dataclass(frozen=True)
class Frames:
    """Names of F frames and their origins `points` (F, 3) in m."""

    names: tuple[str, ...]
    points: Array


@dataclass(frozen=True)
class FramedBody:
    """A body with mass M, damping C and stiffness K on F frames, of which the first one is the ground.

    Its coordinates y are three displacements (in m) and three rotations (in rad) of each frame, then the amplitudes of
    m modes: 6 F + m in all.  With the forces f on them the body moves by M y'' + C y' + K y = f.  The ground frame
    carries the pads and supports, at the path coordinate s.

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
        """Lowest m angular frequencies (m,) in rad/s, ascending, with the ground frame fixed and all others free."""
        values = scipy.linalg.eigh(self.M[6:, 6:], self.K[6:, 6:], eigvals_only=True)[::-1]
        return np.asarray(1.0 / np.sqrt(values[: self.modes]))


@dataclass(frozen=True)
class Places:
    """P named points at which loads and other bodies act on a body.

    The displacement of such a point is the mean over a group of nodes, or that of a cross-section of the body.

    Attributes
    ----------
    names : tuple of str
    points : (P, 3) array, m
    displacement, rotation : (P, 3, m) arrays
        Displacement and rotation of each point, as m and rad per unit of the coordinate of each of the body's m modes.
    """

    names: tuple[str, ...]
    points: Array
    displacement: Array
    rotation: Array


@dataclass(frozen=True)
class NodalBody:
    """Mass M and stiffness K of a body on N nodes, and m of its modes.

    Each node has three displacements; the coordinates are ordered node by node.

    Attributes
    ----------
    s : float, m
        Path coordinate at which the sliders are held.
    points : (N, 3) array, m
    M, K : (3 N, 3 N) sparse matrices
        K includes the springs of flexible pads and supports at s.  Rigid pads and supports are not in K, but the modes
        satisfy their constraints.
    modes : (3 N, m) array
        Lowest modes at s, M-orthonormal, in 1/sqrt(kg).
    omega : (m,) array, rad/s
        Angular frequencies of the modes: modes^T K modes = diag(omega^2).
    damping : (m, m) array, 1/s
        modes^T D modes with the damping matrix D (3 N, 3 N) of the body.  The product is not diagonal, as flexible
        moving pads have no damping.
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
    """Rotation and origin of moving axes at S times.

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
        """Return the positions in space R (p + o), (S, n, 3) in m from the pivot, of points p (S, n, 3) or (n, 3) in m.

        R is the rotation of the moving axes, and o the vector from the pivot to their origin.  The points are given
        from this origin, in components along the moving axes.
        """
        from_pivot = np.asarray(points, float) + self.origin[:, None, :]
        return np.asarray(np.einsum("sij,snj->sni", self.rotation, from_pivot))

    def positions_at(self, k: int, points: ArrayLike) -> Array:
        """Return the positions in space R (p + o), (..., 3) in m, at time number k, of points p (..., 3) in m.

        R is the rotation of the moving axes, and o the vector from the pivot to their origin.  The points are given
        from this origin, in components along the moving axes; positions are from the pivot.
        """
        return self.rotate_at(k, np.asarray(points, float) + self.origin[k])

    def rotate_at(self, k: int, vectors: ArrayLike) -> Array:
        """Return R v (..., 3), the components in space at time number k of vectors v (..., 3).

        R is the rotation of the moving axes, along which the components of the vectors are given.
        """
        return np.asarray(np.asarray(vectors, float) @ self.rotation[k].T)


def mean_by_place(x: Array, values: Array) -> tuple[Array, Array]:
    """Return the different places of x (P,) in m, ascending (p,), and the mean (S, p) of values (S, P) at each place.

    Places are rounded to 1e-9 m.
    """
    places, inverse, counts = np.unique(x.round(9), return_inverse=True, return_counts=True)
    means = sp.csr_matrix((1.0 / counts[inverse], (np.arange(len(x)), inverse)))
    return places, np.asarray(values @ means)
