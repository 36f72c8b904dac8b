r"""Planar Euler-Bernoulli beam with C1 cubic Hermite elements.

.. math::
    k(w, \delta w) = \int EI\, w'' \delta w'' + EA\, u' \delta u' \, dx, \qquad
    m(w, \delta w) = \int \rho A\, (w\, \delta w + u\, \delta u) \, dx

Shear deformation and rotary inertia are neglected.  Cook, Malkus, Plesha: Concepts and Applications of Finite Element
Analysis, 3rd ed., 1989, sections 4.2 and 13.3; H. P. Gavin: Structural Element Stiffness, Mass, and Damping
Matrices, 2020.  Coordinates are ordered node by node: [u,] w, w'.  z is up: w is the displacement along z, and the
rotation about y is -w'.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
import ufl
from numpy.typing import NDArray

from pmr.constraints.rows import Row, row_on_coordinates
from pmr.errors import InputError
from pmr.fem.compat import MPI, constant, hermite_space, interval_mesh
from pmr.fields.grid import Grid
from pmr.mesh.strip import Extent, Strip, Window, line_points
from pmr.models import Forms
from pmr.scene.structures import Profile

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Named places, as shares of the length.
ENDS = {"tail": 0.0, "tip": 1.0}
FACES = {"bottom": -1.0, "top": 1.0}  # outward normals along z


@dataclass(frozen=True)
class Beam2D:
    """The model on given nodes (N,) m."""

    body: Profile
    nodes: Array

    @property
    def per_node(self) -> int:
        return len(self.directions)

    @property
    def size(self) -> int:
        """Number of coordinates n."""
        return self.per_node * len(self.nodes)

    @property
    def reference_frequency(self) -> float:
        """sqrt(EI / (rho A L^4)) in rad/s: the scale of the lowest frequencies."""
        body = self.body
        return float(np.sqrt(body.bending_stiffness / body.mass_per_length) / body.length**2)

    @property
    def round_off(self) -> float:
        """Relative error to expect in the lowest frequency from round-off in the stiffness, measured: 2e-17 times the
        sum of (L / h)^3 over the elements.

        Entries of 12 EI / h^3 have to cancel to leave rigid rotation free; what is left of them in each element acts as
        a spring.
        """
        return float(2e-17 * np.sum((self.body.length / np.diff(self.nodes)) ** 3))

    @property
    def node_stations(self) -> Array:
        return self.nodes

    @property
    def directions(self) -> tuple[str, ...]:
        return ("x", "z", "ry") if self.body.axial else ("z", "ry")

    @property
    def transformation(self) -> None:
        """None: the space's coordinates are the model's."""

    def domain(self, comm: MPI.Comm) -> Any:
        return interval_mesh(comm, self.nodes)

    def space(self, domain: Any) -> Any:
        """Function space on a dolfinx interval mesh."""
        return hermite_space(domain, linear=int(self.body.axial))

    def forms(self, space: Any) -> Forms:
        """Mass and stiffness as UFL forms."""
        mesh, body = space.mesh, self.body
        trial, test = ufl.TrialFunction(space), ufl.TestFunction(space)
        J = ufl.JacobianDeterminant(mesh)
        EI, rhoA = constant(mesh, body.bending_stiffness), constant(mesh, body.mass_per_length)
        i = self.directions.index("z")
        w, dw = trial[i] + J * trial[i + 1], test[i] + J * test[i + 1]
        dx = ufl.Measure("dx", domain=mesh, metadata={"quadrature_degree": 6})
        mass = rhoA * w * dw * dx
        stiffness = EI * w.dx(0).dx(0) * dw.dx(0).dx(0) * dx
        if body.axial and body.axial_stiffness is not None:
            u, du = trial[0], test[0]
            mass += rhoA * u * du * dx
            stiffness += constant(mesh, body.axial_stiffness) * u.dx(0) * du.dx(0) * dx
        return Forms(mass, stiffness)

    def point(self, x: float, direction: str) -> tuple[NDArray[np.int64], Array]:
        """Coordinates (d,) and weights (d,) of the displacement along x or z, or rotation ry: exact interpolation.

        The same row applies a point force (or moment) there and measures a point displacement.
        """
        e = min(max(int(np.searchsorted(self.nodes, x, side="right")) - 1, 0), len(self.nodes) - 2)
        h = self.nodes[e + 1] - self.nodes[e]
        xi = (x - self.nodes[e]) / h
        if direction == "x":
            dofs, values = [self._dof(e, "x"), self._dof(e + 1, "x")], np.array([1.0 - xi, xi])
        else:
            dofs = self._bending_dofs(e)
            slope = direction == "ry"
            values = (SLOPES if slope else HERMITE) @ xi ** np.arange(2.0 if slope else 3.0, -1.0, -1.0)
            values[[1, 3]] *= h
            if slope:
                values /= -h
        used = np.abs(values) > 1e-14
        return np.array(dofs, np.int64)[used], values[used]

    def element_coordinates(self, cells: Indices) -> list[Indices]:
        first = self.per_node * cells[:, None] + np.array([0, self.per_node])
        return [first + i for i in range(self.per_node)]

    def displacement(self, place: str | float) -> sp.csr_matrix:
        return self._at(place, self.directions[:-1])

    def motion(self, place: str | float, about: Array | None = None) -> sp.csr_matrix:
        if about is not None:
            raise InputError(
                "scene", "place", place, "the place itself is allowed: a planar beam has no points beside it"
            )
        return self._at(place, self.directions)

    def _at(self, place: str | float, directions: Sequence[str]) -> sp.csr_matrix:
        """Rows of some of the directions."""
        x = station(place, self.body.length)
        parts = [self.point(x, direction) for direction in directions]
        ends = np.cumsum([0, *(len(dofs) for dofs, _ in parts)])
        columns, weights = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        return sp.csr_matrix((weights, columns, ends), shape=(len(parts), self.size))

    def centroid(self, place: str | float) -> Array:
        return np.array([station(place, self.body.length), 0.0, 0.0])

    def strip(self, face: str, window: Window) -> Strip:
        """The line that stands for bottom or top; how far below or above the axis it is plays no role."""
        if face not in FACES:
            raise InputError("scene", "pads.on", face, f"a planar beam has the faces {', '.join(FACES)}")
        points, weights = line_points(window, self.nodes)
        across = np.full(len(points), sum(window.across) / 2.0)
        rows = sp.lil_matrix((len(points), self.size))
        for i, x in enumerate(points):
            dofs, values = self.point(float(x), "z")
            rows[i, dofs] = FACES[face] * values
        return Strip(points, across, weights, rows.tocsr(), Extent((0.0, self.body.length)), line=True)

    def coordinates_on(self, place: str, directions: Sequence[str]) -> Indices:
        if place not in ENDS:
            raise InputError("scene", "place", place, "tail or tip is allowed")
        node = round(ENDS[place] * (len(self.nodes) - 1))
        return np.array([self._dof(node, d) for d in self.directions if d in directions], np.int64)

    def rigid_motions(self) -> Array:
        motions = np.zeros((self.size, self.per_node))
        for i, direction in enumerate(self.directions):
            motions[i :: self.per_node, i] = -1.0 if direction == "ry" else 1.0
        motions[self.directions.index("z") :: self.per_node, -1] = -self.nodes
        return motions

    @property
    def grid(self) -> Grid:
        """The axis as lines."""
        first, nothing = np.arange(len(self.nodes) - 1), np.zeros_like(self.nodes)
        return Grid("line", np.stack([self.nodes, nothing, nothing], axis=1), np.stack([first, first + 1], axis=1))

    def point_displacements(self) -> sp.csr_matrix:
        along = [i for i, d in enumerate("xyz") if d in self.directions]
        nodes = np.arange(len(self.nodes))[:, None]
        columns = self.per_node * nodes + [self.directions.index("xyz"[i]) for i in along]
        rows = 3 * nodes + along
        entries = np.ones(rows.size), (rows.ravel(), columns.ravel())
        return sp.csr_matrix(entries, shape=(3 * len(self.nodes), self.size))

    def stresses(self) -> None:
        """None: of the section no more than its stiffness is known."""

    def slider(self, offset: float = 0.0, name: str = "slider") -> Row:
        """The row w(s + offset) = 0 as an exact piecewise cubic in s; its multiplier is a force in N."""
        h = np.diff(self.nodes)
        powers = h ** -np.arange(3.0, -1.0, -1.0)[:, None]  # (s / h)^p, highest power first
        c = HERMITE.T[:, None, :] * powers[:, :, None]
        c[:, :, [1, 3]] *= h[:, None]
        dofs = np.array([self._bending_dofs(e) for e in range(len(h))], np.int64)
        return row_on_coordinates(name, self.nodes - offset, dofs, c, self.size)

    def _dof(self, node: int, direction: str) -> int:
        return self.per_node * node + self.directions.index(direction)

    def _bending_dofs(self, e: int) -> list[int]:
        return [self._dof(n, d) for n in (e, e + 1) for d in ("z", "ry")]


def station(place: str | float, length: float) -> float:
    """Distance of a place from the beam's first end in m.

    Raises
    ------
    InputError
        If it is not on the beam.
    """
    at = ENDS[place] * length if isinstance(place, str) and place in ENDS else place
    slack = 1e-9 * length  # round-off of a caller's arithmetic
    if isinstance(at, str) or not -slack <= at <= length + slack:
        raise InputError("scene", "place", place, f"tail, tip or a number from 0 to {length:g} m is allowed")
    return min(max(float(at), 0.0), length)


#: N2, N3 / h, N5, N6 / h as polynomials in xi in [0, 1], highest power first.
HERMITE = np.array([[2.0, -3.0, 0.0, 1.0], [1.0, -2.0, 1.0, 0.0], [-2.0, 3.0, 0.0, 0.0], [1.0, -1.0, 0.0, 0.0]])
SLOPES = np.array([np.polyder(shape) for shape in HERMITE])
