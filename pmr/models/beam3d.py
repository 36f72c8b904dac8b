r"""Beam in space: stretching, torsion and bending in two planes, with C1 cubic Hermite elements.

x is along the axis, y and z are the section's principal axes.  u is the displacement along x of the section's centroid,
v and w are the displacements along y and z of its shear centre, and :math:`\phi` is the twist.  The centroid has the
inertia of translations.  With Young's modulus E, the shear modulus G, the density :math:`\rho` and the section's area
A, torsion constant J and second moments :math:`I_y` and :math:`I_z`, stiffness k and mass m are

.. math::
    k = \int EA\, u' \delta u' + GJ\, \phi' \delta\phi'
        + EI_z \Bigl( v'' \delta v'' - \frac{h^2}{12} \frac{\Phi_y}{1 + \Phi_y} v''' \delta v''' \Bigr)
        + EI_y \Bigl( w'' \delta w'' - \frac{h^2}{12} \frac{\Phi_z}{1 + \Phi_z} w''' \delta w''' \Bigr) dx

.. math::
    m = \int \rho A\, (u\, \delta u + v\, \delta v + w\, \delta w) + \rho (I_y + I_z)\, \phi\, \delta\phi
        + \rho I_z\, \psi_v\, \delta\psi_v + \rho I_y\, \psi_w\, \delta\psi_w \, dx

h is the element's length, :math:`\psi_v` and :math:`\psi_w` are the section's rotations in both planes.  Bending with
shear, and the parameter :math:`\Phi` of each plane, are explained in `pmr.models.sections_along`.

Sections are rigid in their plane and warping is free; an element of a beam that tapers has the mean constants over its
length.  Coordinates are ordered node by node: displacements along and rotations about x, y, z, of a point on the axis,
which moves with its section.  With the section's centroid c and shear centre s beside the axis, and the matrix R that
turns y and z to its principal axes,

.. math::
    u_c = u + z_c \theta_y - y_c \theta_z, \qquad
    \begin{pmatrix} v_s \\ w_s \end{pmatrix} = R \begin{pmatrix} v - z_s \phi \\ w + y_s \phi \end{pmatrix}
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import ufl

from pmr.fem.compat import cellwise, hermite_space
from pmr.files.arrays import Array, Indices
from pmr.models import DIRECTIONS, Forms, UnitState, ufl_product
from pmr.models.beam import Beam, beam_body, measure
from pmr.models.profile_section import RingMasses, ring_masses
from pmr.models.sections_along import (
    Bending,
    Deflection,
    SectionsAlong,
    centre_motion_matrices,
    corner_stress_factors,
    sections_of,
    stations_of,
    stresses_along,
)
from pmr.models.trace import FACES, Extent, Plane
from pmr.results.field_stress import FORCES, ForceRows, StressRows
from pmr.scene.box import Box
from pmr.scene.members import Member
from pmr.scene.structures import Beam3DBody, BeamSection

if TYPE_CHECKING:
    from pmr.fem.compat import Expr, Form, FunctionSpace, Mesh


Motion: TypeAlias = "tuple[Expr | None, ...]"  # displacements along x, y and z in UFL; None: no inertia


@dataclass(frozen=True)
class Beam3D(Beam):
    """Beam in space with the data of a scene's body."""

    body: Beam3DBody
    stations: Array | None = None  # (N,) m: coordinates of the nodes along the axis; None: evenly spaced
    along: SectionsAlong | None = None  # sections change at nodes; None: the same section all along
    rings: RingMasses | None = None  # areas and moments of transverse plates inside

    @cached_property
    def node_stations(self) -> Array:
        """Coordinates (N,) in m of the nodes along the axis; by default evenly spaced."""
        if self.stations is not None:
            return self.stations
        return self.body.length * (np.arange(self.body.elements + 1) / self.body.elements)

    @cached_property
    def sections(self) -> SectionsAlong:
        """Sections along the axis."""
        return self.along or sections_of(self.body, self.node_stations)

    @property
    def section(self) -> BeamSection:
        """Section at the tail."""
        return self.sections.each[0]

    @cached_property
    def planes(self) -> list[Bending]:
        """Bending along both principal axes of the sections, with shear if the body has it and areas are known."""
        E, G = self.body.material.young, self.body.material.shear_modulus
        areas, I = self.sections.shear_areas if self.body.shear else None, self.sections.second_moments.T
        if areas is None:
            return [Bending(E * second_moment) for second_moment in I]
        return [Bending(E * second_moment, G * area) for second_moment, area in zip(I, areas.T, strict=True)]

    @property
    def reference_frequency(self) -> float:
        """Scale of the lowest frequencies in rad/s.

        The scale is sqrt(EI / (rho A L^4)) with the least EI of all sections in both planes, the least rho A and the
        length L.
        """
        softest = min(plane.stiffness.min() for plane in self.planes)
        return float(np.sqrt(softest / self.masses.min()) / self.body.length**2)

    @property
    def masses(self) -> Array:
        """Mass per length (E,) in kg/m of each of E elements, with the mass of its rings."""
        added = 0.0 if self._element_rings is None else self._element_rings.area
        return self.body.material.density * (self.sections.area[self.section_number] + added)

    @cached_property
    def _element_rings(self) -> RingMasses | None:
        """Areas and moments of the rings in each element, spread over its length; None without rings."""
        return None if self.rings is None else self.rings.at_positions(self.node_stations[self.grid.cells].mean(axis=1))

    @property
    def directions(self) -> tuple[str, ...]:
        """All six directions, ``x``, ``y``, ``z``, ``rx``, ``ry`` and ``rz``."""
        return DIRECTIONS

    @property
    def signs(self) -> Array:
        """Ones (6,): each coordinate is the motion itself."""
        return np.ones(6)

    @cached_property
    def node_transformations(self) -> Array:
        """Matrices (K, 6, 6), one per section, that give the function space's coordinates from the axis' motion.

        The coordinates of the function space are u, phi, v, v', w and w'.  u is the displacement along x of the
        centroid; v and w are the displacements of the shear centre along the principal axes.  v' is the rotation about
        z, and w' is minus the rotation about y.
        """
        U = np.zeros((6, 6))
        U[range(6), [0, 3, 1, 5, 2, 4]] = 1.0, 1.0, 1.0, 1.0, 1.0, -1.0
        return np.asarray(U @ self.sections.centre_motions)

    def space(self, domain: Mesh) -> FunctionSpace:
        """Function space on `domain`, an interval mesh: u, phi, and the Hermite functions of both planes.

        Collective.
        """
        return hermite_space(domain, linear=2, planes=2)

    def forms(self, space: FunctionSpace) -> Forms:
        """Mass and stiffness as UFL forms on `space`."""
        mesh = space.mesh
        trial, test = ufl.TrialFunction(space), ufl.TestFunction(space)
        material, sections = self.body.material, self.sections
        EA = self.element_property(mesh, material.young * sections.area)
        GJ = self.element_property(mesh, material.shear_modulus * sections.torsion_constant)

        u, du, phi, dphi = trial[0], test[0], trial[1], test[1]
        stiffness = EA * u.dx(0) * du.dx(0) + GJ * phi.dx(0) * dphi.dx(0)
        for plane, of, by in zip(self.planes, *(self._deflections(mesh, f) for f in (trial, test)), strict=True):
            stiffness += plane.energy(of, by, partial(self.element_property, mesh))
        return Forms(self.inertia(space, ufl.Identity(3)), stiffness * measure(mesh))

    def inertia(self, space: FunctionSpace, S: Expr) -> Form:
        r"""UFL form of the integral of rho v . S u over the body, with the trial and test displacements u and v.

        .. math::
            \int \rho A\, v \cdot S u + \rho I_z\, v_{,y} \cdot S u_{,y} + \rho I_y\, v_{,z} \cdot S u_{,z}\, dx

        `S` (3, 3) is a tensor in UFL.  The point (y, z) of a section moves by :math:`(u - y \psi_v - z \psi_w,\; v - z
        \phi,\; w + y \phi)`, where u, v, w are the displacements of the centroid.  Without shear, the rotations
        :math:`\psi_v` and :math:`\psi_w` of the section have no inertia.  Rings, the transverse plates inside a box,
        add their inertia.
        """
        mesh, sections, rho = space.mesh, self.sections, self.body.material.density
        sizes = sections.area, *sections.second_moments.T
        if sections.is_turned:
            turned = ufl.as_matrix([[1, 0, 0], *([0, *row] for row in self._principal_rotation(mesh))])
            S = turned * S * ufl.transpose(turned)
        of, by = (self._motion(mesh, field) for field in (ufl.TrialFunction(space), ufl.TestFunction(space)))
        parts = zip(sizes, by, of, strict=True)
        total = sum(self.element_property(mesh, rho * size) * ufl_product(S, v, u) for size, v, u in parts)
        return (total + self._ring_inertia(mesh, S, by, of)) * measure(mesh)

    def _ring_inertia(self, mesh: Mesh, S: Expr, test: Sequence[Motion], trial: Sequence[Motion]) -> Expr:
        """Integrand of the rings' inertia in UFL, from `_motion` of the `test` and of the `trial` function.

        S (3, 3) is the matrix of `inertia`.  Rings have their own centroid and second moments.
        """
        added, sections, rho = self._element_rings, self.sections, self.body.material.density
        if added is None:
            return 0
        R = sections.principal[self.section_number]
        y, z = np.einsum("eij,ej->ie", R, added.centroid - sections.centroid[self.section_number])
        arms = cellwise(mesh, y), cellwise(mesh, z)
        second = rho * np.einsum("eij,ejk,elk->eil", R, added.about_centroid, R)

        def centroid_motion(motion: Sequence[Motion]) -> Motion:
            """Displacement of the rings' centroid, from a `motion` as `_motion` returns it.

            A motion is the displacement of the section's centroid, and its derivatives along both principal axes.
            """
            centre, *turns = motion
            for arm, turn in zip(arms, turns, strict=True):
                centre = tuple(c if t is None else c + arm * t for c, t in zip(centre, turn, strict=True))
            return centre

        total = cellwise(mesh, rho * added.area) * ufl_product(S, centroid_motion(test), centroid_motion(trial))
        for j in (0, 1):
            for k in (0, 1):
                total += cellwise(mesh, second[:, j, k]) * ufl_product(S, test[1 + j], trial[1 + k])
        return total

    def _principal_rotation(self, mesh: Mesh) -> list[list[Expr]]:
        """Rows of the matrix R in UFL that turns y and z to the principal axes, constant in each element."""
        return [[self.element_property(mesh, self.sections.principal[:, i, j]) for j in (0, 1)] for i in (0, 1)]

    def _motion(self, mesh: Mesh, field: Expr) -> tuple[Motion, ...]:
        """Displacement of the centroid in a `field`, then its derivatives along both principal axes, in UFL.

        Each of the three has components along x and the principal axes; a component without inertia is None.
        """
        v, w = self._deflections(mesh, field)
        phi = field[1]
        (turn_v, turn_w) = (None if deflection.shear is None else -deflection.rotation for deflection in (v, w))
        return (
            (field[0], *self._centroid_deflections(mesh, v.value, w.value, phi)),
            (turn_v, None, phi),
            (turn_w, -phi, None),
        )

    def _centroid_deflections(self, mesh: Mesh, v: Expr, w: Expr, phi: Expr) -> tuple[Expr, ...]:
        """Deflections of the centroid along the principal axes, from v and w of the shear centre and the twist phi."""
        sections = self.sections
        y, z = np.einsum("kij,kj->ik", sections.principal, sections.centroid - sections.shear_centre)
        v = v - self.element_property(mesh, z) * phi if z.any() else v
        return v, w + self.element_property(mesh, y) * phi if y.any() else w

    def geometric_stiffness(self, space: FunctionSpace, state: UnitState) -> Form:
        r"""UFL form of the geometric stiffness of a state's axial force and bending moments.

        The axial force of the state is N, its deflections are :math:`v_0` and :math:`w_0`, and its bending moments are
        :math:`M_v = EI_z v_0''` and :math:`M_w = EI_y w_0''`.  The trial function has the deflections v, w and the
        twist :math:`\phi`, and the test function the variations :math:`\delta v`, :math:`\delta w` and
        :math:`\delta\phi`.  The form is

        .. math::
            \int N\, \Bigl(v' \delta v' + w' \delta w' + \frac{I_y + I_z}{A} \phi' \delta\phi'\Bigr)
                + (M_w \phi)' \delta v' + v' (M_w \delta\phi)' - (M_v \phi)' \delta w' - w' (M_v \delta\phi)' \, dx

        The term with I_y + I_z, Wagner's, twists a bar that is soft in torsion; moments make a high beam tip over
        sideways.  The form follows from the integral of :math:`\sigma_{jk} u_{i,j} v_{i,k}` with the stresses
        :math:`\sigma`, the motion of sections and the shear force -M'.  Forces act on the axis (Timoshenko, Gere:
        Theory of Elastic Stability, 2nd ed., 1961, sections 5.3 and 6.3).  N moves with the centroid, moments move with
        the shear centre.  The effect of moments on the twist of a section without symmetry is left out.
        """
        mesh, trial, test = space.mesh, ufl.TrialFunction(space), ufl.TestFunction(space)
        of, by = ([deflection.value.dx(0) for deflection in self._deflections(mesh, field)] for field in (trial, test))
        phi, dphi = trial[1], test[1]
        radius2 = self.element_property(mesh, self.sections.polar_moment / self.sections.area)
        fields = ((of, phi), (by, dphi))
        pairs = zip(*(self._centroid_deflections(mesh, v, w, twist.dx(0)) for (v, w), twist in fields), strict=True)
        along = sum(a * b for a, b in pairs) + radius2 * phi.dx(0) * dphi.dx(0)
        moments = [self.moment(mesh, state, component) for component in (1, 2)]
        if self.sections.is_turned:
            moments = [sum(c * M for c, M in zip(row, moments, strict=True)) for row in self._principal_rotation(mesh)]
        M_v, M_w = moments
        across = (M_w * phi).dx(0) * by[0] + of[0] * (M_w * dphi).dx(0)
        across -= (M_v * phi).dx(0) * by[1] + of[1] * (M_v * dphi).dx(0)
        return (self.axial_force(mesh, state) * along + across) * measure(mesh)

    def _deflections(self, mesh: Mesh, field: Expr) -> list[Deflection]:
        """Deflections in both planes of a field in UFL with the components u, phi, w_A, theta_B, w_A and theta_B.

        The first w_A and theta_B belong to bending along y, the second ones to bending along z.
        """
        h = ufl.JacobianDeterminant(mesh)
        middle = cellwise(mesh, self.node_stations[self.grid.cells].mean(axis=1))
        X, of_elements = (ufl.SpatialCoordinate(mesh)[0] - middle) / h + 0.5, partial(self.element_property, mesh)
        cubics = (field[i] + h * field[i + 1] for i in (2, 4))
        return [plane.deflection(w, h, X, of_elements) for plane, w in zip(self.planes, cubics, strict=True)]

    def shape_functions(self, h: Array, X: Array, number: Indices) -> Array:
        """Motion (q, 6, 12) of the axis along and about x, y, z at a point in each of q elements, by unit coordinates.

        Point i is at the share X[i] in [0, 1] of an element with length h[i] in m and section number[i]; h, X and
        number are (q,).  The 12 columns are u, phi, v, v', w and w' at the element's first node, then at its second
        one: displacements u, v and w along x, y and z, the twist phi, and slopes v' and w'.
        """
        local = np.zeros((len(h), 6, 12))
        for row, component in ((0, 0), (3, 1)):
            local[:, row, component], local[:, row, 6 + component] = 1.0 - X, X
        for row, turn, sign, start, plane in zip((1, 2), (5, 4), (1.0, -1.0), (2, 4), self.planes, strict=True):
            value, slope = plane.shape_weights(h, X, number)
            for k, component in enumerate((start, start + 1, 6 + start, 7 + start)):
                local[:, row, component], local[:, turn, component] = value[k], sign * slope[k]
        if np.any(self.sections.centre_motions != np.eye(6)):
            local = np.linalg.inv(self.sections.centre_motions)[number] @ local
        return local

    def faces(self, at: float) -> dict[str, tuple[Plane, Extent]]:
        """Faces of the profile at the coordinate `at` (m) along the axis: plane and extent of each face by its name.

        A beam without a profile has four faces, all of them through the axis.
        """
        profile, along = self.sections.profile_at(at), (0.0, self.body.length)
        if profile is None:
            return {name: (plane, Extent(along)) for name, plane in FACES.items()}
        planes = {}
        for name, side in profile.faces.items():
            normal, across = (np.array([0.0, *pair]) for pair in (side.normal, side.across_direction))
            planes[name] = Plane(normal, across), Extent(along, side.span)
        return planes

    def corner_stresses(self, forces: ForceRows, element: Indices) -> StressRows | None:
        """Axial and torsion stresses in the profile's corners at both ends of the E elements, P = 2 E places.

        `forces` are the rows of the section forces at the places.  `element` (P,) has the number that the result gives
        to the element of each place.  The result is None if a section has no profile.
        """
        return stresses_along(self.sections, np.repeat(self.section_number, 2), forces, element, corner_stress_factors)

    def on_nodes(self, stations: Array) -> Beam3D:
        """Copy of this beam with nodes at `stations` (N,) m, cut where two nodes are at the same point."""
        return replace(self, stations=stations)

    def bending_stiffness(self, direction: str) -> dict[int, Array]:
        """Bending stiffnesses (E,) in N m^2 in both principal planes, for a curvature along `direction`, y or z.

        Bending moments do work on the slopes v' and w'.  The keys 3 and 5 are the numbers of these slopes among a
        node's coordinates in the function space.
        """
        turned = self.sections.principal[:, :, "yz".index(direction)]
        moments = self.body.material.young * self.sections.second_moments * turned
        return {3: moments[self.section_number, 0], 5: moments[self.section_number, 1]}

    @property
    def resultants(self) -> Array:
        """Section forces per unit force on each of a node's six coordinates, (E, 6, 6) for E elements.

        Normal force and bending moments are about the centroid, shear forces and torque about the shear centre.
        """
        return np.linalg.inv(centre_motion_matrices(self.sections)).transpose(0, 2, 1)[self.section_number]

    @property
    def section_stiffness(self) -> dict[str, Array]:
        """Section forces (E, 4) in N or N m in E elements per unit of each of the four `strains`, by name.

        The keys are ``normal force``, ``torque``, ``bending moment y`` and ``bending moment z``.
        """
        material, sections, number = self.body.material, self.sections, self.section_number
        # moments about z and y per unit of the curvatures along the principal axes
        bent = material.young * np.einsum("kji,kj->kij", sections.principal, sections.second_moments)[number]
        stiffness = {name: np.zeros((len(number), 4)) for name in FORCES if "shear" not in name}
        stiffness["normal force"][:, 0] = material.young * sections.area[number]
        stiffness["torque"][:, 3] = material.shear_modulus * sections.torsion_constant[number]
        stiffness["bending moment y"][:, 1:3], stiffness["bending moment z"][:, 1:3] = -bent[:, 1], bent[:, 0]
        return stiffness

    def strains(self, space: FunctionSpace) -> Expr:
        """Stretch u', curvatures psi_v' and psi_w' in both planes, and twist phi' of a trial function, in UFL."""
        field = ufl.TrialFunction(space)
        v, w = self._deflections(space.mesh, field)
        return ufl.as_vector([field[0].dx(0), v.curvature, w.curvature, field[1].dx(0)])


def box_beam(body: Beam3DBody, box: Box) -> Beam3D:
    """Beam in space of a box, with its sections along the axis and the mass of its frames.

    `body` has the material, the profile and the number of elements.
    """
    beam = Beam3D(body)
    if box.varying_keys:
        stations = stations_of(box.breaks, body.elements)
        beam = Beam3D(body, stations, sections_of(body, stations, box))
    return replace(beam, rings=ring_masses(box, beam.node_stations)) if box.frames else beam


def from_member(member: Member) -> Beam3D:
    """Beam in space of a body, from its section or its box."""
    body = beam_body(member)
    return box_beam(body, member.box) if body.profile else Beam3D(body)
