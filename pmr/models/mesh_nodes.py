"""Numbers of a function space's coordinates that depend on the mesh alone, not on MPI ranks or the library's version.

A node sits on each vertex, edge, face or cell that the elements use: P2 triangles have nodes on vertices and edges, Q2
hexahedra on all four.  Nodes are ordered by their vertices, which are numbered along the mesh's longest extent; the
coordinates of a node have consecutive numbers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pmr.fem.compat import cell_topology
from pmr.files.arrays import Array, Indices


def codes(entities: Indices, points: int) -> Indices:
    """Number (e,) that identifies each of the `entities` (e, k), made from its three lowest vertices.

    The vertices of each entity must be sorted.  Any two vertices, edges or faces of a mesh have different numbers, but
    two cells may have the same.  `points` is the number of the mesh's vertices.
    """
    code = np.zeros(len(entities), np.int64)
    for column in range(3):
        code = code * (points + 1) + (entities[:, column] + 1 if column < entities.shape[1] else 0)
    return code


@dataclass(frozen=True)
class Nodes:
    """Nodes of a function space on a mesh, and the numbers of their coordinates."""

    # by dimension of the entities: the components that their nodes carry
    components: Mapping[int, tuple[int, ...]]
    codes: Mapping[int, Indices]  # (e,): by dimension, ascending codes of the entities
    first: Mapping[int, Indices]  # (e,): by dimension, first coordinate of each entity's node
    in_cell: Mapping[int, Indices]  # (C, k): by dimension, each cell's entities in the order of the reference cell
    points: Array  # (n, 3) m: position of each coordinate's node
    component: Indices  # (n,): 0, 1, 2 for displacements along x, y, z; 3, 4, 5 for rotations

    @property
    def size(self) -> int:
        """Number of coordinates n."""
        return len(self.component)

    def first_coordinates(self, entities: Indices, dim: int, points: int) -> Indices:
        """Number (e,) of the first coordinate of the node on each of e entities, given by their vertices (e, k).

        `dim` is the dimension of the entities and `points` the number of the mesh's vertices.  Raises a `KeyError` if
        one of the entities is no entity of the mesh.
        """
        entity_codes = codes(np.sort(entities, axis=1), points)
        place = np.clip(np.searchsorted(self.codes[dim], entity_codes), 0, len(self.codes[dim]) - 1)
        absent = self.codes[dim][place] != entity_codes
        if np.any(absent):
            raise KeyError(f"{np.sum(absent)} of {len(entity_codes)} entities are not part of any cell")
        return self.first[dim][place]


def number_nodes(cell: str, points: Array, cells: Indices, components: Mapping[int, tuple[int, ...]]) -> Nodes:
    """Number the nodes of a function space on a mesh with the vertices `points` (N, 3) and `cells` of the kind `cell`.

    `cells` (C, k) are the vertices of the cells in dolfinx' order.  `components` says for each dimension of entities
    which components their nodes carry.  Dimensions without nodes are left out of it.
    """
    topology = cell_topology(cell)
    code, in_cell, keys, places = {}, {}, [], []
    for dim in sorted(components):
        vertices = np.sort(cells[:, topology[dim]], axis=-1)
        flat = vertices.reshape(-1, vertices.shape[-1])
        # two cells may share their three lowest vertices, so that cells have their numbers as codes
        number = np.arange(len(cells), dtype=np.int64) if dim == 3 else codes(flat, len(points))
        code[dim], once, inverse = np.unique(number, return_index=True, return_inverse=True)
        in_cell[dim] = inverse.reshape(vertices.shape[:2])
        places.append(points[flat[once]].mean(axis=1))
        padded = np.full((len(once), cells.shape[1]), -1, np.int64)
        padded[:, : flat.shape[1]] = flat[once]
        keys.append(padded)
    carried = np.concatenate([np.full(len(code[dim]), len(components[dim])) for dim in sorted(components)])
    order = np.lexsort(np.concatenate(keys).T[::-1])
    start = np.empty(len(order), np.int64)
    start[order] = np.cumsum(carried[order]) - carried[order]
    split = np.split(start, np.cumsum([len(code[dim]) for dim in sorted(components)])[:-1])
    first = dict(zip(sorted(components), split, strict=True))
    at, component = np.empty((carried.sum(), 3)), np.empty(carried.sum(), np.int64)
    for dim, place in zip(sorted(components), places, strict=True):
        for i, c in enumerate(components[dim]):
            at[first[dim] + i], component[first[dim] + i] = place, c
    return Nodes(components, code, first, in_cell, at, component)
