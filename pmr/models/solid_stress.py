r"""Stresses of a solid, from the strains of its weak form: on its surface, and in the middle of each cell.

.. math::
    \sigma = \lambda\, \mathrm{tr}\, \varepsilon\, I + 2 \mu\, \varepsilon, \qquad
    \varepsilon = \mathrm{sym}\, \nabla u

Strains of quadratic elements are most accurate at Gauss' points, two in each direction of a hexahedron (Barlow:
Optimal stress locations in finite element models, International Journal for Numerical Methods in Engineering 10, 1976,
243-251), four in a tetrahedron.  From there they are continued linearly to the middle of each facet that belongs to the
surface, so that the bending of a wall with a single cell across shows on both of its faces; in the middle of a cell
they are the mean over its points, in a wall the membrane stress.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.fem.compat import lagrange_rule
from pmr.fields.stress import SPATIAL, StressRows
from pmr.mesh.named import NamedMesh
from pmr.mesh.nodes import Nodes
from pmr.mesh.sides import away, skin
from pmr.scene.structures import Material

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

FACES = ("outer", "middle", "inner")
#: Degree of the rule whose points are two in each direction, or four.
DEGREE = {"hexahedron": 3, "tetrahedron": 2}
#: Twice the shear strains yz, xz, xy, by the two derivatives that they are made of.
SHEARS = ((1, 2), (0, 2), (0, 1))


@dataclass(frozen=True)
class Gradients:
    """Derivatives (C, q, 3, k) in 1/m of each cell's k functions at q quadrature points.

    `weights` (C, q) are in m^3, `points` (C, q, 3) in m; `vertices` (q, v) are the cell's linear functions there.
    """

    values: Array
    weights: Array
    points: Array
    vertices: Array


def stress_rows(mesh: NamedMesh, nodes: Nodes, materials: Sequence[Material]) -> StressRows:
    """Stresses xx, yy, zz, yz, xz, xy on outer facets, in the middle of the cells, on facets that look to the axis."""
    gradients, surface = cell_gradients(mesh, DEGREE[mesh.cell]), skin(mesh)
    continued = np.linalg.inv(gradients.vertices)  # from the points to the vertices
    of_cell = np.mean(continued, axis=0)
    at_vertex = (surface.vertices[:, :, None] == mesh.cells[surface.cell][:, None, :]).any(axis=1)
    of_facet = (at_vertex / at_vertex.sum(axis=1, keepdims=True)) @ continued
    values = gradients.values
    middle = np.einsum("q,cqik->cik", of_cell, values)
    shown = np.einsum("fq,fqik->fik", of_facet, values[surface.cell])
    cell = np.concatenate([surface.cell, np.arange(len(mesh.cells))])
    at = mesh.points[surface.vertices].mean(axis=1)
    inner = away(mesh, at, surface.normals) < 0.0
    face = np.concatenate([np.where(inner, FACES.index("inner"), 0), np.full(len(mesh.cells), FACES.index("middle"))])
    stiffness = np.array([isotropic_stiffness(m) for m in materials])
    entries = stiffness[cell] @ strain_entries(np.concatenate([shown, middle]))
    coordinates = np.concatenate(nodes.per_component(np.arange(len(mesh.cells))), axis=1)[cell]
    columns = np.broadcast_to(coordinates[:, None], entries.shape)
    ends = np.arange(0, entries.size + 1, entries.shape[2])
    rows = sp.csr_matrix((entries.ravel(), columns.ravel(), ends), (6 * len(cell), nodes.size))
    rows.eliminate_zeros()
    return StressRows(
        rows=rows,
        mises=SPATIAL,
        components=("xx", "yy", "zz", "yz", "xz", "xy"),
        points=np.concatenate([at, mesh.points[mesh.cells].mean(axis=1)]),
        cell=cell,
        faces=tuple(name for k, name in enumerate(FACES) if np.any(face == k)),
        face=np.unique(face, return_inverse=True)[1],
    )


def cell_gradients(mesh: NamedMesh, degree: int) -> Gradients:
    """Derivatives of the quadratic functions at the points of a quadrature rule of the given degree."""
    weights, _, slopes = lagrange_rule(mesh.cell, 2, degree)
    _, linear, corners = lagrange_rule(mesh.cell, 1, degree)
    places = mesh.points[mesh.cells]
    J = np.einsum("dqk,cki->cqid", corners, places)
    values = np.einsum("cqdi,dqk->cqik", np.linalg.inv(J), slopes)
    points = np.einsum("qk,cki->cqi", linear, places)
    return Gradients(values, np.abs(np.linalg.det(J)) * weights, points, linear)


def strain_entries(gradients: Array) -> Array:
    """Strains xx, yy, zz and twice yz, xz, xy as entries (..., 6, 3 k) on u_x, u_y, u_z of k functions."""
    k = gradients.shape[-1]
    entries = np.zeros((*gradients.shape[:-2], 6, 3, k))
    for i in range(3):
        entries[..., i, i, :] = gradients[..., i, :]
    for row, (i, j) in enumerate(SHEARS, 3):
        entries[..., row, i, :], entries[..., row, j, :] = gradients[..., j, :], gradients[..., i, :]
    return entries.reshape(*entries.shape[:-2], 3 * k)


def isotropic_stiffness(material: Material) -> Array:
    """Hooke's law (6, 6) in Pa, for shear strains counted twice."""
    E, nu = material.young, material.poisson
    lame, mu = E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), material.shear_modulus
    stiffness = np.diag(np.repeat([2.0 * mu, mu], 3))
    stiffness[:3, :3] += lame
    return stiffness
