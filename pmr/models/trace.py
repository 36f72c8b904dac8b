r"""Measures on a group of a mesh: the mean motion of its points, and the strip of a flat face that a pad sweeps.

The mean displacement and mean rotation on a group :math:`\Gamma` with the points x, the displacement u and the centroid
:math:`\bar x` are

.. math::
    \bar u = \frac{1}{|\Gamma|} \int_\Gamma u \, d\Gamma, \qquad
    \bar\theta = J^{-1} \int_\Gamma r \times u \, d\Gamma, \qquad
    J = \int_\Gamma (r \cdot r) I - r r^T \, d\Gamma, \qquad r = x - \bar x

with the unit matrix I.  They are the displacement and rotation of the rigid motion nearest to u in the mean square.
They are conjugate in work to a force spread evenly over the group, and to a moment spread in proportion to the distance
from the group's centroid.  This is the interpolation element (RBE3) of structural codes with the group's measure as
weight.  MSC Nastran Linear Static Analysis User's Guide, chapter on R-type elements.

The strip of a flat face is a set of quadrature points close together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from pmr.errors import InputError
from pmr.fem.compat import cell_topology, lagrange_rule
from pmr.files.arrays import Array, Indices
from pmr.models.mesh_nodes import Nodes
from pmr.models.named_mesh import Group, NamedMesh, unit_normals

ENTITY_KINDS = {(0, 1): "point", (1, 2): "interval", (2, 3): "triangle", (2, 4): "quadrilateral",
                (3, 4): "tetrahedron", (3, 8): "hexahedron"}  # fmt: skip
#: Kinds of cells with a constant Jacobian.
SIMPLICES = ("interval", "triangle", "tetrahedron")
QUADRATURE_DEGREE = 4


@dataclass(frozen=True)
class Trace:
    """Rows on n coordinates that measure the displacement at q quadrature points of a group."""

    name: str  # of the group
    points: Array  # (q, 3) m
    weights: Array  # (q,) m^dim, with the Jacobian: their sum is the group's measure (of points: their number)
    values: Sequence[sp.csr_matrix]  # three matrices (q, n): displacement along x, y, z
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m: from the points' centroid to the point that is measured

    @property
    def measure(self) -> float:
        """Measure of the group: number of points, length (m), area (m^2) or volume (m^3)."""
        return float(self.weights.sum())

    @property
    def centroid(self) -> Array:
        """Point (3,) in m whose motion is measured: the centroid of the group's points, plus `offset`."""
        return np.asarray(self.weights @ self.points / self.measure + self.offset)

    @cached_property
    def mean(self) -> sp.csr_matrix:
        """Rows (3, n) of the displacement of the measured point `centroid`, which follows the group's mean motion.

        Without an `offset` it is the mean displacement.  With an `offset` the mean rotation adds its part, and the
        property raises the `InputError` of `rotation`.
        """
        mean = sp.csr_matrix(self.weights / self.weights.sum())
        mean_rows = sp.vstack([mean @ component for component in self.values], format="csr")
        return (
            mean_rows + sp.csr_matrix(-_cross_matrix(np.array(self.offset))) @ self.rotation
            if any(self.offset)
            else mean_rows
        )

    def shift_to(self, axis: int, place: float) -> Trace:
        """Trace of a point that is moved along an `axis`, 0 to 2, until its coordinate there is `place` in m.

        The point that this trace measures (`centroid`, with any `offset`) moves; its other two coordinates stay.  For
        example, a point with the offset 1 m and the coordinate 1.5 m has the offset 2.5 m after a shift to 3 m.  If the
        point's coordinate is `place` already, up to 1e-9 of the group's size, this trace itself is returned.
        """
        shift = np.eye(3)[axis] * (place - self.centroid[axis])
        close = np.abs(shift).max() <= 1e-9 * np.abs(self.points - self.centroid).max(initial=0.0)
        return self if close else replace(self, offset=tuple((self.offset + shift).tolist()))

    def motion(self, about: Array | None = None) -> sp.csr_matrix:
        """Rows (6, n) of displacement and rotation of the point `about` (3,) in m, by the group's mean motion.

        By default the point is the measured one, `centroid`.  Raises the `InputError` of `rotation`.
        """
        arm = np.zeros(3) if about is None else np.asarray(about, float) - self.centroid
        return sp.vstack([self.mean + sp.csr_matrix(-_cross_matrix(arm)) @ self.rotation, self.rotation], format="csr")

    @cached_property
    def rotation(self) -> sp.csr_matrix:
        """Rows (3, n) of the mean rotation.

        Raises an `InputError` if the group's points lie on a line: the rotation about the line is then undetermined.
        """
        r, w = self.points - self.centroid + self.offset, self.weights
        J = np.eye(3) * (w @ (r**2).sum(axis=1)) - (r.T * w) @ r
        if np.linalg.eigvalsh(J)[0] <= 1e-9 * max(np.trace(J), 1e-300):
            allowed = (
                "points of this group lie on a line, so the rotation about that line is not defined; an area is allowed"
            )
            raise InputError("scene", "place", self.name, allowed)
        x, y, z = (r * w[:, None]).T
        ux, uy, uz = self.values
        moments = sp.csr_matrix(np.stack([uz.T @ y - uy.T @ z, ux.T @ z - uz.T @ x, uy.T @ x - ux.T @ y]))
        return sp.csr_matrix(sp.csr_matrix(np.linalg.inv(J)) @ moments)


def group_trace(mesh: NamedMesh, nodes: Nodes, name: str, parts: int = 1) -> Trace:
    """Trace of the displacement on the group called `name`.  In each entity of the group the displacement is quadratic.

    Each entity is cut into `parts` along every direction.  Several parts give more quadrature points, for weights that
    vary within the entity.

    Raises an `InputError` if the mesh has no such group, or the group's entities are not part of the mesh's cells.
    """
    group = _named_group(mesh, name)
    kind = ENTITY_KINDS[group.dim, group.entities.shape[1]]
    weights, shape, _ = lagrange_rule(kind, 2, QUADRATURE_DEGREE, parts)
    _, linear, slopes = lagrange_rule(kind, 1, QUADRATURE_DEGREE, parts)
    corners = mesh.points[group.entities]
    if kind in SIMPLICES:
        slopes = slopes[:, :1]
    jacobian = np.einsum("dqk,eki->eqid", slopes, corners, optimize=True)
    metric = np.einsum("eqic,eqid->eqcd", jacobian, jacobian)
    measure = np.sqrt(np.linalg.det(metric)) if group.dim else np.ones((1, 1))
    first = _entity_nodes(mesh, nodes, name)
    order = np.argsort(first, axis=1)
    columns = np.repeat(np.take_along_axis(first, order, axis=1)[:, None, :], len(weights), axis=1)
    ends = np.arange(0, columns.size + 1, first.shape[1])
    size = (len(first) * len(weights), nodes.size)
    along_x = sp.csr_matrix((shape[:, order].swapaxes(0, 1).ravel(), columns.ravel(), ends), shape=size)
    return Trace(
        name,
        points=(linear @ corners).reshape(-1, 3),
        weights=(measure * weights * np.ones((len(first), 1))).ravel(),
        values=[sp.csr_matrix((along_x.data, along_x.indices + c, along_x.indptr), shape=size) for c in range(3)],
    )


def section_trace(mesh: NamedMesh, nodes: Nodes, at: float) -> Trace:
    """Trace of the displacement on the cross-section at the coordinate `at` (m) along the mesh's longest extent.

    A mesh need not have nodes in the cross-section.  Therefore the trace is a mean over the cells around it.  The
    weights are a hat: largest in the cross-section, and zero at a distance of the longest cell that touches it.  The
    measured point is shifted into the cross-section (`Trace.shift_to`).

    Raises an `InputError` if the mesh does not reach the cross-section.
    """
    axis, (low, high) = mesh.axis, mesh.spans
    slack = 1e-9 * (high.max() - low.min())  # round-off of a caller's arithmetic
    if low.min() - slack <= at <= high.max() + slack:
        at = float(np.clip(at, low.min(), high.max()))
    is_near = (low <= at) & (at <= high)
    if not is_near.any():
        allowed = f"a group or a number from {low.min():g} to {high.max():g} m is allowed"
        raise InputError("scene", "place", at, allowed)
    reach = float((high - low)[is_near].max())
    near = np.flatnonzero((high > at - reach) & (low < at + reach))
    name, dim = f"section at {at:g} m", 2 if mesh.cell == "triangle" else 3
    cut = replace(mesh, groups={name: Group(dim, mesh.cells[near])}, regions={name: near})
    cells_around = group_trace(cut, nodes, name, parts=2 if dim == 2 else 1)
    hat = np.maximum(0.0, 1.0 - np.abs(cells_around.points[:, axis] - at) / reach)
    return replace(cells_around, weights=cells_around.weights * hat).shift_to(axis, at)


def coordinates_on(mesh: NamedMesh, nodes: Nodes, name: str, components: Sequence[int]) -> Indices:
    """Ascending numbers (k,) of the coordinates with the given `components` whose nodes lie on the group `name`.

    Raises the errors of `group_trace`.
    """
    group = _named_group(mesh, name)
    coordinates = []
    for dim, parts in enumerate(_topology(group)):
        carried = len(nodes.components.get(dim, ()))
        if carried:
            coordinates.append((_part_coordinates(mesh, nodes, name, parts)[..., None] + np.arange(carried)).ravel())
    on = np.unique(np.concatenate(coordinates))
    return on[np.isin(nodes.component[on], components)]


def _named_group(mesh: NamedMesh, name: str) -> Group:
    """The group called `name`; raises an `InputError` if the mesh has none of this name."""
    mesh.require([name])
    return mesh.groups[name]


def _topology(group: Group) -> list[list[list[int]]]:
    """Vertex numbers of the vertices, edges, faces and interior of a group's reference cell, one list per dimension."""
    return cell_topology(ENTITY_KINDS[group.dim, group.entities.shape[1]]) if group.dim else [[[0]]]


def _entity_nodes(mesh: NamedMesh, nodes: Nodes, name: str) -> Indices:
    """First coordinates (e, k) of the k displacement nodes on each of e entities, in the order of Lagrange functions.

    The entities are those of the group `name`.  Raises the InputError of `_part_coordinates`.
    """
    tables = [
        _part_coordinates(mesh, nodes, name, parts)
        for dim, parts in enumerate(_topology(mesh.groups[name]))
        if 0 in nodes.components.get(dim, ())
    ]
    return np.concatenate(tables, axis=1)


def _part_coordinates(mesh: NamedMesh, nodes: Nodes, name: str, parts: list[list[int]]) -> Indices:
    """First coordinates (e, p) of the nodes on p sub-entities of each of the e entities of the group `name`.

    `parts` are the vertices of the sub-entities on the reference cell.  Raises an `InputError` if a sub-entity belongs
    to no cell of the mesh.
    """
    entities = mesh.groups[name].entities
    vertices = entities[:, parts]
    dim = {1: 0, 2: 1}.get(vertices.shape[2], mesh.groups[name].dim if len(parts) == 1 else 2)
    if dim == 3:
        return nodes.first[3][mesh.regions[name]][:, None]
    try:
        first = nodes.first_coordinates(vertices.reshape(-1, vertices.shape[2]), dim, len(mesh.points))
    except KeyError as error:
        raise InputError(mesh.source, "", None, f"group {name}: {error.args[0]}") from None
    return first.reshape(vertices.shape[:2])


def _cross_matrix(a: Array) -> Array:
    """Matrix (3, 3) of the cross product a x (.)."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


#: Cosine of the largest angle between a flat face's cells and their mean normal.
FLAT = 0.9999
#: Suffix of the names of groups of cells that join two parts of a flat face, of which one is farther out.
RAMP = " ramp"
#: A face counts as in the body's middle up to this distance, as a share of the body's extent.
BESIDE = 1e-6
#: Most pieces into which the cells of a strip are cut for a pad; more of them take gigabytes.
MOST_PIECES = 500_000


@dataclass(frozen=True)
class Window:
    """A rectangle on a face: its extents along and across the body's axis, and the largest spacing of points, in m."""

    along: tuple[float, float]
    across: tuple[float, float]
    spacing: tuple[float, float]


@dataclass(frozen=True)
class Plane:
    """Directions of a face of a body along x, without the distance of the face from the axis."""

    normal: Array  # (3,): unit vector out of the face
    across: Array  # (3,): unit vector across the axis in the face; coordinates across are 0 nearest to the axis


#: Faces that every body has; z is up.
FACES = {
    name: Plane(sign * np.eye(3)[component], np.eye(3)[3 - component])
    for name, component, sign in (("bottom", 2, -1.0), ("top", 2, 1.0), ("left", 1, 1.0), ("right", 1, -1.0))
}


@dataclass(frozen=True)
class Extent:
    """Extent of a face along the body's axis and across it, m; `across` is None for a line."""

    along: tuple[float, float]
    across: tuple[float, float] | None = None

    def __str__(self) -> str:
        across = "" if self.across is None else ", {:.4g} to {:.4g} m across".format(*self.across)
        return "{:.4g} to {:.4g} m along the axis".format(*self.along) + across


@dataclass(frozen=True)
class Strip:
    """The q quadrature points of a face within a window; there are none where the window is outside of the face.

    The rows `normal` (q, n) act on the n coordinates of a model.
    """

    along: Array  # (q,) m on the body's axis
    across: Array  # (q,) m: y or z if the face is along one of them, else along the face upwards
    weights: Array  # (q,): weights of quadrature in m^2, on a line in m
    normal: sp.csr_matrix  # (q, n): rows that measure the displacement along the outward normal
    extent: Extent  # of the whole face
    line: bool = False  # whether the points are on the line that represents a beam's face


@dataclass(frozen=True)
class FlatFace:
    """A flat face along the axis of a mesh, and the bounds of its cells."""

    mesh: NamedMesh
    name: str
    normal: Array  # (3,): unit vector out of the mesh
    axes: Array  # (2, 3): unit vectors along the body's axis and across the face
    least: Array  # (e, 2) m: smallest coordinates of each cell of the face along these axes
    most: Array  # (e, 2) m: largest coordinates of each cell

    @property
    def extent(self) -> Extent:
        """Extent of the whole face."""
        low, high = self.least.min(axis=0).tolist(), self.most.max(axis=0).tolist()
        return Extent((low[0], high[0]), (low[1], high[1]))


def flat_face(mesh: NamedMesh, name: str) -> FlatFace:
    """Flat face called `name`, with its normal, its axes and the bounds of its cells, including the cells of its ramps.

    Raises an `InputError` if there is no such face, it is not flat, or it lies across the axis.
    """
    group, axis = _named_group(mesh, name), mesh.axis
    if group.dim != 2:
        raise InputError(mesh.source, "", None, f"group {name} is not a face; pads slide on faces only")
    normal = _face_normal(mesh, group, name)
    if abs(normal[axis]) > np.sqrt(1.0 - FLAT**2):
        raise InputError("scene", "pads.on", name, "this face lies across the body's axis; faces along it are allowed")
    unit = np.eye(3)
    axes = np.array([unit[axis], unit[np.argmin(np.abs(normal) + unit[axis])]])
    if abs(normal @ axes[1]) > np.sqrt(1.0 - FLAT**2):  # the face is slanted
        axes[1] = np.cross(normal, unit[axis])
        axes[1] *= np.sign(axes[1][2] or axes[1].sum()) / np.linalg.norm(axes[1])
    if (ramps := mesh.groups.get(name + RAMP)) is not None:
        group = Group(2, np.concatenate([group.entities, ramps.entities]))
        mesh = replace(mesh, groups={**mesh.groups, name: group})
    corners = (mesh.points @ axes.T)[group.entities]
    return FlatFace(mesh, name, normal, axes, corners.min(axis=1), corners.max(axis=1))


def face_strip(face: FlatFace, nodes: Nodes, window: Window) -> Strip:
    """Strip of a face within a window, for quadratic displacements on `nodes`; without points if no cell is inside.

    Raises an `InputError` if cells are so much larger than the window's spacing that there would be too many points.
    """
    mesh, name = face.mesh, face.name
    low, high = np.array([window.along, window.across]).T
    inside = np.flatnonzero(((face.most > low) & (face.least < high)).all(axis=1))
    if not len(inside):
        nothing = np.empty(0)
        return Strip(nothing, nothing, nothing, sp.csr_matrix((0, nodes.size)), face.extent)
    sizes = (face.most[inside] - face.least[inside]).max(axis=0)
    parts = int(np.ceil(np.max(sizes / window.spacing) - 1e-9))  # mirrored pads get as many
    if parts**2 * len(inside) > MOST_PIECES:
        allowed = f"cells of this face are up to {parts} times as large as a pad resolves; finer cells or larger pads"
        raise InputError("scene", "pads.on", name, f"{allowed} are allowed")
    cut = replace(mesh, groups={name: Group(2, mesh.groups[name].entities[inside])})
    points = group_trace(cut, nodes, name, parts=max(1, parts))
    place = points.points @ face.axes.T
    within = np.flatnonzero(((place > low) & (place < high)).all(axis=1))
    displacement = sum(c * component[within] for c, component in zip(face.normal, points.values, strict=True) if c)
    displacement.eliminate_zeros()
    return Strip(place[within, 0], place[within, 1], points.weights[within], displacement, face.extent)


def line_points(window: Window, stations: Array) -> Array:
    """Coordinates and weights of Gauss' rule on a beam's axis within a window, the rows of an array (2, q) in m.

    The rule is exact for a linear weight times a cubic.  The axis is cut at its `stations` (nodes, ascending) and at
    multiples of the window's spacing from the window's start.  There are no points if the window is off the axis.
    """
    if window.along[0] >= stations[-1] or window.along[1] <= stations[0]:
        return np.empty((2, 0))
    start, end = max(window.along[0], stations[0]), min(window.along[1], stations[-1])
    cuts = np.arange(window.along[0], window.along[1], window.spacing[0])
    inner = np.concatenate([stations, cuts])
    ends = np.unique(np.concatenate([[start, end], inner[(inner > start) & (inner < end)]]))
    x, w = np.polynomial.legendre.leggauss(3)
    middle, half = (ends[1:] + ends[:-1])[:, None] / 2.0, np.diff(ends)[:, None] / 2.0
    return np.array([(middle + half * x).ravel(), (half * w).ravel()])


def _face_normal(mesh: NamedMesh, group: Group, face: str) -> Array:
    """Outward unit normal (3,) of the face called `face`; `group` has the face's entities.

    The order of the entities' vertices does not matter.  Raises an `InputError` if the face is not flat.
    """
    corners = mesh.points[group.entities]
    normals = unit_normals(corners)
    normals *= np.sign(normals @ normals[0])[:, None]
    mean = normals.mean(axis=0)
    mean /= np.linalg.norm(mean)
    if np.any(normals @ mean < FLAT):
        raise InputError("scene", "pads.on", face, "this face is not flat; flat faces are allowed")
    return orient_outward(face, mean, corners[:, 0].mean(axis=0), mesh.points)


def orient_outward(face: str, normal: Array, middle: Array, points: Array) -> Array:
    """The `normal` (3,) of a face, turned to point out of the body of `points` (N, 3).

    `middle` (3,) is the face's middle.  If it is in the middle of a flat body, the name of the face decides, by the
    direction that `FACES` gives for it.  Raises an `InputError` if `FACES` gives no direction, or one at 45 degrees or
    more to the normal and its opposite.
    """
    along = float(normal @ (middle - (points.min(axis=0) + points.max(axis=0)) / 2.0))
    if abs(along) <= BESIDE * np.ptp(points, axis=0).max():
        along = float(normal @ FACES[face].normal) if face in FACES else 0.0
        if abs(along) <= np.sqrt(0.5):
            allowed = "this face lies in the middle of the body, where its name says which side is outside: "
            raise InputError("scene", "pads.on", face, f"{allowed}bottom and top are along z, left and right along y")
    return np.asarray(normal * np.sign(along)) + 0.0
