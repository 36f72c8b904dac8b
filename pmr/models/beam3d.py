r"""Beam in space: stretching, torsion and bending in two planes, with C1 cubic Hermite elements.

With x along the axis, y and z the section's principal axes, u and the inertia of translations at its centroid, v and w
at its shear centre

.. math::
    k = \int EA\, u' \delta u' + GJ\, \phi' \delta\phi'
        + EI_z \Bigl( v'' \delta v'' - \frac{h^2}{12} \frac{\Phi_y}{1 + \Phi_y} v''' \delta v''' \Bigr)
        + EI_y \Bigl( w'' \delta w'' - \frac{h^2}{12} \frac{\Phi_z}{1 + \Phi_z} w''' \delta w''' \Bigr) dx

.. math::
    m = \int \rho A\, (u\, \delta u + v\, \delta v + w\, \delta w) + \rho (I_y + I_z)\, \phi\, \delta\phi
        + \rho I_z\, \psi_v\, \delta\psi_v + \rho I_y\, \psi_w\, \delta\psi_w \, dx

Without shear Phi = 0 and the last two terms are left out: Euler and Bernoulli's beam.  With shear,
:math:`\Phi = 12 EI / (\kappa G A h^2)`, and nodal slopes are rotations psi of the section.  The shear strain of an
element, :math:`\gamma = -\frac{h^2}{12} \frac{\Phi}{1 + \Phi} w'''`, follows from its own minimum of energy, which
gives the term above and the interpolation :math:`w + \gamma h (X - 3 X^2 + 2 X^3)`, :math:`\psi = w' - \gamma`: nodal
values are exact in statics, frequencies converge with order 2 (4 without shear).  Przemieniecki: Theory of Matrix
Structural Analysis, 1968, section 5.6 (stiffness), 11.3 (mass).

Sections are rigid in their plane and warping is free; they change at nodes, so that each element has constants of its
own, and those of a section that tapers are its means over the element.  Coordinates are ordered node by node:
displacements along and rotations about x, y, z, of a point on the axis, which moves with its section: with its centroid
c and its shear centre s beside the axis, and R that turns y and z to its principal axes

.. math::
    u_c = u + z_c \theta_y - y_c \theta_z, \qquad
    \begin{pmatrix} v_s \\ w_s \end{pmatrix} = R \begin{pmatrix} v - z_s \phi \\ w + y_s \phi \end{pmatrix}
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
import ufl
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.fem.compat import MPI, cellwise, constant, create_mesh, hermite_space
from pmr.fields.envelope import FORCES, ForceRows, force_rows
from pmr.fields.stress import StressRows
from pmr.mesh.strip import FACES, Extent, Plane, Strip, Window, line_points
from pmr.models import DIRECTIONS, Forms, UnitState, bilinear
from pmr.models.beam import HERMITE, Beam
from pmr.models.profile_section import MidLine, corner_stresses, section_of, stress_rows
from pmr.models.ring_masses import RingMasses, ring_masses
from pmr.models.sections_along import SectionsAlong, about_own_centres, one_section, sections_of, stations_of
from pmr.models.tabulation import CellValues, cell_values
from pmr.scene.box import Box
from pmr.scene.profile import BoxProfile
from pmr.scene.structures import Beam3DBody, BeamSection

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Motion = tuple[Any, ...]  # along x, y and z in UFL; None: without inertia


@dataclass(frozen=True)
class Bending:
    """Bending in one plane of K sections: EI in N m^2, kappa G A in N (None: rigid in shear), rho I in kg m."""

    stiffness: Array  # (K,)
    shear_stiffness: Array | None  # (K,)
    rotary_inertia: Array  # (K,)

    def softening(self, h: Array, number: Indices) -> Array:
        """(h^2 / 12) Phi / (1 + Phi) in m^2, for lengths h in m of elements with these sections."""
        if self.shear_stiffness is None:
            return np.zeros_like(h)
        return h**2 / 12.0 / (1.0 + self.shear_stiffness[number] * h**2 / (12.0 * self.stiffness[number]))


@dataclass(frozen=True)
class Deflection:
    """Bending in one plane, in UFL: what nodal values interpolate, the shear strain (None: rigid in shear), and both.

    `cubic` and `value` are in m, `rotation` of the section in rad, `curvature`, its derivative, in 1/m.
    """

    cubic: Any
    shear: Any
    value: Any
    rotation: Any
    curvature: Any


@dataclass(frozen=True)
class Beam3D(Beam):
    """The model of a scene's beam in space."""

    body: Beam3DBody
    stations: Array | None = None  # (N,) m: of its nodes, by default as far apart as each other
    along: SectionsAlong | None = None  # by default the body's section all along; they change at nodes
    rings: RingMasses | None = None  # the mass of plates within it

    @cached_property
    def node_stations(self) -> Array:
        if self.stations is not None:
            return self.stations
        return self.body.length * (np.arange(self.body.elements + 1) / self.body.elements)

    @cached_property
    def sections(self) -> SectionsAlong:
        """Along the axis."""
        if self.along is not None:
            return self.along
        body, section = self.body, self.body.section
        if section is None:
            assert body.profile is not None
            section = section_of(body.profile, body.material.poisson)
        return one_section(body.length, section, body.profile)

    @property
    def section(self) -> BeamSection:
        """At its tail."""
        return self.sections.each[0]

    @cached_property
    def number(self) -> Indices:
        """Of each element's section, (E,)."""
        return self.sections.at(self.node_stations[self.grid.cells].mean(axis=1))

    @cached_property
    def _first(self) -> Indices:
        """Of the space's coordinates that of each element's first node, (E,); the last node's come right behind it.

        Where sections change, and where the beam is cut, the space has two nodes at one place.
        """
        cells = self.grid.cells
        apart = (np.diff(self.number) != 0) | (cells[1:, 0] != cells[:-1, 1])
        return np.arange(len(cells)) + np.append(0, np.cumsum(apart))

    @cached_property
    def planes(self) -> tuple[Bending, Bending]:
        """Bending along the sections' principal axes."""
        E, G, rho = self.body.material.young, self.body.material.shear_modulus, self.body.material.density
        areas, I = self.sections.shear_areas if self.body.shear else None, self.sections.second_moments
        if areas is None:
            return Bending(E * I[:, 0], None, 0.0 * I[:, 0]), Bending(E * I[:, 1], None, 0.0 * I[:, 1])
        y, z = (Bending(E * I[:, i], G * areas[:, i], rho * I[:, i]) for i in (0, 1))
        return y, z

    @property
    def reference_frequency(self) -> float:
        """sqrt(EI / (rho A L^4)) of the softer plane in rad/s, of the softest section."""
        softest = min(plane.stiffness.min() for plane in self.planes)
        return float(np.sqrt(softest / self.masses.min()) / self.body.length**2)

    @property
    def masses(self) -> Array:
        added = 0.0 if self._added is None else self._added.area
        return self.body.material.density * (self.sections.area[self.number] + added)

    @cached_property
    def _added(self) -> RingMasses | None:
        """Of its elements."""
        return None if self.rings is None else self.rings.at(self.node_stations[self.grid.cells].mean(axis=1))

    @property
    def directions(self) -> tuple[str, ...]:
        return DIRECTIONS

    @cached_property
    def transformation(self) -> sp.csr_matrix:
        """T: the space's u, phi, v, v', w and w' at each node; v' is the rotation about z, w' minus that about y."""
        at_node = np.zeros((6, 6))
        at_node[range(6), [0, 3, 1, 5, 2, 4]] = 1.0, 1.0, 1.0, 1.0, 1.0, -1.0
        size = self._first[-1] + 2
        of, number = np.empty((2, size), np.int64)
        for k in (0, 1):
            of[self._first + k], number[self._first + k] = self.grid.cells[:, k], self.number
        blocks = (at_node @ self.sections.own_motion)[number]
        shape = (6 * size, 6 * len(self.node_stations))
        found = sp.bsr_matrix((blocks, of, np.arange(size + 1)), shape=shape).tocsr()
        found.eliminate_zeros()
        return found

    def domain(self, comm: MPI.Comm) -> Any:
        cells = self._first[:, None] + np.arange(2)
        points = np.empty(int(cells[-1, -1]) + 1)
        points[cells] = self.node_stations[self.grid.cells]
        return create_mesh(comm, "interval", points[:, None], cells)

    def element_coordinates(self, cells: Indices) -> list[Indices]:
        nodes = self._first[cells, None] + np.arange(2)
        return [6 * nodes + i for i in range(6)]

    def _of_elements(self, mesh: Any, values: Array) -> Any:
        """A property (K,) of the sections in UFL."""
        return constant(mesh, float(values[0])) if len(values) == 1 else cellwise(mesh, values[self.number])

    def space(self, domain: Any) -> Any:
        return hermite_space(domain, linear=2, planes=2)

    def forms(self, space: Any) -> Forms:
        mesh = space.mesh
        trial, test = ufl.TrialFunction(space), ufl.TestFunction(space)
        material, sections = self.body.material, self.sections
        EA = self._of_elements(mesh, material.young * sections.area)
        GJ = self._of_elements(mesh, material.shear_modulus * sections.torsion_constant)

        u, du, phi, dphi = trial[0], test[0], trial[1], test[1]
        stiffness = EA * u.dx(0) * du.dx(0) + GJ * phi.dx(0) * dphi.dx(0)
        for plane, of, by in zip(self.planes, *(self._deflections(mesh, f) for f in (trial, test)), strict=True):
            EI = self._of_elements(mesh, plane.stiffness)
            stiffness += EI * of.cubic.dx(0).dx(0) * by.cubic.dx(0).dx(0)
            if of.shear is not None:
                stiffness += EI * of.shear * by.cubic.dx(0).dx(0).dx(0)
        return Forms(self.inertia(space, ufl.Identity(3)), stiffness * _measure(mesh))

    def inertia(self, space: Any, S: Any) -> Any:
        r"""The form of the integral of rho v . S u over the body.

        .. math::
            \int \rho A\, v \cdot S u + \rho I_z\, v_{,y} \cdot S u_{,y} + \rho I_y\, v_{,z} \cdot S u_{,z}\, dx

        The point (y, z) of a section moves by :math:`(u - y \psi_v - z \psi_w,\; v - z \phi,\; w + y \phi)`; without
        shear the rotations psi have no inertia.
        """
        mesh, sections, rho = space.mesh, self.sections, self.body.material.density
        sizes = sections.area, *sections.second_moments.T
        if sections.turned:
            turned = ufl.as_matrix([[1, 0, 0], *([0, *row] for row in self._turn(mesh))])
            S = turned * S * ufl.transpose(turned)
        of, by = (self._motion(mesh, field) for field in (ufl.TrialFunction(space), ufl.TestFunction(space)))
        parts = zip(sizes, by, of, strict=True)
        total = sum(self._of_elements(mesh, rho * size) * bilinear(S, v, u) for size, v, u in parts)
        return (total + self._of_rings(mesh, S, by, of)) * _measure(mesh)

    def _of_rings(self, mesh: Any, S: Any, by: Sequence[Motion], of: Sequence[Motion]) -> Any:
        """The same of plates within it, about their own centroid, from what moves that of the section."""
        added, sections, rho = self._added, self.sections, self.body.material.density
        if added is None:
            return 0
        R = sections.principal[self.number]
        y, z = np.einsum("eij,ej->ie", R, added.centroid - sections.centroid[self.number])
        arms = cellwise(mesh, y), cellwise(mesh, z)
        second = rho * np.einsum("eij,ejk,elk->eil", R, added.about_centroid, R)

        def moved(motion: Sequence[Motion]) -> Motion:
            centre, *turns = motion
            for arm, turn in zip(arms, turns, strict=True):
                centre = tuple(c if t is None else c + arm * t for c, t in zip(centre, turn, strict=True))
            return centre

        total = cellwise(mesh, rho * added.area) * bilinear(S, moved(by), moved(of))
        for j in (0, 1):
            for k in (0, 1):
                total += cellwise(mesh, second[:, j, k]) * bilinear(S, by[1 + j], of[1 + k])
        return total

    def _turn(self, mesh: Any) -> list[list[Any]]:
        """The principal axes in UFL."""
        return [[self._of_elements(mesh, self.sections.principal[:, i, j]) for j in (0, 1)] for i in (0, 1)]

    def _motion(self, mesh: Any, field: Any) -> tuple[Motion, ...]:
        """Displacement of the centroid, and its derivatives along the principal axes; None: without inertia."""
        v, w = self._deflections(mesh, field)
        phi, (turn_v, turn_w) = field[1], (None if one.shear is None else -one.rotation for one in (v, w))
        return (field[0], *self._of_centroid(mesh, v.value, w.value, phi)), (turn_v, None, phi), (turn_w, -phi, None)

    def _of_centroid(self, mesh: Any, v: Any, w: Any, phi: Any) -> tuple[Any, Any]:
        """What the shear centre's v and w are at the centroid."""
        sections = self.sections
        y, z = np.einsum("kij,kj->ik", sections.principal, sections.centroid - sections.shear_centre)
        v = v - self._of_elements(mesh, z) * phi if z.any() else v
        return v, w + self._of_elements(mesh, y) * phi if y.any() else w

    def geometric_stiffness(self, space: Any, state: UnitState) -> Any:
        r"""The form of what an axial force N and moments :math:`M_v = EI_z v_0''`, :math:`M_w = EI_y w_0''` do.

        .. math::
            \int N\, \Bigl(v' \delta v' + w' \delta w' + \frac{I_y + I_z}{A} \phi' \delta\phi'\Bigr)
                + (M_w \phi)' \delta v' + v' (M_w \delta\phi)' - (M_v \phi)' \delta w' - w' (M_v \delta\phi)' \, dx

        Wagner's term, with I_y + I_z, twists a bar that is soft in torsion; moments make a high beam tip over sideways.
        From :math:`\sigma_{jk} u_{i,j} v_{i,k}` with the motion of sections and the shear force -M'; forces act on the
        axis (Timoshenko, Gere: Theory of Elastic Stability, 2nd ed., 1961, sections 5.3 and 6.3).  N moves with the
        centroid, moments with the shear centre; left out is what moments do to the twist of a section without symmetry.
        """
        mesh, trial, test = space.mesh, ufl.TrialFunction(space), ufl.TestFunction(space)
        of, by = ([one.value.dx(0) for one in self._deflections(mesh, field)] for field in (trial, test))
        phi, dphi = trial[1], test[1]
        radius2 = self._of_elements(mesh, self.sections.polar_moment / self.sections.area)
        both = ((of, phi), (by, dphi))
        pairs = zip(*(self._of_centroid(mesh, v, w, twist.dx(0)) for (v, w), twist in both), strict=True)
        along = sum(a * b for a, b in pairs) + radius2 * phi.dx(0) * dphi.dx(0)
        moments = [self.moment(mesh, state, component) for component in (1, 2)]
        if self.sections.turned:
            moments = [sum(c * M for c, M in zip(row, moments, strict=True)) for row in self._turn(mesh)]
        M_v, M_w = moments
        across = (M_w * phi).dx(0) * by[0] + of[0] * (M_w * dphi).dx(0)
        across -= (M_v * phi).dx(0) * by[1] + of[1] * (M_v * dphi).dx(0)
        return (self.axial_force(mesh, state) * along + across) * _measure(mesh)

    def _deflections(self, mesh: Any, field: Any) -> list[Deflection]:
        """Of a field (u, phi, w_A and theta_B of both planes), in both planes."""
        h = ufl.JacobianDeterminant(mesh)
        middle = cellwise(mesh, self.node_stations[self.grid.cells].mean(axis=1))
        X = (ufl.SpatialCoordinate(mesh)[0] - middle) / h + 0.5
        bulge = h * (X - 3 * X**2 + 2 * X**3)
        found = []
        for i, plane in enumerate(self.planes):
            w = field[2 + 2 * i] + h * field[3 + 2 * i]
            if plane.shear_stiffness is None:
                found.append(Deflection(w, None, w, w.dx(0), w.dx(0).dx(0)))
                continue
            EI, kGA = (self._of_elements(mesh, one) for one in (plane.stiffness, plane.shear_stiffness))
            gamma = -(h**2) / 12 / (1 + kGA * h**2 / (12 * EI)) * w.dx(0).dx(0).dx(0)
            rotation, curvature = w.dx(0) + gamma * (bulge.dx(0) - 1), w.dx(0).dx(0) + gamma * bulge.dx(0).dx(0)
            found.append(Deflection(w, gamma, w + gamma * bulge, rotation, curvature))
        return found

    def motion(self, place: str | float, about: Array | None = None) -> sp.csr_matrix:
        at = self.station(place)
        rows = self._motions(np.array([at]))
        arm = np.asarray(self.centroid(at) if about is None else about, float) - at * np.eye(3)[0]
        if about is not None or arm.any():
            rows = sp.vstack([rows[:3] + sp.csr_matrix(np.cross(np.eye(3), arm).T) @ rows[3:], rows[3:]])
        rows = sp.csr_matrix(rows)
        rows.data[np.abs(rows.data) < 1e-14] = 0.0
        rows.eliminate_zeros()
        return rows

    def centroid(self, place: str | float) -> Array:
        """Where the mean of a shell's end is: in the middle of the walls' line."""
        profile = self._profile(self.station(place))
        return super().centroid(place) + [0.0, *(np.zeros(2) if profile is None else MidLine(profile).middle)]

    def _profile(self, at: float) -> BoxProfile | None:
        """At a place along the axis in m."""
        stretch = self.sections.stretches[int(self.sections.at(at))]
        return None if stretch is None else stretch.at(at)

    def _motions(self, places: Array) -> sp.csr_matrix:
        """Displacements and rotations of the axis at distances along it, (6 len(places), n)."""
        e, x = self._elements(places), self.node_stations[self.grid.cells]
        h = np.diff(x)[e, 0]
        local = self._in_elements(h, (places - x[e, 0]) / h, self.number[e])
        if np.any(self.sections.own_motion != np.eye(6)):
            local = np.linalg.inv(self.sections.own_motion)[self.number[e]] @ local
        columns = np.broadcast_to(6 * self._first[e, None, None] + np.arange(12), local.shape)
        ends, shape = np.arange(0, local.size + 1, 12), (6 * len(places), self.transformation.shape[0])
        return sp.csr_matrix(sp.csr_matrix((local.ravel(), columns.ravel(), ends), shape=shape) @ self.transformation)

    def _in_elements(self, h: Array, X: Array, number: Indices) -> Array:
        """The motion at X h in elements of lengths h and these sections, (q, 6, 12), from the space's values."""
        local = np.zeros((len(h), 6, 12))
        for row, component in ((0, 0), (3, 1)):
            local[:, row, component], local[:, row, 6 + component] = 1.0 - X, X
        for row, turn, sign, start, plane in zip((1, 2), (5, 4), (1.0, -1.0), (2, 4), self.planes, strict=True):
            value, slope = _interpolated(plane, h, X, number)
            for k, component in enumerate((start, start + 1, 6 + start, 7 + start)):
                local[:, row, component], local[:, turn, component] = value[k], sign * slope[k]
        return local

    def strip(self, face: str, window: Window) -> Strip:
        """The line beside the axis that stands for a face; how far below or above the axis it is plays no role."""
        plane, extent = self._face(face, sum(window.along) / 2.0)
        points, weights = line_points(window, self.node_stations)
        across = sum(window.across) / 2.0
        normal = plane.normal
        turning = np.cross(across * plane.across, normal)  # (theta x arm) n = theta (arm x n)
        entries, ends = np.tile([*normal, *turning], len(points)), 6 * np.arange(len(points) + 1)
        weighed = sp.csr_matrix((entries, np.arange(len(entries)), ends), shape=(len(points), 6 * len(points)))
        normals = sp.csr_matrix(weighed @ self._motions(points))
        return Strip(points, np.full(len(points), across), weights, normals, extent, line=True)

    def _face(self, name: str, at: float) -> tuple[Plane, Extent]:
        """A face and what it offers: all of the axis, and its flat part at a place, if there is a profile."""
        profile, along = self._profile(at), (0.0, self.body.length)
        known = FACES if profile is None else profile.faces
        if name not in known:
            raise InputError("scene", "pads.on", name, f"a beam has the faces {', '.join(known)}")
        if profile is None:
            return FACES[name], Extent(along)
        side = profile.faces[name]
        normal, across = (np.array([0.0, *pair]) for pair in (side.normal, side.across))
        return Plane(normal, across), Extent(along, side.span)

    def _elements(self, places: Array) -> Indices:
        """Numbers of the elements that hold places along the axis; at a node that of the one behind it."""
        starts = self.node_stations[self.grid.cells[:, 0]]
        return np.clip(np.searchsorted(starts, places, side="right") - 1, 0, None)

    def corner_stresses(self, forces: ForceRows, element: Indices) -> StressRows | None:
        number, places = np.repeat(self.number, 2), forces.x[: len(element)]
        found = dict[tuple[int, float], tuple[Array, Array]]()  # by section, and where it changes from place to place
        keys, names = [], tuple[str, ...]()
        for k, x in zip(number.tolist(), places.tolist(), strict=True):
            stretch = self.sections.stretches[k]
            if stretch is None:
                return None
            same = stretch.first is stretch.last
            keys.append((k, 0.0 if same else x))
            if keys[-1] not in found:
                profile = stretch.at(x)
                section = self.sections.each[k] if same else section_of(profile, self.body.material.poisson)
                names = tuple(corner.name for corner in profile.corners)
                at = np.array([corner.at for corner in profile.corners])
                found[keys[-1]] = at, corner_stresses(profile, section)
        corners = dict(zip(names, np.array([found[key][0] for key in keys]).swapaxes(0, 1), strict=True))
        return stress_rows(forces, element, corners, np.array([found[key][1] for key in keys]))

    def on_nodes(self, stations: Array) -> Beam3D:
        return replace(self, stations=stations)

    def interpolated(self, places: Array) -> sp.csr_matrix:
        return self._motions(places)

    @property
    def resultants(self) -> Array:
        """N and bending moments about the centroid, the torque about the shear centre."""
        return np.linalg.inv(about_own_centres(self.sections)).transpose(0, 2, 1)[self.number]

    def section_forces(self) -> ForceRows:
        material, sections, number, strains = self.body.material, self.sections, self.number, self._strains
        # about z and y, of curvatures along principal axes
        bent = material.young * np.einsum("kji,kj->kij", sections.principal, sections.second_moments)[number]
        stiffness = {name: np.zeros((len(number), 4)) for name in FORCES if "shear" not in name}
        stiffness["normal force"][:, 0] = material.young * sections.area[number]
        stiffness["torque"][:, 3] = material.shear_modulus * sections.torsion_constant[number]
        stiffness["bending moment y"][:, 1:3], stiffness["bending moment z"][:, 1:3] = -bent[:, 1], bent[:, 0]
        ends = self.node_stations[self.grid.cells]
        found = force_rows(ends, strains.entries, stiffness, strains.coordinates, self.transformation.shape[0])
        return replace(found, rows=sp.csr_matrix(found.rows @ self.transformation))

    @cached_property
    def _strains(self) -> CellValues:
        """The strains u', psi_v', psi_w' and phi' at both ends of each element."""

        def strains(space: Any) -> Any:
            field = ufl.TrialFunction(space)
            v, w = self._deflections(space.mesh, field)
            return ufl.as_vector([field[0].dx(0), v.curvature, w.curvature, field[1].dx(0)])

        return cell_values(self, strains, np.array([[0.0], [1.0]]))


def beam_of(body: Beam3DBody, box: Box) -> Beam3D:
    """The beam of a box, with its sections along it and the mass of its frames."""
    beam = Beam3D(body)
    if box.varying:
        stations = stations_of(box.breaks, body.elements)
        beam = Beam3D(body, stations, sections_of(box, body.material.poisson, stations))
    return replace(beam, rings=ring_masses(box, beam.node_stations)) if box.frames else beam


def _measure(mesh: Any) -> Any:
    return ufl.Measure("dx", domain=mesh, metadata={"quadrature_degree": 6})


def _interpolated(plane: Bending, h: Array, X: Array, number: Indices) -> tuple[Array, Array]:
    """Weights (4, q) of w_1, psi_1, w_2, psi_2 in the deflection at X h and in the rotation of the section there."""
    scale = np.stack([np.ones_like(h), h, np.ones_like(h), h])
    derivatives = {k: np.array([np.polyval(np.polyder(p, k), X) for p in HERMITE]) * scale / h**k for k in (0, 1, 3)}
    value, slope, third = derivatives.values()
    gamma = -plane.softening(h, number) * third
    return value + gamma * h * (X - 3 * X**2 + 2 * X**3), slope + gamma * (-6 * X + 6 * X**2)
