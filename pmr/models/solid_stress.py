r"""Stresses of a solid: on its surface, and in the middle of each cell.

Strains of quadratic elements are most accurate at Gauss' points, two in each direction of a hexahedron (Barlow:
Optimal stress locations in finite element models, International Journal for Numerical Methods in Engineering 10, 1976,
243-251), four in a tetrahedron.  From there they are continued linearly to the middle of each facet that belongs to the
surface, so that the bending of a wall with a single cell across shows on both of its faces; in the middle of a cell
they are the mean over its points, in a wall the membrane stress.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.fem.compat import lagrange_rule
from pmr.fields.stress import SPATIAL, StressRows
from pmr.mesh.named import NamedMesh
from pmr.mesh.sides import away, skin
from pmr.models.tabulation import CellValues, as_rows

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

FACES = ("outer", "middle", "inner")
#: Degree of the rule whose points are two in each direction, or four.
DEGREE = {"hexahedron": 3, "tetrahedron": 2}


def stress_rows(mesh: NamedMesh, stresses: CellValues, size: int) -> StressRows:
    """Stresses on outer facets, in the middle of the cells, and on facets that look to the axis.

    Parameters
    ----------
    mesh : NamedMesh
    stresses : CellValues
        xx, yy, zz, yz, xz, xy in Pa at the points of the rule of `DEGREE`.
    size : int
        Number of the model's coordinates.
    """
    surface = skin(mesh)
    continued = np.linalg.inv(lagrange_rule(mesh.cell, 1, DEGREE[mesh.cell])[1])  # from the points to the vertices
    of_cell = np.mean(continued, axis=0)
    at_vertex = (surface.vertices[:, :, None] == mesh.cells[surface.cell][:, None, :]).any(axis=1)
    of_facet = (at_vertex / at_vertex.sum(axis=1, keepdims=True)) @ continued
    middle = np.einsum("q,cqvd->cvd", of_cell, stresses.entries)
    shown = np.einsum("fq,fqvd->fvd", of_facet, stresses.entries[surface.cell])
    cell = np.concatenate([surface.cell, np.arange(len(mesh.cells))])
    at = mesh.points[surface.vertices].mean(axis=1)
    inner = away(mesh, at, surface.normals) < 0.0
    face = np.concatenate([np.where(inner, FACES.index("inner"), 0), np.full(len(mesh.cells), FACES.index("middle"))])
    rows = as_rows(np.concatenate([shown, middle]), stresses.coordinates[cell], size)
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
