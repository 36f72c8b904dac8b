"""A structural model from given matrices, which another program assembled, with nodes and named groups."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.spatial import Delaunay

from pmr.errors import InputError
from pmr.files.arrays import Array, Indices
from pmr.files.matrices import GivenMatrices
from pmr.files.rigid import elastic_energies
from pmr.models import DIRECTIONS
from pmr.models.meshed import TracedModel
from pmr.models.trace import Extent, Strip, Trace, Window, orient_outward
from pmr.scene.members import Member

#: A face's nodes lie in a plane within this share of the face's extent.
FLAT = 1e-3
#: Nodes around a place make up its section if they spread over this share of the body's breadth and height.
WHOLE = 0.5


@dataclass(frozen=True)
class Matrices(TracedModel):
    """Model from given mass and stiffness (n, n); in the mean over a group every node has the same weight.

    A face that pads slide on is a group of nodes in a plane.  Displacements between the nodes are linear on the
    triangles of their Delaunay triangulation.
    """

    body_matrices: GivenMatrices

    @property
    def size(self) -> int:
        """Number of coordinates n."""
        return self.body_matrices.size

    @property
    def unchecked(self) -> bool:
        """Whether positions and directions of the nodes could not be checked against the stiffness.

        No check is possible if all nodes are next to supports inside the matrices.
        """
        return self.body_matrices.unchecked

    @property
    def axis(self) -> int:
        """Axis of the body's longest extent: 0, 1 or 2 for x, y or z."""
        return int(np.ptp(self.body_matrices.points, axis=0).argmax())

    @property
    def reference_frequency(self) -> float:
        """Scale of the lowest circular frequencies in rad/s, the root of Rayleigh's quotient of a bending motion.

        The motion is w = x^2 across the axis, with x from the middle of the body.  There are two directions across; the
        lower of their two quotients counts, but at least 1e-12 of the higher one.  Supports and springs inside K, which
        may be any number of times stiffer than the body, are left out.
        """
        x = self.body_matrices.points - self.body_matrices.points.mean(axis=0)
        bent = []
        for across in range(3):
            if across == self.axis:
                continue
            motion = np.zeros((len(x), 6))
            motion[:, across] = x[:, self.axis] ** 2
            slope = 2.0 * x[:, self.axis]
            motion[:, self.axis] = -slope * x[:, across]
            turn = np.cross(np.eye(3)[self.axis], np.eye(3)[across])
            motion[:, 3:] = slope[:, None] * turn
            q = motion[self.body_matrices.node, self.body_matrices.direction]
            bent.append(np.where(self.body_matrices.modal, 0.0, q))
        motions = np.column_stack(bent)
        energies = elastic_energies(self.body_matrices.K, self.rigid_motions(), motions)
        squares = energies / np.einsum("nk,nk->k", motions, self.body_matrices.M @ motions)
        return float(np.sqrt(max(squares.min(), 1e-12 * squares.max())))

    def coordinates_on(self, place: str, directions: Sequence[str]) -> Indices:
        """Numbers (k,) of the coordinates of nodes in the group `place` that are in one of the given `directions`.

        Raises the InputError of `_group`.
        """
        on = np.isin(self.body_matrices.node, self._group(place))
        along = np.isin(self.body_matrices.direction, [DIRECTIONS.index(direction) for direction in directions])
        return np.flatnonzero(on & along)

    def rigid_motions(self) -> Array:
        """Coordinates (n, 6) under unit translations along and rotations about x, y and z through the origin."""
        return self.body_matrices.rigid_motions()

    def strip(self, face: str, window: Window) -> Strip:
        """Points within `window` on the plane of a face's nodes, evenly spaced.

        Raises an `InputError` if the nodes do not lie in a plane along the axis, or have no coordinates along its
        normal.
        """
        nodes, axis = self._group(face), self.axis
        points = self.body_matrices.points[nodes]
        normal = self._normal(face, points)
        across = int(np.argmin(np.abs(normal) + np.eye(3)[axis]))
        if abs(normal[axis]) > np.sqrt(FLAT):
            raise InputError(
                "scene", "pads.on", face, "this face lies across the body's axis; faces along it are allowed"
            )
        flat = points[:, [axis, across]]
        (low, nearest), (high, farthest) = flat.min(axis=0), flat.max(axis=0)
        extent = Extent((float(low), float(high)), (float(nearest), float(farthest)))
        x, y = (
            _divide(max(least, start), min(most, end), spacing)
            for (least, most), (start, end), spacing in zip(
                ((low, high), (nearest, farthest)), (window.along, window.across), window.spacing, strict=True
            )
        )
        middles = [(ends[1:] + ends[:-1]) / 2.0 for ends in (x, y)]
        places = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1).reshape(-1, 2)
        triangles = Delaunay(flat)
        triangle = triangles.find_simplex(places, tol=1e-9)
        inside = triangle >= 0
        places, triangle = places[inside], triangle[inside]
        corners, T = triangles.simplices[triangle], triangles.transform[triangle]
        shares = np.einsum("qij,qj->qi", T[:, :2], places - T[:, 2])
        shares = np.hstack([shares, 1.0 - shares.sum(axis=1, keepdims=True)])
        rows = np.repeat(np.arange(len(places)), 3)
        interpolation = sp.csr_matrix((shares.ravel(), (rows, corners.ravel())), shape=(len(places), len(nodes)))
        value = sum(c * self._values(nodes)[k] for k, c in enumerate(normal))
        if not value.count_nonzero():
            allowed = (
                "a face is allowed whose nodes have coordinates along its normal: without them a pad holds nothing"
            )
            raise InputError("scene", "pads.on", face, allowed)
        weights = np.outer(np.diff(x), np.diff(y)).ravel()[inside]
        return Strip(places[:, 0], places[:, 1], weights, sp.csr_matrix(interpolation @ value), extent)

    def _group(self, name: str) -> Indices:
        """Numbers (g,) of the g nodes of the group `name`; raises an `InputError` if there is no such group."""
        if name not in self.body_matrices.groups:
            allowed = f"groups of the file are allowed: {', '.join(self.body_matrices.groups) or 'it has none'}"
            raise InputError(self.body_matrices.source, "groups", name, allowed)
        return self.body_matrices.groups[name]

    def _values(self, nodes: Indices) -> list[sp.csr_matrix]:
        """Rows (g, n) of the displacements of the g `nodes`, one matrix for each of x, y and z."""
        return [rows[nodes] for rows in self._of_direction]

    @cached_property
    def _of_direction(self) -> list[sp.csr_matrix]:
        """Rows (N, n) of the displacements of all N nodes, one matrix for each of x, y and z."""
        matrices, shape = self.body_matrices, (len(self.body_matrices.points), self.body_matrices.size)
        numbers = [np.flatnonzero(matrices.direction == k) for k in range(3)]
        return [
            sp.csr_matrix((np.ones(len(coordinates)), (matrices.node[coordinates], coordinates)), shape=shape)
            for coordinates in numbers
        ]

    def trace(self, place: str | float) -> Trace:
        """Displacements at `place`: of the nodes of a group, or of nodes near a cross-section at a distance in m.

        The weights of the nodes near a cross-section are a hat, which falls from the cross-section to zero on either
        side.  The hat reaches just beyond the next nodes.  If these do not spread over the whole section, it reaches
        farther.  Raises an `InputError` if the group does not exist or the body does not reach the cross-section.
        """
        if isinstance(place, str):
            nodes = self._group(place)
            return Trace(place, self.body_matrices.points[nodes], np.ones(len(nodes)), self._values(nodes))
        x = self.body_matrices.points[:, self.axis]
        slack = 1e-9 * float(np.ptp(x))
        if not x.min() - slack <= place <= x.max() + slack:
            allowed = f"a group or a number from {x.min():g} to {x.max():g} m is allowed"
            raise InputError("scene", "place", place, allowed)
        levels = np.unique(np.round(x / max(slack, 1e-300)).astype(np.int64)) * slack
        gaps = np.diff(levels)
        near = (levels[1:] >= place - slack) & (levels[:-1] <= place + slack)
        reach, points = float(gaps[near].max()) + slack, self.body_matrices.points
        while True:
            nodes = np.flatnonzero(np.abs(x - place) < reach)
            across = np.ptp(points[nodes], axis=0) >= WHOLE * np.ptp(points, axis=0)
            if np.delete(across, self.axis).all() or len(nodes) == len(x):
                break
            reach *= 2.0  # an irregular mesh: a few of its nodes are no section
        weights = 1.0 - np.abs(x[nodes] - place) / reach
        name = f"section at {place:g} m"
        return Trace(name, points[nodes], weights, self._values(nodes)).shift_to(self.axis, place)

    def _normal(self, face: str, points: Array) -> Array:
        """Unit vector (3,), out of the body, normal to the face called `face`, whose g nodes are at `points` (g, 3) m.

        Raises an `InputError` if the nodes do not lie in a plane, or lie on a line.
        """
        middle = points.mean(axis=0)
        _, sizes, ways = np.linalg.svd(points - middle, full_matrices=False)
        if len(points) < 3 or sizes[1] <= FLAT * sizes[0] or sizes[2] > FLAT * sizes[1]:
            raise InputError("scene", "pads.on", face, "nodes that lie in a plane, not on a line, are allowed")
        return orient_outward(face, ways[2], middle, self.body_matrices.points)


def _divide(start: float, end: float, spacing: float) -> Array:
    """Ends (k + 1,) in m of k equal intervals from `start` to `end`, no wider than `spacing`.

    The array is empty if `end` <= `start`.
    """
    return (
        np.linspace(start, end, max(1, int(np.ceil((end - start) / spacing - 1e-9))) + 1)
        if end > start
        else np.empty(0)
    )


def from_member(member: Member) -> Matrices:
    """Structural model of the matrices in the file that a scene names; every rank reads the file by itself.

    Raises the errors of `GivenMatrices.load`.
    """
    assert member.part.mesh.file is not None  # the scene's check
    return Matrices(GivenMatrices.load(member.part.mesh.file))
