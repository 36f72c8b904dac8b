"""Points, cells and named groups of a mesh file: decks of Abaqus and CalculiX by our reader, all others by meshio."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.files.decks import KINDS, Deck, read_deck

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Dimension of cells by their kind in meshio's words.
DIMENSIONS = {"vertex": 0, "line": 1, "triangle": 2, "quad": 2, "tetra": 3, "hexahedron": 3}


@dataclass(frozen=True)
class Cells:
    """Cells of one kind, in meshio's words, with their corners (c, k) as numbers of points."""

    kind: str
    corners: Indices


@dataclass(frozen=True)
class MeshFile:
    """Content of a mesh file as it stands there; of each group the members (g,) in each of the blocks."""

    points: Array  # (N, 3) m
    blocks: list[Cells]
    groups: Mapping[str, list[Indices]]


def read_mesh_file(file: Path) -> MeshFile:
    """Read points, cells and groups.

    Raises InputError if the file can't be read, or its cells have corners that it has no points for.
    """
    content = _of_deck(read_deck(file)) if file.suffix.lower() == ".inp" and file.is_file() else _by_meshio(file)
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


def _of_deck(deck: Deck) -> MeshFile:
    place = {number: k for k, number in enumerate(deck.nodes)}
    blocks = list[Cells]()
    for block in deck.elements:
        for line, number, nodes in zip(block.lines, block.numbers, block.nodes, strict=True):
            missing = next((node for node in nodes if node not in place), None)
            if missing is not None:
                raise deck.refusal(line, f"element {number} has node {missing}, which is not in the file")
        kind = KINDS.get(block.type)
        if kind is None:
            raise InputError(deck.source, "", None, f"cells of type {block.type}; linear cells are allowed")
        if block.nodes:
            blocks.append(Cells(kind, np.array([[place[node] for node in nodes] for nodes in block.nodes], np.int64)))
    numbers = [np.array(block.numbers) for block in deck.elements if block.nodes]
    groups = {
        deck.spelled[name]: [np.flatnonzero(np.isin(element_numbers, list(members))) for element_numbers in numbers]
        for name, members in deck.element_sets.items()
    }
    return MeshFile(np.array(list(deck.nodes.values()), float).reshape(-1, 3), blocks, groups)


def _by_meshio(file: Path) -> MeshFile:
    import meshio

    try:
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):  # meshio prints what it tried
            mesh = meshio.read(file)
    except (Exception, SystemExit):  # meshio leaves with SystemExit where no reader fits
        hint = ", of gmsh with Mesh.SaveAll = 0," if file.suffix.lower() == ".msh" else ""
        allowed = f"meshio can't read it; a mesh with named groups{hint} is allowed"
        raise InputError(str(file), "", None, allowed) from None
    strange = sorted({block.type for block in mesh.cells} - set(DIMENSIONS))
    if strange:
        raise InputError(str(file), "", None, f"cells of type {', '.join(strange)}; linear cells are allowed")
    points = np.asarray(mesh.points, float)
    if points.ndim != 2 or not points.size:  # of files without any
        points = np.empty((0, 3))
    blocks = [Cells(block.type, np.asarray(block.data, np.int64)) for block in mesh.cells]
    return MeshFile(points, blocks, _physical_groups(mesh))


def _physical_groups(mesh: Any) -> dict[str, list[Indices]]:
    """Members of each physical group in each of meshio's blocks: as sets (MSH 4) or as tags (MSH 2)."""
    sets = {name: parts for name, parts in mesh.cell_sets.items() if not name.startswith("gmsh:")}
    empty = np.empty(0, np.int64)
    if sets:
        return {
            name: [empty if part is None else np.asarray(part, np.int64) for part in parts]
            for name, parts in sets.items()
        }
    tags = mesh.cell_data.get("gmsh:physical", [])
    return {
        name: [
            np.flatnonzero(tag == number) if DIMENSIONS[block.type] == dim else empty
            for block, tag in zip(mesh.cells, tags, strict=True)
        ]
        for name, (number, dim) in mesh.field_data.items()
        if len(tags)
    }
