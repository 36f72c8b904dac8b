"""Outside and inside of hollow bodies, and the facets that a solid shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.fem.compat import cell_topology
from pmr.mesh.named import NamedMesh
from pmr.mesh.nodes import codes
from pmr.mesh.strip import FLAT

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Cosine from which on a normal points away from the body's axis, or towards it.
CLEAR = 0.01


def body_axis(mesh: NamedMesh) -> int:
    """0, 1 or 2 for x, y or z: along its longest extent."""
    return int(np.ptp(mesh.points, axis=0).argmax())


def away(mesh: NamedMesh, places: Array, normals: Array) -> Array:
    """1 where a unit normal (f, 3) at a place (f, 3) points away from the body's axis, -1 towards it, 0 neither.

    The axis runs through the middle of the other extents.
    """
    arm = places - (mesh.points.min(axis=0) + mesh.points.max(axis=0)) / 2.0
    arm[:, body_axis(mesh)] = 0.0
    along = np.sum(arm * normals, axis=1)
    return np.asarray(np.where(np.abs(along) > CLEAR * np.linalg.norm(arm, axis=1), np.sign(along), 0.0))


def outward(mesh: NamedMesh, places: Array, normals: Array) -> Array:
    """The normals (f, 3) of a surface, those that point towards the body's axis turned round.

    Where they do neither, on a flat plate or across the axis, their largest component becomes positive.
    """
    largest = np.take_along_axis(normals, np.abs(normals).argmax(axis=1)[:, None], axis=1)[:, 0]
    flat = bool(np.all(np.abs(normals @ normals[0]) > FLAT))
    side = np.zeros(len(normals)) if flat else away(mesh, places, normals)
    return np.asarray(normals * np.where(side == 0.0, np.sign(largest), side)[:, None])


@dataclass(frozen=True)
class Skin:
    """Facets (f,) of a solid's surface: their cells, vertices (f, k), and unit normals (f, 3)."""

    cell: Indices
    vertices: Indices
    normals: Array


def skin(mesh: NamedMesh) -> Skin:
    """The facets that belong to one cell only; normals point out of the material."""
    facets = np.array(cell_topology(mesh.cell)[2])
    vertices = mesh.cells[:, facets]
    flat = vertices.reshape(-1, vertices.shape[2])
    code = codes(np.sort(flat, axis=1), len(mesh.points))
    _, inverse, count = np.unique(code, return_inverse=True, return_counts=True)
    shown = np.flatnonzero(count[inverse.reshape(-1)] == 1)
    cell = shown // len(facets)
    a, b, c = (mesh.points[flat[shown, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    out = mesh.points[flat[shown]].mean(axis=1) - mesh.points[mesh.cells[cell]].mean(axis=1)
    normals *= np.sign(np.sum(normals * out, axis=1))[:, None]
    return Skin(cell, flat[shown], normals)
