"""The strip of a flat face that a pad sweeps, as points close together."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.mesh.named import Group, NamedMesh
from pmr.mesh.nodes import Nodes
from pmr.mesh.trace import trace

Array = NDArray[np.float64]

#: Cosine of the largest angle between a face's cells.
FLAT = 0.9999
#: A face that is so much beside the body's middle, as a share of its extent, lies in it.
BESIDE = 1e-6
#: Cells of a strip are cut into pieces that a pad resolves; more of them take gigabytes.
MOST_PIECES = 500_000


@dataclass(frozen=True)
class Window:
    """A rectangle on a face, its extent along the body's axis and across; and how far points are apart at most, m."""

    along: tuple[float, float]
    across: tuple[float, float]
    spacing: tuple[float, float]


@dataclass(frozen=True)
class Plane:
    """A face in the axes of its body, along x; how far it is from the axis plays no role."""

    normal: Array  # (3,): unit vector out of it
    across: Array  # (3,): unit vector that places across count along, from the one nearest to the axis


#: Faces that every body has; z is up.
FACES = {
    name: Plane(sign * np.eye(3)[component], np.eye(3)[3 - component])
    for name, component, sign in (("bottom", 2, -1.0), ("top", 2, 1.0), ("left", 1, 1.0), ("right", 1, -1.0))
}


@dataclass(frozen=True)
class Extent:
    """Extent of a face along the body's axis and across it, m; None across for a line."""

    along: tuple[float, float]
    across: tuple[float, float] | None = None

    def __str__(self) -> str:
        across = "" if self.across is None else ", {:.4g} to {:.4g} m across".format(*self.across)
        return "{:.4g} to {:.4g} m along the axis".format(*self.along) + across


@dataclass(frozen=True)
class Strip:
    """Points of a face within a window; none where the window lies beside the face."""

    along: Array  # (q,) m on the body's axis
    across: Array  # (q,) m: y or z where the face is along one of them, else upwards
    weights: Array  # (q,) of quadrature, m^2 (on a line m)
    normal: sp.csr_matrix  # (q, n): displacement along the outward normal
    extent: Extent  # of the whole face
    line: bool = False  # whether the points lie on the line that stands for the face of a beam


@dataclass(frozen=True)
class FlatFace:
    """A flat face along the axis of a mesh."""

    mesh: NamedMesh
    name: str
    normal: Array  # (3,): unit vector out of the mesh
    axes: Array  # (2, 3): unit vectors along the body's axis and across the face
    least: Array  # (e, 2) m: where each of its cells begins along these axes
    most: Array  # (e, 2) m: where it ends

    @property
    def extent(self) -> Extent:
        low, high = self.least.min(axis=0).tolist(), self.most.max(axis=0).tolist()
        return Extent((low[0], high[0]), (low[1], high[1]))


def flat_face(mesh: NamedMesh, name: str) -> FlatFace:
    """A named face, ready for strips.

    Raises an `InputError` if there is no such face, it is not flat, or it lies across the axis.
    """
    mesh.require([name])
    group, axis = mesh.groups[name], mesh.axis
    if group.dim != 2:
        raise InputError(mesh.source, "", None, f"group {name} is no face, pads slide on faces only")
    normal = _normal(mesh, group, name)
    if abs(normal[axis]) > np.sqrt(1.0 - FLAT**2):
        raise InputError("scene", "pads.on", name, "this face lies across the body's axis; faces along it are allowed")
    unit = np.eye(3)
    axes = np.array([unit[axis], unit[np.argmin(np.abs(normal) + unit[axis])]])
    if abs(normal @ axes[1]) > np.sqrt(1.0 - FLAT**2):  # it is slanted
        axes[1] = np.cross(normal, unit[axis])
        axes[1] *= np.sign(axes[1][2] or axes[1].sum()) / np.linalg.norm(axes[1])
    corners = (mesh.points @ axes.T)[group.entities]
    return FlatFace(mesh, name, normal, axes, corners.min(axis=1), corners.max(axis=1))


def face_strip(face: FlatFace, nodes: Nodes, window: Window) -> Strip:
    """The strip of a face; displacements are quadratic.

    Raises an `InputError` if its cells are so large that a pad would be resolved by too many pieces of them.
    """
    mesh, name = face.mesh, face.name
    low, high = np.array([window.along, window.across]).T
    inside = np.flatnonzero(((face.most > low) & (face.least < high)).all(axis=1))
    if not len(inside):
        nothing = np.empty(0)
        return Strip(nothing, nothing, nothing, sp.csr_matrix((0, nodes.size)), face.extent)
    sizes = (face.most[inside] - face.least[inside]).max(axis=0)
    parts = int(np.ceil(np.max(sizes / window.spacing)))
    if parts**2 * len(inside) > MOST_PIECES:
        allowed = f"cells of this face are up to {parts} times as large as a pad resolves; finer cells or larger pads"
        raise InputError("scene", "pads.on", name, f"{allowed} are allowed")
    cut = replace(mesh, groups={name: Group(2, mesh.groups[name].entities[inside])})
    points = trace(cut, nodes, name, degree=2, parts=max(1, parts))
    place = points.points @ face.axes.T
    within = np.flatnonzero(((place > low) & (place < high)).all(axis=1))
    displacement = sum(c * component[within] for c, component in zip(face.normal, points.values, strict=True) if c)
    displacement.eliminate_zeros()
    return Strip(place[within, 0], place[within, 1], points.weights[within], displacement, face.extent)


def line_points(window: Window, stations: Array) -> tuple[Array, Array]:
    """Places (q,) m and weights (q,) m of Gauss' rule on a beam's axis within a window, exact for lines times cubics.

    The axis is cut at its `stations` (nodes, ascending) and at multiples of the window's spacing from its start.
    """
    if window.along[0] >= stations[-1] or window.along[1] <= stations[0]:
        return np.empty(0), np.empty(0)
    start, end = max(window.along[0], stations[0]), min(window.along[1], stations[-1])
    cuts = np.arange(window.along[0], window.along[1], window.spacing[0])
    inner = np.concatenate([stations, cuts])
    ends = np.unique(np.concatenate([[start, end], inner[(inner > start) & (inner < end)]]))
    x, w = np.polynomial.legendre.leggauss(3)
    middle, half = (ends[1:] + ends[:-1])[:, None] / 2.0, np.diff(ends)[:, None] / 2.0
    return (middle + half * x).ravel(), (half * w).ravel()


def _normal(mesh: NamedMesh, group: Group, face: str) -> Array:
    """Unit vector out of the mesh, whatever the order of the vertices."""
    a, b, c = (mesh.points[group.entities[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    normals *= np.sign(normals @ normals[0])[:, None]
    mean = normals.mean(axis=0)
    mean /= np.linalg.norm(mean)
    if np.any(normals @ mean < FLAT):
        raise InputError("scene", "pads.on", face, "this face is not flat; flat faces are allowed")
    return outward(face, mean, a.mean(axis=0), mesh.points)


def outward(face: str, normal: Array, middle: Array, points: Array) -> Array:
    """A face's normal (3,) that points out of the body of these points (N, 3), where the middle (3,) of the face is.

    That of a face in the middle of a flat body points where its name says.  Raises an `InputError` if it says nothing.
    """
    along = float(normal @ (middle - (points.min(axis=0) + points.max(axis=0)) / 2.0))
    if abs(along) <= BESIDE * np.ptp(points, axis=0).max():
        along = float(normal @ FACES[face].normal) if face in FACES else 0.0
        if abs(along) <= np.sqrt(0.5):
            allowed = "this face lies in the middle of the body, where its name says which side is outside: "
            raise InputError("scene", "pads.on", face, f"{allowed}bottom and top are along z, left and right along y")
    return np.asarray(normal * np.sign(along)) + 0.0
