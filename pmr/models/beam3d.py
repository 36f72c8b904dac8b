r"""Beam in space: stretching, torsion and bending in two planes, with C1 cubic Hermite elements.

With x along the axis, y and z the section's principal axes

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

Centroid and shear centre coincide; warping is free.  Coordinates are ordered node by node: displacements along and
rotations about x, y, z.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
import ufl
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.fem.compat import cellwise, constant, hermite_space
from pmr.fields.envelope import ForceRows, force_rows
from pmr.fields.stress import StressRows
from pmr.mesh.strip import FACES, Extent, Strip, Window, line_points
from pmr.models import DIRECTIONS, Forms, UnitState, bilinear
from pmr.models.beam import HERMITE, Beam
from pmr.models.box_section import box_section, stress_rows
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

    @cached_property
    def node_stations(self) -> Array:
        return self.body.length * (np.arange(self.body.elements + 1) / self.body.elements)

    @cached_property
    def section(self) -> BeamSection:
        if self.body.section is not None:
            return self.body.section
        assert self.body.profile is not None
        return box_section(self.body.profile, self.body.material.poisson)

    @cached_property
    def planes(self) -> tuple[Bending, Bending]:
        """Bending along the section's y and z."""
        material, section, shear = self.body.material, self.section, self.body.shear
        return (
            self._plane(section.second_moment_z, section.shear_area_y if shear else None, material.shear_modulus),
            self._plane(section.second_moment_y, section.shear_area_z if shear else None, material.shear_modulus),
        )

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
        sizes = section.area, section.second_moment_z, section.second_moment_y
        of, by = (self._motion(mesh, field) for field in (ufl.TrialFunction(space), ufl.TestFunction(space)))
        parts = zip(sizes, by, of, strict=True)
        return sum(constant(mesh, rho * size) * bilinear(S, v, u) for size, v, u in parts) * _measure(mesh)

    def _motion(self, mesh: Any, field: Any) -> tuple[tuple[Any, Any, Any], ...]:
        """Displacement of the axis, and its derivatives along the section's y and z; None: without inertia."""
        v, w = self._deflections(mesh, field)
        phi, (turn_v, turn_w) = field[1], (None if one.shear is None else -one.rotation for one in (v, w))
        return (field[0], v.value, w.value), (turn_v, None, phi), (turn_w, -phi, None)

    def geometric_stiffness(self, space: Any, state: UnitState) -> Any:
        r"""The form of what an axial force N and moments :math:`M_v = EI_z v_0''`, :math:`M_w = EI_y w_0''` do.

        .. math::
            \int N\, \Bigl(v' \delta v' + w' \delta w' + \frac{I_y + I_z}{A} \phi' \delta\phi'\Bigr)
                + (M_w \phi)' \delta v' + v' (M_w \delta\phi)' - (M_v \phi)' \delta w' - w' (M_v \delta\phi)' \, dx

        Wagner's term, with I_y + I_z, twists a bar that is soft in torsion; moments make a high beam tip over sideways.
        From :math:`\sigma_{jk} u_{i,j} v_{i,k}` with the motion of sections and the shear force -M'; forces act on the
        axis (Timoshenko, Gere: Theory of Elastic Stability, 2nd ed., 1961, sections 5.3 and 6.3).
        """
        mesh, trial, test = space.mesh, ufl.TrialFunction(space), ufl.TestFunction(space)
        of, by = ([one.value.dx(0) for one in self._deflections(mesh, field)] for field in (trial, test))
        phi, dphi = trial[1], test[1]
        radius2 = constant(mesh, self.section.polar_moment / self.section.area)
        along = of[0] * by[0] + of[1] * by[1] + radius2 * phi.dx(0) * dphi.dx(0)
        M_v, M_w = (self.moment(mesh, state, component) for component in (1, 2))
        across = (M_w * phi).dx(0) * by[0] + of[0] * (M_w * dphi).dx(0)
        across -= (M_v * phi).dx(0) * by[1] + of[1] * (M_v * dphi).dx(0)
        return (self.axial_force(mesh, state) * along + across) * _measure(mesh)

    def _deflections(self, mesh: Any, field: Any) -> list[Deflection]:
        """Of a field (u, phi, w_A and theta_B of both planes), in both planes."""
        h = ufl.JacobianDeterminant(mesh)
        middle = cellwise(mesh, (self.node_stations[:-1] + self.node_stations[1:]) / 2.0)
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
        if about is not None:
            arm = np.asarray(about, float) - self.centroid(at)
            rows = sp.vstack([rows[:3] + sp.csr_matrix(np.cross(np.eye(3), arm).T) @ rows[3:], rows[3:]])
        rows = sp.csr_matrix(rows)
        rows.data[np.abs(rows.data) < 1e-14] = 0.0
        rows.eliminate_zeros()
        return rows

    def _motions(self, places: Array) -> sp.csr_matrix:
        """Displacements and rotations at distances along the axis, (6 len(places), n)."""
        e = self._elements(places)
        h = np.diff(self.node_stations)[e]
        local = self._in_elements(h, (places - self.node_stations[e]) / h)
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
        if face not in FACES:
            raise InputError("scene", "pads.on", face, f"a beam has the faces {', '.join(FACES)}")
        component, sign = FACES[face]
        points, weights = line_points(window, self.node_stations)
        across = sum(window.across) / 2.0
        normal = sign * np.eye(3)[component]
        turning = np.cross(across * np.eye(3)[3 - component], normal)  # (theta x arm) n = theta (arm x n)
        entries, ends = np.tile([*normal, *turning], len(points)), 6 * np.arange(len(points) + 1)
        weighed = sp.csr_matrix((entries, np.arange(len(entries)), ends), shape=(len(points), 6 * len(points)))
        normals = sp.csr_matrix(weighed @ self._motions(points))
        return Strip(points, np.full(len(points), across), weights, normals, self._extent(component), line=True)

    def _extent(self, component: int) -> Extent:
        """Of a face whose normal is that component: as long as the axis, as broad as the profile, if there is one."""
        profile, along = self.body.profile, (0.0, self.body.length)
        if profile is None:
            return Extent(along)
        half = (profile.height if component == 1 else profile.width) / 2.0
        return Extent(along, (-half, half))

    def _elements(self, places: Array) -> Indices:
        """Numbers of the elements that hold places along the axis."""
        return np.clip(np.searchsorted(self.node_stations, places, side="right") - 1, 0, self.body.elements - 1)

    def stresses(self) -> StressRows | None:
        return (
            None if self.body.profile is None else stress_rows(self.grid, self.transformation, self.body, self._strains)
        )

    def section_forces(self) -> ForceRows:
        E, section, strains = self.body.material.young, self.section, self._strains
        stiffness = {
            "normal force": E * section.area * np.eye(4)[0],
            "torque": self.body.material.shear_modulus * section.torsion_constant * np.eye(4)[3],
            "bending moment y": -E * section.second_moment_y * np.eye(4)[2],
            "bending moment z": E * section.second_moment_z * np.eye(4)[1],
        }
        T, x = self.transformation, self.node_stations
        found = force_rows(
            np.column_stack([x[:-1], x[1:]]), strains.entries, stiffness, strains.coordinates, len(x) * 6
        )
        return replace(found, rows=sp.csr_matrix(found.rows @ T))

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
