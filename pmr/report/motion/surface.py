"""The surface of a body as triangles, from the cells of its fields."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.fields.series import Fields
from pmr.results import RunResult
from pmr.scene.box import Box

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Faces of the cells in VTK's order of vertices.
_FACES = {
    "triangle": [(0, 1, 2)],
    "tetra": [(0, 1, 3), (1, 2, 3), (2, 0, 3), (0, 2, 1)],
    "hexahedron": [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)],
}
#: A beam whose section is not known is drawn this thick, m.
_THIN = 0.05


@dataclass(frozen=True)
class Surface:
    """Visible surface of a body.

    Attributes
    ----------
    points : (P, 3) array, m
        At rest.
    faces : (S, 3 or 4) integer array
        Triangles or quadrilaterals.
    cell : (S,) integer array
        The cell that each face belongs to.
    vertex : (P,) integer array
        The vertex of the fields that each point moves with.
    lever : (P, 2) array, m
        How far a point is from that vertex along y and z: sections of beams turn with their axis.
    """

    points: Array
    faces: Indices
    cell: Indices
    vertex: Indices
    lever: Array

    def moved(self, fields: Fields, displacement: NDArray[np.float32]) -> NDArray[np.float32]:
        """Displacements (..., P, 3) in m of the points, from those (..., N, 3) of the vertices."""
        displaced = np.asarray(displacement[..., self.vertex, :])
        if np.any(self.lever):
            slope = np.gradient(displacement, fields.points[:, 0], axis=-2)[..., self.vertex, 1:]
            displaced[..., 0] -= np.sum(slope * self.lever, axis=-1)  # sections stay across the axis
        return displaced

    @property
    def triangles(self) -> Indices:
        """(T, 3): each quadrilateral as two."""
        if self.faces.shape[1] == 3:
            return self.faces
        return np.concatenate([self.faces[:, [0, 1, 2]], self.faces[:, [0, 2, 3]]])

    @property
    def edges(self) -> Indices:
        """(E, 2): edges of the faces, each once."""
        ends = np.concatenate([self.faces, self.faces[:, :1]], axis=1)
        pairs = np.sort(np.stack([ends[:, :-1].ravel(), ends[:, 1:].ravel()], axis=1), axis=1)
        return np.unique(pairs, axis=0)


def surface(fields: Fields, box: Box | None = None) -> Surface:
    """The surface of shells and solids; for beams, whose vertices go along x, the tube that `box` describes."""
    if fields.kind == "line":
        return _tube(fields, box)
    cells = fields.cells[:, : {"triangle": 3, "tetra": 4, "hexahedron": 8}[fields.kind]]
    table = np.array(_FACES[fields.kind])
    faces = cells[:, table].reshape(-1, table.shape[1])
    cell = np.repeat(np.arange(len(cells)), len(table))
    if len(table) > 1:
        _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
        outside = np.sort(first[count == 1])  # what two cells share is inside
        faces, cell = faces[outside], cell[outside]
    vertex, faces = np.unique(faces, return_inverse=True)
    faces = faces.reshape(-1, table.shape[1])
    return Surface(fields.points[vertex], faces, cell, vertex, np.zeros((len(vertex), 2)))


def surfaces(result: RunResult) -> dict[str, Surface]:
    """Surfaces of all bodies that have fields."""
    bodies = result.scene.bodies
    return {
        name: surface(body.fields, bodies[name].body.box)
        for name, body in result.bodies.items()
        if body.fields is not None
    }


def _tube(fields: Fields, box: Box | None) -> Surface:
    """Walls along a beam's axis."""
    thin = np.array([(-_THIN, -_THIN), (_THIN, -_THIN), (_THIN, _THIN), (-_THIN, _THIN)]) / 2.0
    count = len(fields.points)
    corners = np.tile([side.start for side in box.sides] if box else thin, (count, 1, 1))
    if box and box.variations:
        corners = np.array([[side.start for side in box.profile_at(float(x)).sides] for x in fields.points[:, 0]])
    around = corners.shape[1]
    vertex, lever = np.repeat(np.arange(count), around), corners.reshape(-1, 2)
    points = fields.points[vertex].astype(float)
    points[:, 1:] += lever
    first, second = around * fields.cells[:, 0], around * fields.cells[:, 1]
    ends = [(k, (k + 1) % around) for k in range(around)]
    walls = [np.stack([first + a, second + a, second + b, first + b], axis=1) for a, b in ends]
    return Surface(points, np.concatenate(walls), np.tile(np.arange(len(fields.cells)), around), vertex, lever)
