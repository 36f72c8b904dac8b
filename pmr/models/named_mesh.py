"""Meshes of surfaces and solids with named groups, read from files and checked before anything is built on them.

A mesh is refused if its cells are degenerate, inverted, folded or unconnected.  Faces without a group in the file are
found by their outward normals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pmr.errors import NAMED, InputError, is_name
from pmr.fem.compat import cell_topology
from pmr.files.arrays import Array, Indices, Mask
from pmr.files.cards import Place
from pmr.models.mesh_file import COINCIDENT, DIMENSIONS, read_mesh_file
from pmr.models.mesh_nodes import codes
from pmr.scene.built import FaceNormal

#: Cells with less than this share of the volume (area) of a regular cell of their size count as degenerate.
DEGENERATE = 1e-6
#: Neighbouring triangles that enclose less than some 8 degrees lie on top of each other.
FOLDED = -0.99


@dataclass(frozen=True)
class Fault:
    """Fault of a mesh, in words, and the number of the first cell that has it."""

    text: str
    cell: int


def mesh_fault(cell: str, points: Array, cells: Indices) -> Fault | None:
    """First fault of a mesh of `cells` (C, k) with the vertices `points` (N, 3) in m; None if the mesh is sound.

    The faults are searched for in this order:

    - degenerate cells;
    - inverted cells;
    - several parts that share no face (no edge, if cells are triangles); the cell is the first of the smallest part;
    - neighbouring triangles that are folded on each other.

    `cell` is dolfinx' name of the kind of cells.
    """
    corners = points[cells]
    size = np.linalg.norm(np.ptp(corners, axis=1), axis=1)
    if cell == "triangle":
        content = np.linalg.norm(triangle_normals(corners), axis=1) / size**2
    else:
        content = _corner_volumes(cell, corners).min(axis=1) / size**3
    inverted, flat = content < -DEGENERATE, np.abs(content) <= DEGENERATE
    if flat.any():
        text = f"{flat.sum()} of {len(cells)} cells are degenerate, without area or volume"
        return Fault(text, int(flat.argmax()))
    if inverted.any():
        text = f"{inverted.sum()} of {len(cells)} cells are inverted (negative volume at a corner)"
        return Fault(text, int(inverted.argmax()))
    facets = cells[:, cell_topology(cell)[-2]]
    facet_codes = codes(np.sort(facets.reshape(-1, facets.shape[-1]), axis=1), len(points)).reshape(len(cells), -1)
    part = _connected_parts(facet_codes)
    sizes = np.bincount(part)
    if len(sizes) > 1:
        shown = ", ".join(map(str, sorted(sizes, reverse=True)[:4])) + (", ..." if len(sizes) > 4 else "")
        where = "edges" if cell == "triangle" else "faces"
        text = f"the cells form {len(sizes)} parts that share no {where} (of {shown} cells)"
        return Fault(f"{text}; one connected body is allowed", int((part == sizes.argmin()).argmax()))
    folded = _fold_pairs(corners, cells, facet_codes) if cell == "triangle" else np.empty(0, np.int64)
    if folded.size:
        return Fault(f"{len(folded)} pairs of neighbouring triangles lie folded on each other", int(folded[0]))
    return None


def triangle_normals(corners: Array) -> Array:
    """Normals (C, 3) of C triangles, as long as their areas in m^2, from the first three `corners` (C, k, 3) in m."""
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2.0


def unit_normals(corners: Array) -> Array:
    """Unit normals (C, 3) of C triangles, from the first three `corners` (C, k, 3) in m."""
    normals = triangle_normals(corners)
    return np.asarray(normals / np.linalg.norm(normals, axis=1)[:, None])


def _corner_volumes(cell: str, corners: Array) -> Array:
    """Triple products in m^3 of the three edges at corners of C cells: (C, 8) for hexahedra, (C, 1) for tetrahedra.

    `corners` (C, k, 3) are the positions of the cells' vertices in m.  A hexahedron has a product at each of its
    corners, a tetrahedron at its first one.  All products are positive in a convex cell with the orientation of the
    file's format.
    """
    if cell == "tetrahedron":
        at = np.array([[0, 1, 2, 3]])
    else:  # neighbours of each vertex along the axes of the tensor product, as a right-handed triple
        triples = [[v, v ^ 1, v ^ 2, v ^ 4] for v in range(8)]
        at = np.array([t if bin(t[0]).count("1") % 2 == 0 else [t[0], t[2], t[1], t[3]] for t in triples])
    o = corners[:, at[:, 0]]
    a, b, c = (corners[:, at[:, i]] - o for i in (1, 2, 3))
    return np.asarray(np.einsum("cki,cki->ck", np.cross(a, b), c))


def _connected_parts(facet_codes: Indices) -> Indices:
    """Number (C,) of the part that each of C cells belongs to; cells of different parts share no facet.

    `facet_codes` (C, f) are the codes of the f facets of each cell.
    """
    count, per_cell = facet_codes.shape
    _, facet = np.unique(facet_codes, return_inverse=True)
    facet = facet.reshape(-1)
    incidence = coo_matrix((np.ones(facet.size), (np.repeat(np.arange(count), per_cell), facet))).tocsr()
    return np.asarray(connected_components(incidence @ incidence.T, directed=False)[1], np.int64)


def _fold_pairs(corners: Array, cells: Indices, edge_codes: Indices) -> Indices:
    """Number (k,) of the first triangle of each pair of neighbours that are folded on each other.

    Both triangles of a pair have a common edge and lie on the same side of it.  `corners` (C, 3, 3) are the positions
    and `cells` (C, 3) the vertices of the triangles.  `edge_codes` (C, 3) are the codes of their edges.
    """
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
    return np.asarray(triangle[order[first]][np.einsum("ci,ci->c", *sides) > -FOLDED])


#: meshio's linear cells: dolfinx' name, dimension, order of vertices (dolfinx numbers them as a tensor product).
CELLS_OF_KIND = {
    "vertex": ("point", 0, [0]),
    "line": ("interval", 1, [0, 1]),
    "triangle": ("triangle", 2, [0, 1, 2]),
    "quad": ("quadrilateral", 2, [0, 1, 3, 2]),
    "tetra": ("tetrahedron", 3, [0, 1, 2, 3]),
    "hexahedron": ("hexahedron", 3, [0, 1, 3, 2, 4, 5, 7, 6]),
}


@dataclass(frozen=True)
class Group:
    """Named points, lines, faces or cells: their dimension, 0 to 3, and their vertices (e, k) in dolfinx' order."""

    dim: int
    entities: Indices


@dataclass(frozen=True)
class NamedMesh:
    """A mesh in space of one kind of linear cells, the same on every rank.

    Vertices are numbered along the longest extent, so that vertices with consecutive numbers are near each other.
    """

    cell: str  # ``"triangle"``, ``"tetrahedron"`` or ``"hexahedron"``
    points: Array  # (N, 3) m
    cells: Indices  # (C, k): vertices in dolfinx' order
    groups: Mapping[str, Group]
    regions: Mapping[str, Indices]  # (c,) each: numbers of the cells of each group of cells
    source: str = "mesh"  # where the mesh is from, for messages

    @cached_property
    def axis(self) -> int:
        """Axis of the longest extent: 0, 1 or 2 for x, y or z."""
        return int(np.ptp(self.points, axis=0).argmax())

    @cached_property
    def spans(self) -> Array:
        """Start and end (2, C) in m of each of C cells along the axis."""
        x = self.points[:, self.axis][self.cells]
        return np.array([x.min(axis=1), x.max(axis=1)])

    @cached_property
    def open_seam(self) -> Array:
        """Points (k, 3) m, each listed once, at which several vertices lie.

        The mesh is open there: cells that use different vertices at the same point are not joined.
        """
        pairs = cKDTree(self.points).query_pairs(COINCIDENT * float(np.ptp(self.points, axis=0).max()))
        return self.points[sorted({first for first, _ in pairs} - {second for _, second in pairs})]

    def require(self, names: Sequence[str]) -> None:
        """Raise an `InputError`, which lists the mesh's groups, if one of the groups `names` is missing."""
        missing = [name for name in names if name not in self.groups]
        if missing:
            names_there = ", ".join(sorted(self.groups)) or "none"
            raise InputError(self.source, "", None, f"no group named {', '.join(missing)}; found: {names_there}")


def read_mesh(file: Path, kinds: Sequence[str], nodes: Path | None = None) -> NamedMesh:
    """Read a mesh from any file that meshio reads, or from a deck of Abaqus or CalculiX.

    Groups are gmsh's physical groups or a deck's sets and surfaces.  A set of nodes becomes the group of all cells
    whose corners are in the set.  If there is no such cell, it becomes the group of all such faces, else edges, else
    points.  If triangles are allowed, each quadrilateral is split into four triangles around its centre.

    Parameters
    ----------
    kinds : sequence of str
        Kinds of cells that the model allows, by dolfinx' names, such as ``("triangle",)``.
    nodes : Path, optional
        CSV file with further groups of nodes (`MeshFile.with_groups`).

    Raises
    ------
    InputError
        If cells are of another kind, of mixed kinds or of higher order, inverted, degenerate or unconnected, or if a
        group has no cells or cells of several dimensions; the message says what the file has.
    """
    read = read_mesh_file(file)
    read = read if nodes is None or not len(read.points) else read.with_groups(nodes)  # without points it is refused
    if "triangle" in kinds and all(DIMENSIONS[block.kind] < 3 for block in read.blocks):
        read = read.in_triangles()
    blocks = [(*CELLS_OF_KIND[block.kind][:2], block.corners[:, CELLS_OF_KIND[block.kind][2]]) for block in read.blocks]
    lines = [block.lines for block in read.blocks]
    return named_mesh(read.points, blocks, read.groups, kinds, str(file), read.point_groups, lines)


def named_mesh(
    points: Array,
    blocks: Sequence[tuple[str, int, Indices]],
    memberships: Mapping[str, Sequence[Indices]],
    kinds: Sequence[str],
    source: str = "mesh",
    point_groups: Mapping[str, Indices] | None = None,
    lines: Sequence[Sequence[Place]] = (),
) -> NamedMesh:
    """Checked mesh with the vertices `points` (N, 3) in m, from blocks of cells (kind, dimension, vertices).

    Only cells of the highest dimension become cells of the mesh; a cell that is listed several times counts once.
    Vertices that no cell uses are left out.  The others are numbered along the longest extent of the mesh.

    `memberships` has for each group one array per block, with the numbers of the group's cells in this block.
    `point_groups` has for each further group the numbers of its points; None means no further groups.  A group of
    points and a group of cells may have the same name.  Then the group of fewer dimensions is taken, such as the edge
    that a set of nodes forms, rather than the elements that touch this edge.  If both have the same dimension, the
    group of cells is taken.

    `kinds` are the allowed kinds of cells.  `source` is the mesh's name in errors.  `lines` has the place of each cell
    of each block in its file; it is empty if the places are not known.  Raises the errors of `read_mesh`.
    """

    def refuse(what: str) -> InputError:
        """The error for a mesh with these cells; `what` says what is wrong with them."""
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
    fault = mesh_fault(cell_kinds[0], points, cells)
    if fault is not None:
        places = [at for (_, dim, _), of_block in zip(blocks, lines, strict=False) if dim == top for at in of_block]
        if places:
            raise places[np.sort(first)[fault.cell]].error(fault.text)
        raise InputError(source, "", None, fault.text)
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
    for name, numbers in (point_groups or {}).items():
        inside = np.zeros(len(points) + 1, bool)
        inside[number[numbers]] = True
        inside[-1] = False  # of points that no cell uses
        group = _group_of_points(cell_kinds[0], cells, inside) if inside.any() else None
        if group is None or (name in groups and group.dim >= groups[name].dim):
            continue
        groups[name] = group
        regions.pop(name, None)
        if group.dim == top:
            regions[name] = np.flatnonzero(inside[cells].all(axis=1))
    return NamedMesh(cell_kinds[0], points, cells, groups, regions, source)


def _group_of_points(cell: str, cells: Indices, inside: Mask) -> Group:
    """Group of the `cells` (C, k) that have all their vertices in the mask `inside` (N,).

    If there is no such cell, the group has the faces with all vertices in the mask; if there is no such face, the
    edges, and if there is no such edge, the points.  The mask has to be true for at least one vertex of a cell.
    """
    for dim, parts in reversed([*enumerate(cell_topology(cell))]):
        entities = cells[:, parts].reshape(-1, len(parts[0]))
        entities = entities[inside[entities].all(axis=1)]
        if len(entities):
            _, first = np.unique(np.sort(entities, axis=1), axis=0, return_index=True)
            return Group(dim, entities[np.sort(first)])
    raise AssertionError("a vertex of a cell is inside")


@dataclass(frozen=True)
class Skin:
    """Facets at the surface of a solid or the rim of a shell: f cells and vertices (f, k), outward normals (f, 3)."""

    cell: Indices
    vertices: Indices
    normals: Array


def skin(mesh: NamedMesh) -> Skin:
    """Facets that belong to only one cell of a mesh, with this cell and their outward unit normals.

    A normal is square to the facet, and on a shell in the plane of its triangle.
    """
    facets = np.array(cell_topology(mesh.cell)[-2])
    vertices = mesh.cells[:, facets].reshape(-1, facets.shape[1])
    code = codes(np.sort(vertices, axis=1), len(mesh.points))
    _, inverse, count = np.unique(code, return_inverse=True, return_counts=True)
    shown = np.flatnonzero(count[inverse.reshape(-1)] == 1)
    cell, corners = shown // len(facets), mesh.points[vertices[shown]]
    out = corners.mean(axis=1) - mesh.points[mesh.cells[cell]].mean(axis=1)
    along = corners[:, 1 : 2 if mesh.cell == "triangle" else 3] - corners[:, :1]
    shares = np.linalg.solve(along @ along.transpose(0, 2, 1), along @ out[:, :, None])
    normals = out - (along.transpose(0, 2, 1) @ shares)[:, :, 0]
    return Skin(cell, vertices[shown], normals / np.linalg.norm(normals, axis=1)[:, None])


def add_faces(mesh: NamedMesh, faces: Mapping[str, FaceNormal]) -> NamedMesh:
    """Return the mesh with a further group for each of `faces`: the outermost facets that have the face's normal.

    The facets of a solid are those at its surface.  The facets of a shell are its triangles, with the normals of either
    side.  If no triangle has the normal, edges at the shell's rim are taken.  Facets with the normal that share
    vertices form a part.  The group consists of all parts that reach as far out along the normal as the farthest part.
    Raises an `InputError` if the mesh has a group of the face's name already, or no facet with the normal.
    """
    if not faces:
        return mesh
    groups, regions = dict(mesh.groups), dict(mesh.regions)
    is_shell = mesh.cell == "triangle"
    candidates = [_both_sides(mesh), skin(mesh)] if is_shell else [skin(mesh)]
    for name, face in faces.items():
        key = f"mesh.faces.{name}"
        if name in groups:
            allowed = f"a name is allowed that is no group of {mesh.source}: {', '.join(mesh.groups)}"
            raise InputError("scene", key, None, allowed)
        for facets in candidates:
            numbers = _outermost(mesh.points, facets, face)
            if len(numbers):
                break
        else:
            normals = np.concatenate([facets.normals for facets in candidates])
            nearest = normals[np.argmax(normals @ face.normal)].round(4) + 0.0
            allowed = f"a normal within {face.angle:g} degrees of that of a face is allowed; the nearest face has "
            raise InputError("scene", f"{key}.normal", list(face.normal), f"{allowed}{nearest.tolist()}")
        vertices = facets.vertices[numbers]
        groups[name] = Group(vertices.shape[1] - 1 if is_shell else 2, vertices)
        if is_shell and groups[name].dim == 2:
            regions[name] = facets.cell[numbers]
    return replace(mesh, groups=groups, regions=regions)


def _outermost(points: Array, facets: Skin, face: FaceNormal) -> Indices:
    """Numbers (k,) of the outermost facets that have the normal of `face`; empty if no facet has that normal.

    `points` are the mesh's vertices.  Of several connected patches of such facets, those count that reach farthest
    along the normal.
    """
    near = np.flatnonzero(facets.normals @ face.normal >= np.cos(np.deg2rad(face.angle)))
    if not len(near):
        return near
    vertices = facets.vertices[near]
    row = np.repeat(np.arange(len(near)), vertices.shape[1])
    incidence = coo_matrix((np.ones(len(row)), (row, vertices.ravel())), (len(near), len(points))).tocsr()
    count, part = connected_components(incidence @ incidence.T, directed=False)
    height, highest = (points[vertices] @ face.normal).max(axis=1), np.full(count, -np.inf)
    np.maximum.at(highest, part, height)
    return near[highest[part] >= height.max() - COINCIDENT * np.ptp(points, axis=0).max()]


def _both_sides(mesh: NamedMesh) -> Skin:
    """Triangles of a shell, each twice: first with the normals of one side, then with those of the other side."""
    normals = unit_normals(mesh.points[mesh.cells])
    number = np.arange(len(mesh.cells))
    return Skin(np.tile(number, 2), np.tile(mesh.cells, (2, 1)), np.concatenate([normals, -normals]))
