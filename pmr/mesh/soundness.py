"""What makes a mesh unfit for a structure: degenerate, inverted, folded or unconnected cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from pmr.fem.compat import cell_topology
from pmr.mesh.nodes import codes

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Cells with less than this share of the volume (area) of a regular cell of their size count as degenerate.
DEGENERATE = 1e-6
#: Neighbouring triangles that enclose less than some 8 degrees lie on top of each other.
FOLDED = -0.99


def unsound(cell: str, points: Array, cells: Indices) -> str:
    """Describe in words why the mesh is unsound; an empty text if it is sound."""
    corners = points[cells]
    size = np.linalg.norm(np.ptp(corners, axis=1), axis=1)
    if cell == "triangle":
        content = np.linalg.norm(_normals(corners), axis=1) / size**2
    else:
        content = _corner_volumes(cell, corners).min(axis=1) / size**3
    inverted, flat = int(np.sum(content < -DEGENERATE)), int(np.sum(np.abs(content) <= DEGENERATE))
    if flat:
        return f"{flat} of {len(cells)} cells are degenerate, without area or volume"
    if inverted:
        return f"{inverted} of {len(cells)} cells are inverted (negative volume at a corner)"
    facets = cells[:, cell_topology(cell)[-2]]
    facet_codes = codes(np.sort(facets.reshape(-1, facets.shape[-1]), axis=1), len(points)).reshape(len(cells), -1)
    parts, sizes = _parts(facet_codes)
    if parts > 1:
        shown = ", ".join(map(str, sizes[:4])) + (", ..." if parts > 4 else "")
        where = "edges" if cell == "triangle" else "faces"
        return f"the cells form {parts} parts that share no {where} (of {shown} cells); one connected body is allowed"
    folded = _count_folds(corners, cells, facet_codes) if cell == "triangle" else 0
    return f"{folded} pairs of neighbouring triangles lie folded on each other" if folded else ""


def _normals(corners: Array) -> Array:
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2.0


def _corner_volumes(cell: str, corners: Array) -> Array:
    """Triple products of the edges at each corner (C, k), positive for the file's orientation, all of them."""
    if cell == "tetrahedron":
        at = np.array([[0, 1, 2, 3]])
    else:  # neighbours of each vertex along the axes of the tensor product, as a right-handed triple
        triples = [[v, v ^ 1, v ^ 2, v ^ 4] for v in range(8)]
        at = np.array([t if bin(t[0]).count("1") % 2 == 0 else [t[0], t[2], t[1], t[3]] for t in triples])
    o = corners[:, at[:, 0]]
    a, b, c = (corners[:, at[:, i]] - o for i in (1, 2, 3))
    return np.asarray(np.einsum("cki,cki->ck", np.cross(a, b), c))


def _parts(facet_codes: Indices) -> tuple[int, list[int]]:
    """Number of parts that are connected through facets, and how many cells each has, largest first."""
    count, per_cell = facet_codes.shape
    _, facet = np.unique(facet_codes, return_inverse=True)
    facet = facet.reshape(-1)
    incidence = coo_matrix((np.ones(facet.size), (np.repeat(np.arange(count), per_cell), facet))).tocsr()
    parts, label = connected_components(incidence @ incidence.T, directed=False)
    return int(parts), sorted(np.bincount(label).tolist(), reverse=True)


def _count_folds(corners: Array, cells: Indices, edge_codes: Indices) -> int:
    """Pairs of triangles on one edge whose third corners lie on the same side of it."""
    opposite = np.tile(np.arange(3), len(cells))  # edge i of the reference triangle lies opposite vertex i
    triangle = np.repeat(np.arange(len(cells)), 3)
    order = np.argsort(edge_codes.ravel(), kind="stable")
    code = edge_codes.ravel()[order]
    first = np.flatnonzero(code[:-1] == code[1:])
    sides = []
    for which in (order[first], order[first + 1]):
        c, k = triangle[which], opposite[which]
        tip, a, b = corners[c, k], corners[c, (k + 1) % 3], corners[c, (k + 2) % 3]
        edge = (b - a) / np.linalg.norm(b - a, axis=1)[:, None]
        away = tip - a
        away -= np.einsum("ci,ci->c", away, edge)[:, None] * edge
        sides.append(away / np.linalg.norm(away, axis=1)[:, None])
    return int(np.sum(np.einsum("ci,ci->c", *sides) > -FOLDED))
