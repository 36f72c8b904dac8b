"""Meshes of surfaces and solids with named groups, read through meshio and checked before anything is built on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.errors.text import NAMED, is_name
from pmr.fem.compat import MPI, create_mesh
from pmr.mesh.files import read_mesh_file
from pmr.mesh.soundness import unsound

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: meshio's linear cells: dolfinx' name, dimension, order of vertices (dolfinx numbers them as a tensor product).
KINDS = {
    "vertex": ("point", 0, [0]),
    "line": ("interval", 1, [0, 1]),
    "triangle": ("triangle", 2, [0, 1, 2]),
    "quad": ("quadrilateral", 2, [0, 1, 3, 2]),
    "tetra": ("tetrahedron", 3, [0, 1, 2, 3]),
    "hexahedron": ("hexahedron", 3, [0, 1, 3, 2, 4, 5, 7, 6]),
}


@dataclass(frozen=True)
class Group:
    """Named points, lines, faces or cells: their dimension and vertices (e, k) in dolfinx' order."""

    dim: int
    entities: Indices


@dataclass(frozen=True)
class NamedMesh:
    """A mesh in space of one kind of linear cells, the same on every rank.

    Vertices are numbered along the longest extent, so that consecutive numbers are neighbours.
    """

    cell: str  # ``"triangle"``, ``"tetrahedron"`` or ``"hexahedron"``
    points: Array  # (N, 3) m
    cells: Indices  # (C, k): vertices in dolfinx' order
    groups: Mapping[str, Group]
    regions: Mapping[str, Indices]  # groups of cells, as numbers (c,) of cells
    source: str = "mesh"  # where the mesh is from, for messages

    @cached_property
    def axis(self) -> int:
        """0, 1 or 2 for x, y or z: along the longest extent."""
        return int(np.ptp(self.points, axis=0).argmax())

    @cached_property
    def spans(self) -> tuple[Array, Array]:
        """Beginning and end of each cell along the axis, (C,) m each."""
        x = self.points[:, self.axis][self.cells]
        return x.min(axis=1), x.max(axis=1)

    def distribute(self, comm: MPI.Comm) -> Any:
        """The mesh in dolfinx, spread over `comm`; collective."""
        return create_mesh(comm, self.cell, self.points, self.cells)

    def require(self, names: Sequence[str]) -> None:
        """Refuse the mesh if a named group is missing.

        Raises an `InputError` with the groups that were found.
        """
        missing = [name for name in names if name not in self.groups]
        if missing:
            names_there = ", ".join(sorted(self.groups)) or "none"
            raise InputError(self.source, "", None, f"no group named {', '.join(missing)}; found: {names_there}")


def read_mesh(file: Path, kinds: Sequence[str], groups: Sequence[str] = ()) -> NamedMesh:
    """Read a mesh from any file that meshio reads; groups are gmsh's physical groups.

    Parameters
    ----------
    kinds : sequence of str
        Cells that the model allows, in dolfinx' words, e.g. ``("triangle",)``.
    groups : sequence of str
        Groups that must be there.

    Raises
    ------
    InputError
        If cells are of another kind, of mixed kinds or of higher order, inverted, degenerate or unconnected, or if a
        group is missing; the message says what was found.
    """
    read = read_mesh_file(file)
    blocks = [(*KINDS[block.kind][:2], block.corners[:, KINDS[block.kind][2]]) for block in read.blocks]
    named = named_mesh(read.points, blocks, read.groups, kinds, str(file))
    named.require(groups)
    return named


def named_mesh(
    points: Array,
    blocks: Sequence[tuple[str, int, Indices]],
    memberships: Mapping[str, Sequence[Indices]],
    kinds: Sequence[str],
    source: str = "mesh",
) -> NamedMesh:
    """A checked mesh from blocks (cell kind, dimension, vertices) and, for each group, its members in every block.

    Raises an `InputError` as `read_mesh`.
    """

    def refuse(what: str) -> InputError:
        return InputError(source, "", None, f"{what}; cells of kind {' or '.join(kinds)} are allowed")

    top = max((dim for _, dim, _ in blocks), default=0)
    cell_kinds = sorted({kind for kind, dim, _ in blocks if dim == top})
    if len(cell_kinds) > 1:
        raise refuse(f"mixed cells: {', '.join(cell_kinds)}")
    if not cell_kinds or cell_kinds[0] not in kinds:
        raise refuse(f"cells of kind {cell_kinds[0] if cell_kinds else 'none'}")
    listed = np.concatenate([vertices for _, dim, vertices in blocks if dim == top])
    # Files of some formats list a cell once for each group that it belongs to.
    _, first, cell_of = np.unique(np.sort(listed, axis=1), axis=0, return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))
    cells, cell_of = listed[np.sort(first)], order[cell_of.reshape(-1)]
    used = np.unique(cells)
    if not np.isfinite(points[used]).all():
        raise refuse("coordinates that are not finite")
    extent = np.ptp(points[used], axis=0)
    x = points[used][:, extent.argmax()]
    ordered = used[np.argsort(np.round(x / (1e-9 * extent.max())), kind="stable")]
    number = np.full(len(points), -1, np.int64)
    number[ordered] = np.arange(len(ordered))
    points, cells = np.ascontiguousarray(points[ordered]), number[cells]
    problem = unsound(cell_kinds[0], points, cells)
    if problem:
        raise InputError(source, "", None, problem)
    offsets = np.cumsum([0] + [len(vertices) if dim == top else 0 for _, dim, vertices in blocks])
    groups, regions = {}, {}
    for name, members in memberships.items():
        if not is_name(name):
            raise InputError(source, "groups", name, NAMED)
        parts = [(b, np.asarray(m, np.int64)) for b, m in enumerate(members) if len(m)]
        dims = {blocks[b][1] for b, _ in parts}
        if len(dims) != 1:
            held = "entities of several dimensions" if dims else "no cells; gmsh with Mesh.SaveAll leaves groups out"
            raise InputError(source, "", None, f"group {name} holds {held}")
        vertices = number[np.concatenate([blocks[b][2][m] for b, m in parts])]
        if np.any(vertices < 0):
            raise InputError(source, "", None, f"group {name} has {np.sum(vertices < 0)} points that no cell uses")
        groups[name] = Group(dims.pop(), vertices)
        if groups[name].dim == top:
            regions[name] = np.unique(cell_of[np.concatenate([offsets[b] + m for b, m in parts])])
            groups[name] = Group(top, cells[regions[name]])
    return NamedMesh(cell_kinds[0], points, cells, groups, regions, source)
