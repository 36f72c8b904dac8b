"""Files of meshes: decks of Abaqus and CalculiX are read by this package, all other files by meshio."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field, replace
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from pmr.errors import InputError
from pmr.files.arrays import Array, Indices
from pmr.files.cards import Place
from pmr.files.deck_content import CORNERS, EDGES, Deck, Elements
from pmr.files.decks import TIED, TURNED, read_deck, read_groups

if TYPE_CHECKING:
    import meshio


logger = logging.getLogger(__name__)

#: Distance up to which two nodes are at one place, as a share of the mesh's largest extent.
COINCIDENT = 1e-6
#: Distance of a node from the middle of its edge up to which the edge is straight, as a share of the edge.
STRAIGHT = 1e-3
#: What meshio reads.
READABLE = (
    "a mesh with named groups is allowed, of gmsh in version 4.1 or 2.2 (Mesh.MshFileVersion) with Mesh.SaveAll = 0, "
    "without partitions (Mesh.NbPartitions = 0) and parameters of nodes (Mesh.SaveParametric = 0)"
)
#: Dimension of cells, by their kind in meshio's words.
DIMENSIONS = {"vertex": 0, "line": 1, "triangle": 2, "quad": 2, "tetra": 3, "hexahedron": 3}


@dataclass(frozen=True)
class Cells:
    """Cells of one kind, named as meshio names it, with their corners (c, k) as numbers of points."""

    kind: str
    corners: Indices
    lines: Sequence[Place] = ()  # (c,): where each cell is in a deck; empty for other files


@dataclass(frozen=True)
class MeshFile:
    """Content of a mesh file: points, blocks of cells of one kind, and groups of cells or points.

    `groups` has for each group of cells one array per block, with the numbers of the group's cells in this block.
    `point_groups` has for each group of points the numbers of its points.
    """

    points: Array  # (N, 3) m
    blocks: list[Cells]
    groups: Mapping[str, list[Indices]]
    point_groups: Mapping[str, Indices] = field(default_factory=dict)

    def with_groups(self, file: Path) -> MeshFile:
        """Return this content with the groups of nodes in a CSV file (`pmr.files.decks.read_groups`).

        Raises an `InputError` if a node in the file is no point of the mesh, or if the mesh has a group of the same
        name already.
        """
        tree, reach = cKDTree(self.points), COINCIDENT * float(np.ptp(self.points, axis=0).max())
        groups = read_groups(file)
        for name in groups.keys() & (self.groups.keys() | self.point_groups.keys()):
            raise InputError(str(file), "group", name, "a name is allowed that is no group of the mesh")
        numbers = {}
        for name, points in groups.items():
            distance = tree.query(points)[0]
            far = int(np.argmax(distance))
            if distance[far] > reach:
                allowed = f"nodes of the mesh are allowed, in m; the nearest one is {distance[far]:.3g} m away"
                raise InputError(str(file), f"node of group {name}", points[far].tolist(), allowed)
            numbers[name] = np.unique(np.concatenate(tree.query_ball_point(points, reach))).astype(np.int64)
        return replace(self, point_groups={**self.point_groups, **numbers})

    def in_triangles(self) -> MeshFile:
        """Return this content with each quadrilateral split into four triangles around its centre.

        Groups of cells then hold the triangles of their quadrilaterals, and a group of points that has all corners of a
        quadrilateral gets its centre.
        """
        points, blocks, point_groups = self.points, list[Cells](), dict(self.point_groups)
        for block in self.blocks:
            corners, kind, lines = block.corners, block.kind, block.lines
            if kind == "quad":
                centres, kind = len(points) + np.arange(len(corners)), "triangle"
                for name, members in point_groups.items():
                    inside = np.isin(block.corners, members).all(axis=1)
                    point_groups[name] = np.concatenate([members, centres[inside]])
                corners = split_quads(block.corners, len(points))
                points = np.concatenate([points, points[block.corners].mean(axis=1)])
                lines = [line for line in lines for _ in range(4)]
            blocks.append(Cells(kind, corners, lines))
        pieces = [np.arange(4 if block.kind == "quad" else 1) for block in self.blocks]
        groups = {
            name: [(len(k) * m[:, None] + k).ravel() for k, m in zip(pieces, members, strict=True)]
            for name, members in self.groups.items()
        }
        return MeshFile(points, blocks, groups, point_groups)


def split_quads(quads: Indices, first: int) -> Indices:
    """Triangles (4 e, 3) around the centres of e quadrilaterals `quads` (e, 4).

    The centres have the numbers from `first` on.
    """
    centre = first + np.arange(len(quads))
    triangles = [np.stack([quads[:, i], quads[:, (i + 1) % 4], centre], axis=1) for i in range(4)]
    return np.stack(triangles, axis=1).reshape(-1, 3)


def read_mesh_file(file: Path) -> MeshFile:
    """Read points, cells and groups of a deck of Abaqus or CalculiX, or of any file that meshio reads.

    Raises an `InputError` if the file can't be read, or a cell has corners that are not among the file's points.
    """
    content = _deck_content(file) if file.suffix.lower() == ".inp" and file.is_file() else _meshio_content(file)
    for block in content.blocks:
        missing = (block.corners < 0) | (block.corners >= len(content.points))
        if missing.any():
            raise InputError(
                str(file),
                "",
                None,
                f"{missing.any(axis=1).sum()} cells of kind {block.kind} have corners that are no points of it",
            )
    return content


def _deck_content(file: Path) -> MeshFile:
    """Points, cells and groups of a deck.  If elements have nodes amid their edges, only the corners are taken.

    Groups are the sets of elements, the sets of nodes and the surfaces.  Sets whose names begin with an underscore are
    a program's own and left out.  A warning names cards and elements that have no effect in a mesh.  Raises an
    `InputError` for cells of other kinds or with curved edges, and for solid cells of two kinds.  An `InputError` is
    also raised for ties between nodes at different places, and for any other card that joins nodes.
    """
    deck = read_deck(file)
    for where, keyword in deck.further.constraints:
        if keyword not in (TURNED, TIED):  # axes of nodes do not move them
            raise where.error(f"*{keyword} is not read; a mesh is allowed whose elements are joined by nodes alone")
    points = np.array(list(deck.nodes.values()), float).reshape(-1, 3)
    place = dict(zip(deck.nodes, join_ties(deck, points).tolist(), strict=True))
    blocks = list[Cells]()
    for block in deck.elements:
        if not block.kind:
            where = block.lines[0] if block.lines else Place(str(file), 1)
            raise where.error(
                f"cells of type {block.type or 'none'}; bars, triangles, quadrilaterals, tetrahedra and hexahedra are "
                "allowed"
            )
        if block.nodes:
            nodes = np.array([[place[node] for node in nodes] for nodes in block.nodes], np.int64)
            _check_edges(block, points, nodes)
            if solid := {of.kind for of in blocks if DIMENSIONS[of.kind] == 3 == DIMENSIONS[block.kind]} - {block.kind}:
                allowed = f"cells of one kind are allowed: this is a {block.kind} beside a {solid.pop()}"
                raise block.lines[0].error(allowed)
            blocks.append(Cells(block.kind, nodes[:, : CORNERS[block.kind]], block.lines))
    _warn_of_unread(file, deck)
    numbers = [np.array(block.numbers) for block in deck.elements if block.nodes]
    names = {name: spelling for name, spelling in deck.set_spellings.items() if not name.startswith("_")}
    groups = {
        names[name]: [np.flatnonzero(np.isin(element_numbers, list(members))) for element_numbers in numbers]
        for name, members in deck.element_sets.items()
        if name in names
    }
    of_points = {
        names[name]: np.array([place[node] for node in members], np.int64)
        for name, members in (deck.surfaces | deck.node_sets).items()
        if name in names
    }
    return MeshFile(points, blocks, groups, of_points)


def _warn_of_unread(file: Path, deck: Deck) -> None:
    """Log a warning that names the parts of a deck which a mesh does not use, with their lines; nothing if all is used.

    Such parts are supports, loads, materials and sections.  Elements of fewer dimensions than other elements, such as
    bars beside shells, are also named: they only form groups in the mesh.
    """
    unread = {f"*{keyword}": place for keyword, place in deck.further.unread.items()}
    dimensions = [DIMENSIONS[block.kind] for block in deck.elements if block.nodes]
    for block in deck.elements:
        if block.nodes and DIMENSIONS[block.kind] < max(dimensions):
            unread.setdefault(f"elements {block.type}", block.lines[0])
    if unread:
        shown = [
            f"{what} (line {at.line}{'' if at.source == str(file) else f' of {Path(at.source).name}'})"
            for what, at in unread.items()
        ]
        of_scene = "supports, loads, masses, materials and thicknesses are the scene's"
        logger.warning("%s: without effect in a mesh, where %s: %s", file, of_scene, ", ".join(shown))


def join_ties(deck: Deck, points: Array) -> Indices:
    """Number (N,) of the node that stands for each node at `points` (N, 3) m, after the ties of `deck` are joined.

    A node that is not tied stands for itself.  In a tie, a node of the second surface stands for the node of the first
    surface at the same place.  Places are the same within the share `COINCIDENT` of the largest extent of all points.
    Raises an `InputError` if a tie names a surface that is not read, or if a node of its first surface has no partner.
    """
    number, joined = {node: k for k, node in enumerate(deck.nodes)}, np.arange(len(points))
    for card in deck.further.ties:
        for line in card.lines:
            sides = list[Indices]()
            for name in line.fields[:2]:
                nodes = deck.surfaces.get(name.lower()) or deck.node_sets.get(name.lower())
                if not nodes:
                    raise line.place.error(f"{name!r} is no surface of nodes, or of faces of elements, that is read")
                sides.append(np.array([number[node] for node in sorted(nodes)]))
            if len(sides) != 2:
                raise line.place.error("the names of two surfaces are allowed")
            tied, to = sides
            off, nearest = cKDTree(points[to]).query(points[tied])
            far = off > COINCIDENT * float(np.ptp(points, axis=0).max())
            if far.any():
                node = [*deck.nodes][tied[far][0]]
                allowed = (
                    f"ties of nodes at the same places are allowed: {line.fields[1]} has none where node {node} is"
                )
                raise line.place.error(allowed)
            for first, second in zip(tied, to[nearest], strict=True):
                joined[joined == joined[first]] = joined[second]
    return joined


def _check_edges(block: Elements, points: Array, nodes: Indices) -> None:
    """Raise an `InputError` for the first element that has a node which is not amid a straight edge.

    A node may be off the middle of its edge by the share `STRAIGHT` of the edge's length.  `nodes` (e, k) are the nodes
    of the elements of `block`, and `points` the places of all nodes.
    """
    if nodes.shape[1] == CORNERS[block.kind]:
        return
    ends, amid = points[nodes[:, EDGES[block.kind]]], points[nodes[:, CORNERS[block.kind] :]]
    off = np.linalg.norm(amid - ends.mean(axis=2), axis=2) > STRAIGHT * np.linalg.norm(
        np.diff(ends, axis=2)[:, :, 0], axis=2
    )
    if off.any():
        k = int(off.any(axis=1).argmax())
        raise block.lines[k].error(
            f"straight edges are allowed, with nodes amid them: element {block.numbers[k]} has others"
        )


def _meshio_content(file: Path) -> MeshFile:
    """Points, cells and groups of a file that meshio reads.

    Raises an `InputError` if meshio can't read the file, or cells are not linear.
    """
    import meshio

    if file.suffix.lower() == ".med":  # h5py of a wheel has an HDF5 of its own, which does not go with that of dolfinx
        raise InputError(str(file), "", None, "MED is not read; gmsh opens it and saves it with its groups as MSH 4.1")
    try:
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):  # meshio prints what it tried
            mesh = meshio.read(file)
    except ModuleNotFoundError as error:
        needed = f"meshio reads {file.suffix} files with the package {error.name}, which is not installed"
        allowed = f"{needed}; .msh of gmsh, .vtu and .inp are allowed"
        raise InputError(str(file), "", None, allowed) from None
    except (Exception, SystemExit):  # meshio raises SystemExit if no reader fits
        raise InputError(str(file), "", None, f"meshio can't read it; {READABLE}") from None
    strange = sorted({block.type for block in mesh.cells} - set(DIMENSIONS))
    if strange:
        raise InputError(str(file), "", None, f"cells of type {', '.join(strange)}; linear cells are allowed")
    points = np.asarray(mesh.points, float)
    if points.ndim != 2 or not points.size:  # a file without points
        points = np.empty((0, 3))
    points = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))  # a mesh in the plane has x and y alone
    blocks = [Cells(block.type, np.asarray(block.data, np.int64)) for block in mesh.cells]
    return MeshFile(points, blocks, _physical_groups(mesh))


def _physical_groups(mesh: meshio.Mesh) -> dict[str, list[Indices]]:
    """Numbers (k,) of the cells of each physical group in each of meshio's blocks, by the group's name.

    The groups are sets (MSH 4) or tags (MSH 2), whose number and dimension are in the mesh's field data.  Other field
    data, such as the time that ParaView writes, are left out.  The result is empty if the file has no groups.
    """
    sets = {name: parts for name, parts in mesh.cell_sets.items() if not name.startswith("gmsh:")}
    empty = np.empty(0, np.int64)
    if sets:
        return {
            name: [empty if part is None else np.asarray(part, np.int64) for part in parts]
            for name, parts in sets.items()
        }
    tags = mesh.cell_data.get("gmsh:physical", [])
    named = {name: entry for name, entry in mesh.field_data.items() if len(tags) and np.shape(entry) == (2,)}
    return {
        name: [
            np.flatnonzero(tag == number) if DIMENSIONS[block.type] == dim else empty
            for block, tag in zip(mesh.cells, tags, strict=True)
        ]
        for name, (number, dim) in named.items()
    }
