"""Common parts of beam models: coordinates on nodes along an axis, and rows that measure motions along it.

Each node has as many coordinates as the beam has directions.  Sections change at nodes, so that each element has
constants of its own.  A beam's coordinates are the displacements and rotations of points on its axis, which move with
the section.  The coordinates of its function space are others: the motion of the section's centroid and shear centre,
along its principal axes.  Where sections change, and where the beam is cut, the function space has two nodes at the
same point.

In shapes, N is the number of nodes, E of elements, K of sections, d of directions and n = N d that of coordinates.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
import ufl

from pmr.errors import InputError
from pmr.fem.compat import MPI, cellwise, create_mesh, integration_measure
from pmr.files.arrays import Array, Indices
from pmr.models import DIRECTIONS, Cut, FiniteElementModel, UnitState, rigid_motions
from pmr.models.meshed import CellValues, cell_values
from pmr.models.sections_along import SectionsAlong
from pmr.models.trace import Extent, Plane, Strip, Window, line_points
from pmr.results.field_series import Grid
from pmr.results.field_stress import ForceRows, StressRows, force_rows
from pmr.scene.members import Member
from pmr.scene.structures import Beam3DBody, Profile

if TYPE_CHECKING:
    from pmr.fem.compat import Expr, Function, FunctionSpace, Mesh


#: Positions of named places as shares of the length.
ENDS = {"tail": 0.0, "tip": 1.0}


class Beam(FiniteElementModel, ABC):
    """A beam model; coordinates are ordered node by node, and on each node by the model's directions.

    Letters in shapes are numbers: N of nodes, E of elements, K of sections, d of directions, and n = N d of coordinates
    q.  The function space has n_e other coordinates, T q (see `transformation`).  They are motions of the sections'
    centroids and shear centres along the sections' principal axes.
    """

    body: Profile | Beam3DBody

    @property
    @abstractmethod
    def node_stations(self) -> Array:
        """Coordinates (N,) in m of the beam's N nodes along its axis."""

    @abstractmethod
    def corner_stresses(self, forces: ForceRows, element: Indices) -> StressRows | None:
        """Stress rows in the profile's corners at both ends of the E elements, P = 2 E places; None without a profile.

        `forces` are the section forces at the P places in the order of `section_forces`; the result acts on the same
        coordinates.  `element` (P,) has the number that the result gives to the element of each place.  For the beam of
        a `Cut`, these are the numbers of the elements of the whole beam.
        """

    @property
    @abstractmethod
    def masses(self) -> Array:
        """Mass per length rho A (E,) in kg/m of each element, with the density rho and the area A."""

    @property
    @abstractmethod
    def signs(self) -> Array:
        """Signs (d,), 1 or -1: a coordinate of a node is its motion along or about a direction, times the sign."""

    @property
    @abstractmethod
    def sections(self) -> SectionsAlong | None:
        """Sections along the axis; None for a beam that is given by its stiffnesses."""

    @property
    @abstractmethod
    def node_transformations(self) -> Array:
        """Matrices (K, d, d), one per section, that turn a node's d coordinates into those of the function space."""

    @abstractmethod
    def shape_functions(self, h: Array, X: Array, number: Indices) -> Array:
        """Shape functions (q, d, 2 d): motion of the axis at a point in each of q elements by unit coordinates.

        Point i is at the share X[i] in [0, 1] of an element with length h[i] in m and section number[i]; h, X and
        number are (q,).  Rows are displacements along, then rotations about, the directions.  Columns are the d
        coordinates of the function space at the element's first node, then those at its second node.
        """

    @abstractmethod
    def faces(self, at: float) -> dict[str, tuple[Plane, Extent]]:
        """Faces for pads at the coordinate `at` (m) along the axis: the plane and extent of each face by its name."""

    @abstractmethod
    def strains(self, space: FunctionSpace) -> Expr:
        """UFL vector of the v generalised strains of a trial function on `space`; each belongs to a section force."""

    @property
    @abstractmethod
    def section_stiffness(self) -> dict[str, Array]:
        """Section forces (E, v) in N or N m in E elements per unit of each of v `strains`, by the forces' names."""

    @abstractmethod
    def on_nodes(self, stations: Array) -> Beam:
        """Copy of this beam with nodes at `stations` (N,) m, cut where two nodes are at the same point."""

    @abstractmethod
    def bending_stiffness(self, direction: str) -> dict[int, Array]:
        """Bending stiffness (E,) in N m^2 of E elements, by the number of the slope on which the moment does work.

        If the axial strain has the gradient 1/m along `direction`, y or z, the bending moment is this stiffness times
        1/m.  The moment does work on a slope, whose number among a node's coordinates in the function space is the key.
        The result is empty for a beam that does not bend along `direction`.
        """

    @property
    @abstractmethod
    def resultants(self) -> Array:
        """Section forces at a node of each of E elements per unit force on each of the node's d coordinates: (E, k, d).

        The k section forces are in the order of `pmr.results.field_stress.FORCES`.
        """

    @cached_property
    def section_number(self) -> Indices:
        """Number (E,) of the section of each element."""
        middles = self.node_stations[self.grid.cells].mean(axis=1)
        return np.zeros(len(middles), np.int64) if self.sections is None else self.sections.section_numbers(middles)

    @cached_property
    def first_node(self) -> Indices:
        """Number (E,) of the function space's node at each element's start; the node at its end has the next number."""
        cells = self.grid.cells
        apart = (np.diff(self.section_number) != 0) | (cells[1:, 0] != cells[:-1, 1])
        return np.arange(len(cells)) + np.append(0, np.cumsum(apart))

    @cached_property
    def transformation(self) -> sp.csr_matrix:
        """Matrix T (n_e, n) that gives the coordinates T q of the function space from the model's q."""
        d, size = len(self.directions), self.first_node[-1] + 2
        of, number = np.empty((2, size), np.int64)
        for k in (0, 1):
            of[self.first_node + k], number[self.first_node + k] = self.grid.cells[:, k], self.section_number
        shape = (d * size, d * len(self.node_stations))
        T = sp.bsr_matrix((self.node_transformations[number], of, np.arange(size + 1)), shape=shape).tocsr()
        T.eliminate_zeros()
        return T

    def bending_load(self, direction: str, gradient: float) -> sp.csr_matrix:
        r"""Row (1, n) of the load by an initial strain whose gradient along `direction`, y or z, is `gradient` in 1/m.

        The strain is zero at the centroid.  The gradient :math:`\kappa` acts on an element with the bending stiffness
        EI as moments :math:`\mp EI \kappa` at its ends.  Their work is the integral of :math:`EI \kappa\, \delta w''`
        along the element.  The row is zero for a direction along which the beam does not bend.
        """
        d, load = len(self.directions), np.zeros(len(self.directions) * (self.first_node[-1] + 2))
        for slope, stiffness in self.bending_stiffness(direction).items():
            np.add.at(load, d * (self.first_node + 1) + slope, -gradient * stiffness)
            np.add.at(load, d * self.first_node + slope, gradient * stiffness)
        return sp.csr_matrix(load @ self.transformation)

    def motions(self, places: Array) -> sp.csr_matrix:
        """Rows (k d, n) that measure the d displacements and rotations of the axis at `places` (k,) in m along it."""
        return self._axis_rows(places, np.eye(len(self.directions)))

    def _axis_rows(self, places: Array, combinations: Array) -> sp.csr_matrix:
        """Rows (k m, n), sparse, of m combinations of the axis' motions at each of k `places` (k,) in m along it.

        Row i m + j is combination j at place i.  `combinations` (m, d) are their coefficients: displacements along,
        then rotations about, the d directions.
        """
        d, x = len(self.directions), self.node_stations[self.grid.cells]
        e = np.clip(np.searchsorted(x[:, 0], places, side="right") - 1, 0, None)  # at a node, the element behind it
        h = np.diff(x)[e, 0]
        ends = combinations @ self.shape_functions(h, (places - x[e, 0]) / h, self.section_number[e])
        ends = ends.reshape(len(places), len(combinations), 2, d).swapaxes(1, 2)
        local = (
            ends @ self.node_transformations[self.section_number[e], None]
        )  # `transformation` of these elements alone
        columns = d * self.grid.cells[e][:, None, :, None] + np.arange(d)
        entries, columns = (part.ravel() for part in np.broadcast_arrays(local.swapaxes(1, 2), columns))
        starts = np.arange(0, entries.size + 1, 2 * d)
        rows = sp.csr_matrix((entries, columns, starts), (len(combinations) * len(places), d * len(self.node_stations)))
        rows.eliminate_zeros()
        return rows

    def motion(self, place: str | float, about: Array | None = None) -> sp.csr_matrix:
        """Rows (d, n) that measure a place's motion at the point `about` (3,) m, by default at the place's centroid.

        Raises the InputError of `station`.
        """
        at = self.station(place)
        return self._point_motions(np.array([at]), np.array([self.centroid(at) if about is None else about]))

    def _point_motions(self, at: Array, points: Array) -> sp.csr_matrix:
        """Rows (k d, n) of the motions of k points, which move with the sections at k distances along the axis.

        `at` (k,) are the distances and `points` (k, 3) the points, both in m.
        """
        rows, arms = self.motions(at), points - at[:, None] * np.eye(3)[0]
        if arms.any():
            numbers = [DIRECTIONS.index(direction) for direction in self.directions]
            motion = np.tile(np.eye(6), (len(at), 1, 1))
            motion[:, :3, 3:] = np.cross(np.eye(3), arms[:, None]).transpose(0, 2, 1)
            blocks = np.ascontiguousarray(motion[:, numbers][:, :, numbers])
            rows = sp.bsr_matrix((blocks, np.arange(len(at)), np.arange(len(at) + 1))).tocsr() @ rows
        rows.data[np.abs(rows.data) < 1e-14] = 0.0
        rows.eliminate_zeros()
        return rows

    def strip(self, face: str, window: Window) -> Strip:
        """Points within `window` on the line that represents a face, which is parallel to the axis.

        The height of the face above or below the axis does not matter.  Raises an `InputError` if the beam has no such
        face.
        """
        faces = self.faces(sum(window.along) / 2.0)
        if face not in faces:
            raise InputError("scene", "pads.on", face, f"this beam has the faces {', '.join(faces)}")
        plane, extent = faces[face]
        points, weights = line_points(window, self.node_stations)
        across = sum(window.across) / 2.0
        turning = np.cross(across * plane.across, plane.normal)  # (theta x arm) n = theta (arm x n)
        of = np.concatenate([plane.normal, turning])[[DIRECTIONS.index(direction) for direction in self.directions]]
        return Strip(
            points, np.full(len(points), across), weights, self._axis_rows(points, of[None]), extent, line=True
        )

    def section_forces(self) -> ForceRows:
        """Section forces at both ends of elements, as rows on the coordinates; exact without loads between nodes."""
        values, ends = self._strains, self.node_stations[self.grid.cells]
        size = self.transformation.shape[0]
        forces = force_rows(ends, values.entries, self.section_stiffness, values.coordinates, size)
        return replace(forces, rows=sp.csr_matrix(forces.rows @ self.transformation))

    @cached_property
    def _strains(self) -> CellValues:
        """Strains at both ends of each element, per unit of the function space's coordinates."""
        return cell_values(self, self.strains, np.array([[0.0], [1.0]]))

    def element_property(self, mesh: Mesh, values: Array) -> Expr:
        """Property of the sections with the `values` (K,) in UFL, constant in each element.

        Even if all sections are equal, the result is no constant of UFL.  UFL numbers constants, and a form with
        several of them would be compiled once more when these numbers get more digits.
        """
        return cellwise(mesh, values[self.section_number])

    def stresses(self) -> StressRows | None:
        """Stresses in the profile's corners at both ends of each element, from the beam's `section_forces`.

        None is returned if a section has no profile.
        """
        return self.corner_stresses(self.section_forces(), np.repeat(np.arange(len(self.grid.cells)), 2))

    def cut(self, parts: int) -> Cut:
        """Return this beam with each of its elements cut into `parts` equal pieces."""
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
        at_nodes = sp.csr_matrix(
            sp.diags(np.tile(self.signs, len(beam.node_stations))) @ self.motions(beam.node_stations)
        )
        return Cut(beam, at_nodes, joined, np.repeat(np.arange(pieces), 2) // parts)

    def end_forces(self) -> sp.csr_matrix:
        """Rows (P, n) that turn forces on the coordinates at elements' ends into section forces.

        The P rows are in the order of `section_forces`.  Section forces act on the face that looks along x: at the
        second end of an element they are the forces on its coordinates, at the first end the negative forces.
        """
        cells, (_, k, d) = self.grid.cells, self.resultants.shape
        signed = self.resultants[:, None] * np.array([-1.0, 1.0])[:, None, None]  # (E, 2, k, d)
        columns = np.broadcast_to(d * cells[:, :, None, None] + np.arange(d), signed.shape)
        entries, columns = (np.moveaxis(part, 2, 0).ravel() for part in (signed, columns))
        rows = k * cells.size
        force_rows = sp.csr_matrix((entries, columns, d * np.arange(rows + 1)), (rows, self.size))
        force_rows.eliminate_zeros()
        return force_rows

    @property
    def size(self) -> int:
        """Number of coordinates n."""
        return len(self.directions) * len(self.node_stations)

    def domain(self, comm: MPI.Comm) -> Mesh:
        """The axis as a dolfinx interval mesh, spread over `comm`; collective.

        The mesh has two points where sections change or the beam is cut.
        """
        cells = self.first_node[:, None] + np.arange(2)
        points = np.empty(int(cells[-1, -1]) + 1)
        points[cells] = self.node_stations[self.grid.cells]
        return create_mesh(comm, "interval", points[:, None], cells)

    def element_coordinates(self, cells: Indices) -> list[Indices]:
        """Numbers (c, 2) of the function space's coordinates on the elements `cells` (c,), by component.

        There is an array for each of the d components.
        """
        nodes = self.first_node[cells, None] + np.arange(2)
        return [len(self.directions) * nodes + i for i in range(len(self.directions))]

    def axial_force(self, mesh: Mesh, state: UnitState) -> Expr:
        r"""Axial force N(x) in N, tension positive, of the beam held at its tail, in UFL on a dolfinx mesh.

        With the mass per length :math:`\rho A`, the length L, the state's acceleration a along x, its stretch b, and
        its forces :math:`F_i` along x at :math:`x_i`,

        .. math:: N = -\int_x^L \rho A\, (a + b \xi)\, d\xi + \sum_{x_i > x} F_i
        """
        mass, ends, middle, h = self._element_masses()
        a, b = (float(value) for value in (state.acceleration[0], state.stretch))
        x, mass_here, end = ufl.SpatialCoordinate(mesh)[0], cellwise(mesh, mass), cellwise(mesh, ends)
        beyond = self._beyond(mass * h * (a + b * middle))
        a, b = (cellwise(mesh, np.full_like(h, value)) for value in (a, b))
        pulled = self._sums_beyond(mesh, state, 0)[0] - cellwise(mesh, beyond)
        return pulled - mass_here * (a * (end - x) + b * (end**2 - x**2) / 2.0)

    def moment(self, mesh: Mesh, state: UnitState, component: int) -> Expr:
        r"""Bending moment M(x) = EI w'' in N m of the beam held at its tail, in UFL on a dolfinx mesh.

        The deflection w is along y (`component` 1) or z (`component` 2).  The state's acceleration along this axis is a
        and its forces at :math:`x_i` are :math:`F_i`.  With the mass per length :math:`\rho A` and the length L

        .. math:: M = -\int_x^L \rho A\, a\, (\xi - x)\, d\xi + \sum_{x_i > x} F_i\, (x_i - x)
        """
        mass, ends, middle, h = self._element_masses()
        x, a = ufl.SpatialCoordinate(mesh)[0], cellwise(mesh, np.full_like(h, state.acceleration[component]))
        force, arm = self._sums_beyond(mesh, state, component)
        beyond, first = (cellwise(mesh, self._beyond(mass * h * by)) for by in (np.ones_like(h), middle))
        within = cellwise(mesh, mass) * (cellwise(mesh, ends) - x) ** 2 / 2.0
        return arm - force * x - a * (within + first - beyond * x)

    def _element_masses(self) -> Array:
        """Four properties of E elements, as the rows of an array (4, E).

        The rows are mass per length (kg/m), stations of the second node and of the middle (m), and length (m).
        """
        ends = self.node_stations[self.grid.cells]
        return np.array([self.masses, ends[:, 1], ends.mean(axis=1), np.diff(ends)[:, 0]])

    @staticmethod
    def _beyond(values: Array) -> Array:
        """Sums (E,) of `values` (E,) over all elements after each element, towards the tip."""
        return np.append(np.cumsum(values[:0:-1])[::-1], 0.0)

    def _sums_beyond(self, mesh: Mesh, state: UnitState, component: int) -> list[Function]:
        """Sums of the state's forces beyond each element, and of forces times their coordinates x, in UFL.

        Only one `component` of the forces is summed: 0, 1 or 2 for x, y or z.  A force within an element counts in
        part, by the share of the element's length that lies before the force.
        """
        first, last = self.node_stations[self.grid.cells].T
        sums = np.zeros((2, len(first)))
        for place, force in state.forces:
            at = self.station(place)
            sums += np.array([[1.0], [at]]) * force[component] * np.clip((at - first) / (last - first), 0.0, 1.0)
        return [cellwise(mesh, values) for values in sums]

    def displacement(self, *places: str | float) -> sp.csr_matrix:
        """Rows (k t, n) of the displacements of the centroids at k places, along the t of x, y, z that the beam has.

        Raises the InputError of `station`.
        """
        at = np.array([self.station(place) for place in places])
        motions = self._point_motions(at, np.array([self.centroid(place) for place in at]))
        return motions[np.flatnonzero(np.tile([d in "xyz" for d in self.directions], len(at)))]

    def station(self, place: str | float) -> float:
        """Distance in m of a place from the beam's first end.

        Raises an `InputError` if the place is not on the beam.
        """
        length = self.body.length
        at = ENDS[place] * length if isinstance(place, str) and place in ENDS else place
        slack = 1e-9 * length  # round-off of a caller's arithmetic
        if isinstance(at, str) or not -slack <= at <= length + slack:
            raise InputError("scene", "place", place, f"tail, tip or a number from 0 to {length:g} m is allowed")
        return min(max(float(at), 0.0), length)

    def centroid(self, place: str | float) -> Array:
        """Point (3,) in m that represents a place: the centroid of the walls' mid-line, as at the end of a shell.

        The point is on the axis if the beam has no profile.  Raises the InputError of `station`.
        """
        at = self.station(place)
        return np.array([at, *(np.zeros(2) if self.sections is None else self.sections.middle_at(at))])

    def coordinates_on(self, place: str, directions: Sequence[str]) -> Indices:
        """Numbers (k,) of the coordinates along or about `directions` at a `place`, ``tail`` or ``tip``.

        Raises an `InputError` for other places.
        """
        if place not in ENDS:
            raise InputError("scene", "place", place, "tail or tip is allowed")
        first = round(ENDS[place] * (self.size - len(self.directions)))
        return first + np.array([i for i, d in enumerate(self.directions) if d in directions], np.int64)

    def rigid_motions(self) -> Array:
        """Coordinates (n, d) under unit rigid motions along and about the d directions.

        Rotations are about the origin.
        """
        numbers = [DIRECTIONS.index(direction) for direction in self.directions]
        nodes = self.grid.points
        motions = rigid_motions(np.repeat(nodes, len(numbers), axis=0), np.tile(numbers, len(nodes)))[:, numbers]
        return np.tile(self.signs, len(nodes))[:, None] * motions

    @cached_property
    def grid(self) -> Grid:
        """The axis as line cells, one for each element; no cell joins the two nodes where the axis is cut."""
        first = np.flatnonzero(np.diff(self.node_stations))  # no cell where the axis is cut
        return Grid("line", self.node_stations[:, None] * np.eye(3)[0], first[:, None] + np.arange(2))

    def point_displacements(self) -> sp.csr_matrix:
        """Rows (3 N, n) that measure the displacements of the N nodes along x, y and z.

        Rows along directions that the beam does not have are zero.
        """
        nodes, along = np.arange(len(self.node_stations))[:, None], [d for d in self.directions if d in "xyz"]
        rows = 3 * nodes + ["xyz".index(d) for d in along]
        columns = len(self.directions) * nodes + [self.directions.index(d) for d in along]
        return sp.csr_matrix((np.ones(rows.size), (rows.ravel(), columns.ravel())), (3 * len(nodes), self.size))


def measure(mesh: Mesh) -> ufl.Measure:
    """UFL measure by which weak forms of beams are integrated."""
    return integration_measure(mesh, 6)


def beam_body(member: Member) -> Beam3DBody:
    """Data of the beam of a body of a scene: box or section, material and number of elements."""
    body, box = member.part.body, member.box
    profile, elements = None if body.section else box, member.part.mesh.elements
    return Beam3DBody(box.length, body.section, profile, body.material, body.shear, elements)
