"""What beams share: coordinates on nodes along an axis, as many on each as it has directions, and places there."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
import ufl
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.fem.compat import MPI, cellwise, constant, create_mesh
from pmr.fields.envelope import ForceRows
from pmr.fields.series import Grid
from pmr.fields.stress import StressRows
from pmr.models import DIRECTIONS, Cut, Line, UnitState, rigid_motions
from pmr.scene.structures import Beam3DBody, Profile

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Named places, as shares of the length.
ENDS = {"tail": 0.0, "tip": 1.0}
#: N2, N3 / h, N5, N6 / h as polynomials in xi in [0, 1], highest power first.
HERMITE = np.array([[2.0, -3.0, 0.0, 1.0], [1.0, -2.0, 1.0, 0.0], [-2.0, 3.0, 0.0, 0.0], [1.0, -1.0, 0.0, 0.0]])


class Beam(ABC):
    """A model whose coordinates are ordered node by node, each along one of its directions or about it."""

    body: Profile | Beam3DBody

    @property
    @abstractmethod
    def node_stations(self) -> Array: ...

    @property
    @abstractmethod
    def directions(self) -> tuple[str, ...]: ...

    @property
    @abstractmethod
    def masses(self) -> Array:
        """The mass per length rho A of each element, (E,) kg/m."""

    @abstractmethod
    def motion(self, place: str | float, about: Array | None = None) -> sp.csr_matrix: ...

    @abstractmethod
    def on_nodes(self, stations: Array) -> Line:
        """The same beam with nodes (N,) m; between two at one place it is cut."""

    @abstractmethod
    def interpolated(self, places: Array) -> sp.csr_matrix:
        """What coordinates on nodes at the places (k,) m along the axis would be, (k d, n)."""

    @property
    @abstractmethod
    def resultants(self) -> Array:
        """The section's forces, in the order of `FORCES`, of unit forces on a node's coordinates, (E, k, d)."""

    @abstractmethod
    def section_forces(self) -> ForceRows: ...

    @abstractmethod
    def corner_stresses(self, forces: ForceRows, element: Indices) -> StressRows | None: ...

    def stresses(self) -> StressRows | None:
        """As `corner_stresses`, of the `section_forces`."""
        return self.corner_stresses(self.section_forces(), np.repeat(np.arange(len(self.grid.cells)), 2))

    def cut(self, parts: int) -> Cut:
        """The beam in so many pieces an element."""
        x, shares, d = self.node_stations, np.arange(parts) / parts, len(self.directions)
        places = np.append((x[:-1, None] + np.diff(x)[:, None] * shares).ravel(), x[-1])
        beam, number = self.on_nodes(np.repeat(places, 2)[1:-1]), np.repeat(np.arange(len(places)), 2)[1:-1]
        between = np.flatnonzero(np.arange(len(places)) % parts)
        column = np.full(len(places), -1)
        column[between] = np.arange(len(between))
        inner = np.flatnonzero(column[number] >= 0)
        shape = (len(number), len(between))
        picked = sp.csr_matrix((np.ones(len(inner)), (inner, column[number[inner]])), shape=shape)
        joined = sp.csr_matrix(sp.kron(picked, sp.eye(d)))
        pieces = parts * (len(x) - 1)
        return Cut(beam, self.interpolated(beam.node_stations), joined, np.repeat(np.arange(pieces), 2) // parts)

    def end_forces(self) -> sp.csr_matrix:
        cells, (_, k, d) = self.grid.cells, self.resultants.shape
        signed = self.resultants[:, None] * np.array([-1.0, 1.0])[:, None, None]  # (E, 2, k, d)
        columns = np.broadcast_to(d * cells[:, :, None, None] + np.arange(d), signed.shape)
        entries, columns = (np.moveaxis(part, 2, 0).ravel() for part in (signed, columns))
        rows = k * cells.size
        found = sp.csr_matrix((entries, columns, d * np.arange(rows + 1)), (rows, self.size))
        found.eliminate_zeros()
        return found

    @property
    def size(self) -> int:
        return len(self.directions) * len(self.node_stations)

    def domain(self, comm: MPI.Comm) -> Any:
        return create_mesh(comm, "interval", self.node_stations[:, None], self.grid.cells)

    def element_coordinates(self, cells: Indices) -> list[Indices]:
        nodes = self.grid.cells[cells]
        return [len(self.directions) * nodes + i for i in range(len(self.directions))]

    def axial_force(self, mesh: Any, state: UnitState) -> Any:
        r"""N(x) in N, tension positive, of the beam held at its tail, in UFL on a dolfinx mesh.

        .. math:: N = -\int_x^L \rho A\, (a + b \xi)\, d\xi + \sum_{x_i > x} F_i
        """
        mass, ends, middle, h = self._elements_of_mass()
        a, b = (float(value) for value in (state.acceleration[0], state.stretch))
        x, own, end = ufl.SpatialCoordinate(mesh)[0], cellwise(mesh, mass), cellwise(mesh, ends)
        beyond = self._beyond(mass * h * (a + b * middle))
        a, b = constant(mesh, a), constant(mesh, b)
        pulled = self._pulled(mesh, state, 0)[0] - cellwise(mesh, beyond)
        return pulled - own * (a * (end - x) + b * (end**2 - x**2) / 2.0)

    def moment(self, mesh: Any, state: UnitState, component: int) -> Any:
        r"""M(x) = EI w'' in N m of bending along y (`component` 1) or z (2), likewise.

        .. math:: M = -\int_x^L \rho A\, a\, (\xi - x)\, d\xi + \sum_{x_i > x} F_i\, (x_i - x)
        """
        mass, ends, middle, h = self._elements_of_mass()
        x, a = ufl.SpatialCoordinate(mesh)[0], constant(mesh, float(state.acceleration[component]))
        force, arm = self._pulled(mesh, state, component)
        beyond, first = (cellwise(mesh, self._beyond(mass * h * by)) for by in (np.ones_like(h), middle))
        own = cellwise(mesh, mass) * (cellwise(mesh, ends) - x) ** 2 / 2.0
        return arm - force * x - a * (own + first - beyond * x)

    def _elements_of_mass(self) -> tuple[Array, Array, Array, Array]:
        """Mass per length, end, middle and length of each element, (E,) each."""
        ends = self.node_stations[self.grid.cells]
        return self.masses, ends[:, 1], ends.mean(axis=1), np.diff(ends)[:, 0]

    @staticmethod
    def _beyond(values: Array) -> Array:
        """Sums over the elements beyond each."""
        return np.append(np.cumsum(values[:0:-1])[::-1], 0.0)

    def _pulled(self, mesh: Any, state: UnitState, component: int) -> tuple[Any, Any]:
        """Sums of forces and of forces times their places beyond each element."""
        middle = self.node_stations[self.grid.cells].mean(axis=1)
        sums = np.zeros((2, len(middle)))
        for place, force in state.forces:
            at = self.station(place)
            sums += np.array([[1.0], [at]]) * force[component] * (at > middle)
        return cellwise(mesh, sums[0]), cellwise(mesh, sums[1])

    def displacement(self, place: str | float) -> sp.csr_matrix:
        return self.motion(place)[[i for i, d in enumerate(self.directions) if d in "xyz"]]

    def station(self, place: str | float) -> float:
        """Distance of a place from the beam's first end in m.

        Raises an `InputError` if it is not on the beam.
        """
        length = self.body.length
        at = ENDS[place] * length if isinstance(place, str) and place in ENDS else place
        slack = 1e-9 * length  # round-off of a caller's arithmetic
        if isinstance(at, str) or not -slack <= at <= length + slack:
            raise InputError("scene", "place", place, f"tail, tip or a number from 0 to {length:g} m is allowed")
        return min(max(float(at), 0.0), length)

    def centroid(self, place: str | float) -> Array:
        return self.station(place) * np.eye(3)[0]

    def coordinates_on(self, place: str, directions: Sequence[str]) -> Indices:
        if place not in ENDS:
            raise InputError("scene", "place", place, "tail or tip is allowed")
        first = round(ENDS[place] * (self.size - len(self.directions)))
        return first + np.array([i for i, d in enumerate(self.directions) if d in directions], np.int64)

    def rigid_motions(self) -> Array:
        own = [DIRECTIONS.index(direction) for direction in self.directions]
        nodes = self.grid.points
        return rigid_motions(np.repeat(nodes, len(own), axis=0), np.tile(own, len(nodes)))[:, own]

    @property
    def grid(self) -> Grid:
        """The axis as lines."""
        first = np.flatnonzero(np.diff(self.node_stations))  # not where it is cut
        return Grid("line", self.node_stations[:, None] * np.eye(3)[0], first[:, None] + np.arange(2))

    def point_displacements(self) -> sp.csr_matrix:
        nodes, along = np.arange(len(self.node_stations))[:, None], [d for d in self.directions if d in "xyz"]
        rows = 3 * nodes + ["xyz".index(d) for d in along]
        columns = len(self.directions) * nodes + [self.directions.index(d) for d in along]
        return sp.csr_matrix((np.ones(rows.size), (rows.ravel(), columns.ravel())), (3 * len(nodes), self.size))
