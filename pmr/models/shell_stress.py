r"""Stresses of a shell on flat triangles, from the strains of its weak form.

.. math::
    \sigma(\zeta) = A : (\varepsilon - \zeta \kappa), \qquad -t/2 \le \zeta \le t/2

zeta counts along the normal n; a rotation theta moves the fibre by zeta theta x n.  On a triangle the curvature is
constant and the membrane strain linear.  Both are taken at the centroid, where the latter equals its mean over the
triangle: values on the edges are one order less accurate.  Transverse shear vanishes at both faces.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.fields.stress import PLANE, StressRows
from pmr.mesh.named import NamedMesh
from pmr.mesh.sides import body_axis, outward
from pmr.models.tabulation import CellValues, as_rows

Array = NDArray[np.float64]

FACES = ("outer", "middle", "inner")
#: Cosine between a triangle's normal and the body's axis from which on the triangle lies across it.
ACROSS = 0.9


def stress_rows(mesh: NamedMesh, thickness: Array, stresses: CellValues, size: int) -> StressRows:
    """Plane stress at the centroid of each triangle: on the outer face, the middle (membrane) and the inner face.

    Parameters
    ----------
    mesh : NamedMesh
    thickness : (C,) array, m
    stresses : CellValues
        A : epsilon in Pa, then A : kappa in Pa/m, at the centroid; along, across and shear of `frames`.
    size : int
        Number of the model's coordinates.
    """
    half = thickness / 2.0
    membrane, bent = stresses.entries[:, 0, :3], half[:, None, None] * stresses.entries[:, 0, 3:]
    entries = np.concatenate([membrane - bent, membrane, membrane + bent])
    offsets = np.array([1.0, 0.0, -1.0])[:, None, None] * half[:, None] * frames(mesh)[:, 2]
    cells = len(mesh.cells)
    return StressRows(
        rows=as_rows(entries, np.tile(stresses.coordinates, (3, 1)), size),
        mises=PLANE,
        components=("along", "across", "shear"),
        points=(mesh.points[mesh.cells].mean(axis=1) + offsets).reshape(-1, 3),
        cell=np.tile(np.arange(cells), 3),
        faces=FACES,
        face=np.repeat(np.arange(3), cells),
    )


def frames(mesh: NamedMesh) -> Array:
    """Unit vectors (C, 3, 3) of each triangle: along the body's axis, across it in the plane, normal, outward.

    Where the body's axis is across a triangle, the next one in space takes its place.
    """
    corners = mesh.points[mesh.cells]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    n = outward(mesh, corners.mean(axis=1), normals / np.linalg.norm(normals, axis=1)[:, None])
    axis = body_axis(mesh)
    along = np.eye(3)[np.where(np.abs(n[:, axis]) > ACROSS, (axis + 1) % 3, axis)]
    e1 = along - np.sum(along * n, axis=1)[:, None] * n
    e1 /= np.linalg.norm(e1, axis=1)[:, None]
    return np.stack([e1, np.cross(n, e1), n], axis=1)
