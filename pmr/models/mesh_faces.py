"""Faces of a mesh by their outward normals, for files without groups of that name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from pmr.errors import InputError
from pmr.fem.compat import cell_topology
from pmr.files.arrays import Array, Indices
from pmr.models.mesh_file import COINCIDENT
from pmr.models.mesh_nodes import codes
from pmr.models.named_mesh import Group, NamedMesh
from pmr.scene.built import FaceNormal


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
    """Return the mesh with a further group for each of `faces`: the outermost facets that have its normal.

    Facets of a shell are its triangles, on either side, or, where no triangle has the normal, edges at its rim.  Facets
    that share vertices belong together, as far as they have the normal; those parts are taken that reach as far out as
    the farthest.  Raises an `InputError` if the mesh has a group of that name, or no facet with the normal.
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
    """Numbers of the outermost facets that have the normal of `face`; empty if no facet has it.

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
    """Triangles of a shell, first with the normals of one side, then with those of the other."""
    a, b, c = (mesh.points[mesh.cells[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    number = np.arange(len(mesh.cells))
    return Skin(np.tile(number, 2), np.tile(mesh.cells, (2, 1)), np.concatenate([normals, -normals]))
