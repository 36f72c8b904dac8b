r"""Stresses of a shell on flat triangles, from the strains of its weak form.

.. math::
    \sigma(\zeta) = A : (\varepsilon - \zeta \kappa), \qquad -t/2 \le \zeta \le t/2

zeta counts along the normal n; a rotation theta moves the fibre by zeta theta x n.  On a triangle the curvature is
constant and the membrane strain linear.  Both are taken at the centroid, where the latter equals its mean over the
triangle: values on the edges are one order less accurate.  Transverse shear vanishes at both faces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.fem.compat import cell_topology, lagrange_rule
from pmr.fields.stress import PLANE, StressRows
from pmr.mesh.named import NamedMesh
from pmr.mesh.nodes import Nodes
from pmr.mesh.sides import body_axis, outward
from pmr.scene.structures import Plate

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

FACES = ("outer", "middle", "inner")
#: Cosine between a triangle's normal and the body's axis from which on the triangle lies across it.
ACROSS = 0.9


@dataclass(frozen=True)
class SurfaceStrains:
    """Strains at q quadrature points of each of C triangles: 11, 22 and twice 12 in the triangle's frame.

    Attributes
    ----------
    membrane, curvature : (C, q, 3, d) arrays
        Entries on the coordinates that each triangle has, in 1/m and 1/m or 1/m^2.
    coordinates : (C, d) integer array
    points : (C, q, 3) array, m
    weights : (C, q) array, m^2
    frames : (C, 3, 3) array
        Rows are unit vectors: along the body's axis, across it in the plane, normal.
    """

    membrane: Array
    curvature: Array
    coordinates: Indices
    points: Array
    weights: Array
    frames: Array


def stress_rows(mesh: NamedMesh, nodes: Nodes, plates: Sequence[Plate]) -> StressRows:
    """Plane stress at the centroid of each triangle: on the outer face, the middle (membrane) and the inner face."""
    strains = surface_strains(mesh, nodes, degree=1)
    stiffness = np.array([plane_stiffness(plate) for plate in plates])
    half = np.array([plate.thickness for plate in plates])[:, None, None] / 2.0
    membrane, bent = (stiffness @ part[:, 0] for part in (strains.membrane, strains.curvature))
    entries = np.stack([membrane - half * bent, membrane, membrane + half * bent])
    offsets = np.array([1.0, 0.0, -1.0])[:, None, None] * half[:, 0] * strains.frames[:, 2]
    cells, (count, width) = len(mesh.cells), strains.coordinates.shape
    columns = np.broadcast_to(strains.coordinates[:, None], entries.shape)
    ends = np.arange(0, entries.size + 1, width)
    return StressRows(
        rows=sp.csr_matrix((entries.ravel(), columns.ravel(), ends), (9 * count, nodes.size)),
        mises=PLANE,
        components=("along", "across", "shear"),
        points=(strains.points[:, 0] + offsets).reshape(-1, 3),
        cell=np.tile(np.arange(cells), 3),
        faces=FACES,
        face=np.repeat(np.arange(3), cells),
    )


def surface_strains(mesh: NamedMesh, nodes: Nodes, degree: int) -> SurfaceStrains:
    """Strains at the points of a quadrature rule of the given degree."""
    weights, _, quadratic = lagrange_rule("triangle", 2, degree)
    _, linear, slopes = lagrange_rule("triangle", 1, degree)
    corners = mesh.points[mesh.cells]
    J = np.einsum("dk,cki->cid", slopes[:, 0], corners)
    frames = _frames(mesh, corners, np.cross(J[..., 0], J[..., 1]))
    gradient = frames[:, :2] @ J @ np.linalg.inv(np.einsum("cid,cie->cde", J, J))
    of_u = np.einsum("cad,dqk->cqak", gradient, quadratic)
    opposite = [next(v for v in range(3) if v not in edge) for edge in cell_topology("triangle")[1]]
    of_theta = np.einsum("cad,dk->cak", gradient, -2.0 * slopes[:, 0, opposite])  # Crouzeix-Raviart: 1 - 2 lambda
    of_theta = np.broadcast_to(of_theta[:, None], (*of_u.shape[:2], *of_theta.shape[1:]))
    e1, e2 = frames[:, 0], frames[:, 1]
    coordinates = nodes.per_component(np.arange(len(mesh.cells)))
    membrane, curvature = _strain(of_u, e1, e2), _strain(of_theta, -e2, e1)  # n x theta = -theta_2 e_1 + theta_1 e_2
    return SurfaceStrains(
        membrane=np.pad(membrane, [(0, 0)] * 3 + [(0, curvature.shape[3])]),
        curvature=np.pad(curvature, [(0, 0)] * 3 + [(membrane.shape[3], 0)]),
        coordinates=np.concatenate(coordinates, axis=1),
        points=np.einsum("qk,cki->cqi", linear, corners),
        weights=np.sqrt(np.linalg.det(np.einsum("cid,cie->cde", J, J)))[:, None] * weights,
        frames=frames,
    )


def plane_stiffness(plate: Plate) -> Array:
    """A of plane stress (3, 3) in Pa, for strains 11, 22 and twice 12."""
    E, nu = plate.material.young, plate.material.poisson
    return E / (1.0 - nu**2) * np.array([[1.0, nu, 0.0], [nu, 1.0, 0.0], [0.0, 0.0, (1.0 - nu) / 2.0]])


def _frames(mesh: NamedMesh, corners: Array, normals: Array) -> Array:
    """Frames (C, 3, 3); where the body's axis is across a triangle, the next one in space takes its place."""
    n = outward(mesh, corners.mean(axis=1), normals / np.linalg.norm(normals, axis=1)[:, None])
    axis = body_axis(mesh)
    along = np.eye(3)[np.where(np.abs(n[:, axis]) > ACROSS, (axis + 1) % 3, axis)]
    e1 = along - np.sum(along * n, axis=1)[:, None] * n
    e1 /= np.linalg.norm(e1, axis=1)[:, None]
    return np.stack([e1, np.cross(n, e1), n], axis=1)


def _strain(gradient: Array, a: Array, b: Array) -> Array:
    """Symmetric gradient (C, q, 3, 3 k) of the in-plane field with the components a and b of a vector's."""
    g1, g2 = gradient[:, :, 0, None, :], gradient[:, :, 1, None, :]
    a, b = a[:, None, :, None], b[:, None, :, None]
    rows = np.stack([a * g1, b * g2, a * g2 + b * g1], axis=2)
    return rows.reshape(*rows.shape[:3], -1)
