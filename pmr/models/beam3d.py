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

Sections are rigid in their plane and warping is free.  Coordinates are ordered node by node: displacements along and
rotations about x, y, z, of a point on the axis, which moves with its section: with its centroid c and its shear centre
s beside the axis, and R that turns y and z to its principal axes

.. math::
    u_c = u + z_c \theta_y - y_c \theta_z, \qquad
    \begin{pmatrix} v_s \\ w_s \end{pmatrix} = R \begin{pmatrix} v - z_s \phi \\ w + y_s \phi \end{pmatrix}
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
import ufl
from numpy.typing import NDArray
from scipy.linalg import block_diag

from pmr.errors import InputError
from pmr.fem.compat import cellwise, constant, hermite_space
from pmr.fields.envelope import ForceRows, force_rows
from pmr.fields.stress import StressRows
from pmr.mesh.strip import FACES, Extent, Plane, Strip, Window, line_points
from pmr.models import DIRECTIONS, Forms, UnitState, bilinear
from pmr.models.beam import HERMITE, Beam
from pmr.models.profile_section import MidLine, corner_stresses, section_of, stress_rows
from pmr.models.tabulation import CellValues, cell_values
from pmr.scene.structures import Beam3DBody, BeamSection

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Bending:
    """Bending in one plane: EI in N m^2, kappa G A in N (None: rigid in shear), rho A in kg/m, rho I in kg m."""

    stiffness: float
    shear_stiffness: float | None
    mass: float
    rotary_inertia: float

    def softening(self, h: Array) -> Array:
        """(h^2 / 12) Phi / (1 + Phi) in m^2, for element lengths h in m."""
        if self.shear_stiffness is None:
            return np.zeros_like(h)
        return h**2 / 12.0 / (1.0 + self.shear_stiffness * h**2 / (12.0 * self.stiffness))


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

    @cached_property
    def node_stations(self) -> Array:
        if self.stations is not None:
            return self.stations
        return self.body.length * (np.arange(self.body.elements + 1) / self.body.elements)

    @cached_property
    def section(self) -> BeamSection:
        if self.body.section is not None:
            return self.body.section
        assert self.body.profile is not None
        return section_of(self.body.profile, self.body.material.poisson)

    @cached_property
    def principal(self) -> Array:
        """R (2, 2): the section's principal axes as rows, no farther from y and z than half a right angle."""
        section = self.section
        if section.product_of_inertia == 0.0:
            return np.eye(2)
        difference = section.second_moment_z - section.second_moment_y
        angle = np.arctan2(np.copysign(2.0, difference) * section.product_of_inertia, abs(difference)) / 2.0
        return np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])

    @cached_property
    def own_motion(self) -> Array:
        """(6, 6): u_c, v_s, w_s, phi and rotations about the principal axes from the motion of the axis."""
        (y_c, z_c), (y_s, z_s) = self.section.centroid, self.section.shear_centre
        found = np.eye(6)
        found[0, 4:] = z_c, -y_c
        found[1, 3], found[2, 3] = -z_s, y_s
        found[1:3], found[4:] = self.principal @ found[1:3], self.principal @ found[4:]
        return found

    @cached_property
    def second_moments(self) -> Array:
        """About the centroid, along the principal axes, (2,) m^4."""
        section = self.section
        body = [
            [section.second_moment_z, section.product_of_inertia],
            [section.product_of_inertia, section.second_moment_y],
        ]
        return np.asarray(np.diag(self.principal @ body @ self.principal.T))

    @cached_property
    def planes(self) -> tuple[Bending, Bending]:
        """Bending along the section's principal axes."""
        material, section = self.body.material, self.section
        areas: tuple[float | None, ...] = None, None
        if self.body.shear and section.shear_area_y is not None and section.shear_area_z is not None:
            compliance = np.diag([1.0 / section.shear_area_y, 1.0 / section.shear_area_z])
            areas = tuple(1.0 / np.diag(self.principal @ compliance @ self.principal.T))
        along = [
            self._plane(float(I), A, material.shear_modulus) for I, A in zip(self.second_moments, areas, strict=True)
        ]
        return along[0], along[1]

    def _plane(self, second_moment: float, shear_area: float | None, G: float) -> Bending:
        E, rho = self.body.material.young, self.body.material.density
        kGA = None if shear_area is None else G * shear_area
        return Bending(E * second_moment, kGA, rho * self.section.area, rho * second_moment if kGA else 0.0)

    @property
    def reference_frequency(self) -> float:
        """sqrt(EI / (rho A L^4)) of the softer plane in rad/s."""
        softer = min(self.planes, key=lambda plane: plane.stiffness)
        return float(np.sqrt(softer.stiffness / softer.mass) / self.body.length**2)

    @property
    def mass_per_length(self) -> float:
        return self.planes[0].mass

    @property
    def directions(self) -> tuple[str, ...]:
        return DIRECTIONS

    @cached_property
    def transformation(self) -> sp.csr_matrix:
        """T: the space's u, phi, v, v', w and w' at each node; v' is the rotation about z, w' minus that about y."""
        at_node = np.zeros((6, 6))
        at_node[range(6), [0, 3, 1, 5, 2, 4]] = 1.0, 1.0, 1.0, 1.0, 1.0, -1.0
        at_node = at_node @ self.own_motion + 0.0
        return sp.csr_matrix(sp.kron(sp.eye(len(self.node_stations)), at_node, format="csr"))

    def space(self, domain: Any) -> Any:
        return hermite_space(domain, linear=2, planes=2)

    def forms(self, space: Any) -> Forms:
        mesh = space.mesh
        trial, test = ufl.TrialFunction(space), ufl.TestFunction(space)
        material, section = self.body.material, self.section
        EA = constant(mesh, material.young * section.area)
        GJ = constant(mesh, material.shear_modulus * section.torsion_constant)

        u, du, phi, dphi = trial[0], test[0], trial[1], test[1]
        stiffness = EA * u.dx(0) * du.dx(0) + GJ * phi.dx(0) * dphi.dx(0)
        for plane, of, by in zip(self.planes, *(self._deflections(mesh, f) for f in (trial, test)), strict=True):
            EI = constant(mesh, plane.stiffness)
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
        mesh, section, rho = space.mesh, self.section, self.body.material.density
        sizes = section.area, *map(float, self.second_moments)
        turned = ufl.as_matrix(block_diag(1.0, self.principal).tolist())
        S = S if section.product_of_inertia == 0.0 else turned * S * ufl.transpose(turned)
        of, by = (self._motion(mesh, field) for field in (ufl.TrialFunction(space), ufl.TestFunction(space)))
        parts = zip(sizes, by, of, strict=True)
        return sum(constant(mesh, rho * size) * bilinear(S, v, u) for size, v, u in parts) * _measure(mesh)

    def _motion(self, mesh: Any, field: Any) -> tuple[tuple[Any, Any, Any], ...]:
        """Displacement of the centroid, and its derivatives along the principal axes; None: without inertia."""
        v, w = self._deflections(mesh, field)
        phi, (turn_v, turn_w) = field[1], (None if one.shear is None else -one.rotation for one in (v, w))
        return (field[0], *self._of_centroid(mesh, v.value, w.value, phi)), (turn_v, None, phi), (turn_w, -phi, None)

    def _of_centroid(self, mesh: Any, v: Any, w: Any, phi: Any) -> tuple[Any, Any]:
        """What the shear centre's v and w are at the centroid."""
        y, z = self.principal @ np.subtract(self.section.centroid, self.section.shear_centre)
        return v - constant(mesh, z) * phi if z else v, w + constant(mesh, y) * phi if y else w

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
        radius2 = constant(mesh, self.section.polar_moment / self.section.area)
        both = ((of, phi), (by, dphi))
        pairs = zip(*(self._of_centroid(mesh, v, w, twist.dx(0)) for (v, w), twist in both), strict=True)
        along = sum(a * b for a, b in pairs) + radius2 * phi.dx(0) * dphi.dx(0)
        moments = [self.moment(mesh, state, component) for component in (1, 2)]
        if self.section.product_of_inertia:
            turn = [[constant(mesh, float(c)) for c in row] for row in self.principal]
            moments = [sum(c * M for c, M in zip(row, moments, strict=True)) for row in turn]
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
            EI, kGA = constant(mesh, plane.stiffness), constant(mesh, plane.shear_stiffness)
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
        return super().centroid(place) + [0.0, *self._middle]

    @cached_property
    def _middle(self) -> Array:
        return np.zeros(2) if self.body.profile is None else MidLine(self.body.profile).middle

    def _motions(self, places: Array) -> sp.csr_matrix:
        """Displacements and rotations of the axis at distances along it, (6 len(places), n)."""
        e = self._elements(places)
        h = np.diff(self.node_stations)[e]
        local = self._in_elements(h, (places - self.node_stations[e]) / h)
        if np.any(self.own_motion != np.eye(6)):
            local = np.linalg.inv(self.own_motion) @ local
        columns = np.broadcast_to(6 * e[:, None, None] + np.arange(12), local.shape)
        ends, shape = np.arange(0, local.size + 1, 12), (6 * len(places), self.size)
        return sp.csr_matrix(sp.csr_matrix((local.ravel(), columns.ravel(), ends), shape=shape) @ self.transformation)

    def _in_elements(self, h: Array, X: Array) -> Array:
        """The motion at X h in elements of lengths h, (q, 6, 12), from the space's values at both ends."""
        local = np.zeros((len(h), 6, 12))
        for row, component in ((0, 0), (3, 1)):
            local[:, row, component], local[:, row, 6 + component] = 1.0 - X, X
        for row, turn, sign, start, plane in zip((1, 2), (5, 4), (1.0, -1.0), (2, 4), self.planes, strict=True):
            value, slope = _interpolated(plane, h, X)
            for k, component in enumerate((start, start + 1, 6 + start, 7 + start)):
                local[:, row, component], local[:, turn, component] = value[k], sign * slope[k]
        return local

    def strip(self, face: str, window: Window) -> Strip:
        """The line beside the axis that stands for a face; how far below or above the axis it is plays no role."""
        plane, extent = self._face(face)
        points, weights = line_points(window, self.node_stations)
        across = sum(window.across) / 2.0
        normal = plane.normal
        turning = np.cross(across * plane.across, normal)  # (theta x arm) n = theta (arm x n)
        entries, ends = np.tile([*normal, *turning], len(points)), 6 * np.arange(len(points) + 1)
        weighed = sp.csr_matrix((entries, np.arange(len(entries)), ends), shape=(len(points), 6 * len(points)))
        normals = sp.csr_matrix(weighed @ self._motions(points))
        return Strip(points, np.full(len(points), across), weights, normals, extent, line=True)

    def _face(self, name: str) -> tuple[Plane, Extent]:
        """A face and what it offers: all of the axis, and its flat part, if there is a profile."""
        profile, along = self.body.profile, (0.0, self.body.length)
        known = FACES if profile is None else profile.faces
        if name not in known:
            raise InputError("scene", "pads.on", name, f"a beam has the faces {', '.join(known)}")
        if profile is None:
            return FACES[name], Extent(along)
        side = profile.faces[name]
        normal, across = (np.array([0.0, *pair]) for pair in (side.normal, side.across))
        return Plane(normal, across), Extent(along, side.span)

    def _elements(self, places: Array) -> Indices:
        """Numbers of the elements that hold places along the axis."""
        x = self.node_stations
        return np.clip(np.searchsorted(x, places, side="right") - 1, 0, len(x) - 2)

    def corner_stresses(self, forces: ForceRows, element: Indices) -> StressRows | None:
        profile = self.body.profile
        if profile is None:
            return None
        corners = {corner.name: corner.at for corner in profile.corners}
        return stress_rows(forces, element, corners, corner_stresses(profile, self.section))

    def on_nodes(self, stations: Array) -> Beam3D:
        return replace(self, stations=stations)

    def interpolated(self, places: Array) -> sp.csr_matrix:
        return self._motions(places)

    @property
    def resultants(self) -> Array:
        """N and bending moments about the centroid, the torque about the shear centre."""
        (y_c, z_c), (y_s, z_s) = self.section.centroid, self.section.shear_centre
        own = np.eye(6)
        own[0, 4:] = z_c, -y_c
        own[1, 3], own[2, 3] = -z_s, y_s
        return np.linalg.inv(own).T

    def section_forces(self) -> ForceRows:
        E, section, strains = self.body.material.young, self.section, self._strains
        bent = E * self.principal.T @ np.diag(self.second_moments)  # about z and y, of curvatures along principal axes
        stiffness = {
            "normal force": E * section.area * np.eye(4)[0],
            "torque": self.body.material.shear_modulus * section.torsion_constant * np.eye(4)[3],
            "bending moment y": np.array([0.0, *-bent[1], 0.0]),
            "bending moment z": np.array([0.0, *bent[0], 0.0]),
        }
        ends = self.node_stations[self.grid.cells]
        found = force_rows(ends, strains.entries, stiffness, strains.coordinates, self.size)
        return replace(found, rows=sp.csr_matrix(found.rows @ self.transformation))

    @cached_property
    def _strains(self) -> CellValues:
        """The strains u', psi_v', psi_w' and phi' at both ends of each element."""

        def strains(space: Any) -> Any:
            field = ufl.TrialFunction(space)
            v, w = self._deflections(space.mesh, field)
            return ufl.as_vector([field[0].dx(0), v.curvature, w.curvature, field[1].dx(0)])

        return cell_values(self, strains, np.array([[0.0], [1.0]]))


def _measure(mesh: Any) -> Any:
    return ufl.Measure("dx", domain=mesh, metadata={"quadrature_degree": 6})


def _interpolated(plane: Bending, h: Array, X: Array) -> tuple[Array, Array]:
    """Weights (4, q) of w_1, psi_1, w_2, psi_2 in the deflection at X h and in the rotation of the section there."""
    scale = np.stack([np.ones_like(h), h, np.ones_like(h), h])
    derivatives = {k: np.array([np.polyval(np.polyder(p, k), X) for p in HERMITE]) * scale / h**k for k in (0, 1, 3)}
    value, slope, third = derivatives.values()
    gamma = -plane.softening(h) * third
    return value + gamma * h * (X - 3 * X**2 + 2 * X**3), slope + gamma * (-6 * X + 6 * X**2)
