"""Meshes of a straight planar beam: generated, or a chain of line cells from a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.mesh.files import read_mesh_file

Array = NDArray[np.float64]


def graded_nodes(length: float, elements: int, grading: float = 1.0) -> Array:
    """Nodes (elements + 1,) in m; element lengths grow geometrically so that last / first = `grading`."""
    if elements == 1 or grading == 1.0:
        return np.linspace(0.0, length, elements + 1)
    lengths = grading ** (np.arange(elements) / (elements - 1))
    nodes = np.concatenate([[0.0], np.cumsum(lengths)])
    return nodes * (length / nodes[-1])


def read_nodes(file: Path, length: float) -> Array:
    """Nodes (N,) in m of the line cells in any file that meshio reads."""

    def refuse(problem: str) -> InputError:
        return InputError(str(file), "", None, f"{problem}; a chain of line cells on the x axis is allowed")

    read = read_mesh_file(file)
    kinds = sorted({block.kind for block in read.blocks} - {"vertex"})
    if kinds != ["line"]:
        raise refuse(f"cells of type {', '.join(kinds) or 'none'}")
    lines = np.concatenate([block.corners for block in read.blocks if block.kind == "line"])
    used = np.unique(lines)
    points = read.points
    if not np.isfinite(points[used]).all():
        raise refuse("coordinates that are not finite")
    if np.any(np.abs(points[used, 1:]) > 1e-9 * length):
        raise refuse("points off the x axis")
    x = points[used, 0]
    order = np.argsort(x)
    nodes, rank = x[order], np.empty(len(points), int)
    rank[used[order]] = np.arange(len(used))
    if np.any(np.diff(nodes) <= 1e-12 * length):
        raise refuse("two nodes at one place")
    chain = np.sort(rank[lines], axis=1)
    if len(chain) != len(nodes) - 1 or set(map(tuple, chain)) != {(i, i + 1) for i in range(len(nodes) - 1)}:
        raise refuse(f"{len(lines)} lines on {len(nodes)} nodes that form no single chain")
    if abs(nodes[0]) > 1e-9 * length or abs(nodes[-1] - length) > 1e-9 * length:
        raise refuse(f"nodes from {nodes[0]:g} to {nodes[-1]:g} m, but the beam has {length:g} m from 0")
    nodes[0], nodes[-1] = 0.0, length
    return np.asarray(nodes, float)
