r"""Planar Euler-Bernoulli beam with C1 cubic Hermite elements.

With the displacements u along x and w along z and their variations :math:`\delta u` and :math:`\delta w`, the bending
stiffness EI, the axial stiffness EA, the mass per length :math:`\rho A` and the axial force N, stiffness k, mass m and
geometric stiffness g are

.. math::
    k(w, \delta w) = \int EI\, w'' \delta w'' + EA\, u' \delta u' \, dx, \qquad
    m(w, \delta w) = \int \rho A\, (w\, \delta w + u\, \delta u) \, dx, \qquad
    g(w, \delta w) = \int N\, w' \delta w' \, dx

A profile's own tension is an N that the stiffness has.  Shear deformation and rotary inertia are neglected.  Cook,
Malkus, Plesha: Concepts and Applications of Finite Element Analysis, 3rd ed., 1989, sections 4.2 and 13.3; H. P. Gavin:
Structural Element Stiffness, Mass, and Damping Matrices, 2020.  Coordinates are ordered node by node: [u,] w, w', of a
point on the axis, which moves with its section.  If the section's centroid is the height :math:`z_c` above the axis, it
moves by :math:`u_c = u - z_c w'` along x.  z is up, and the rotation about y is -w'.  Constants of a section that
tapers are its means over the element.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import ufl

from pmr.fem.compat import hermite_space
from pmr.files.arrays import Array, Indices
from pmr.models import Forms, UnitState, ufl_product
from pmr.models.beam import Beam, beam_body, measure
from pmr.models.mesh_drawing import graded_nodes, read_nodes
from pmr.models.sections_along import (
    HERMITE,
    Bending,
    SectionsAlong,
    fibre_stress_factors,
    sections_of,
    stations_of,
    stresses_along,
)
from pmr.models.trace import FACES, Extent, Plane
from pmr.results.field_stress import ForceRows, StressRows
from pmr.scene.box import Box
from pmr.scene.members import Member
from pmr.scene.structures import Beam3DBody, Profile

if TYPE_CHECKING:
    from pmr.fem.compat import Expr, Form, FunctionSpace, Mesh


@dataclass(frozen=True)
class Stiffnesses:
    """Stiffnesses, masses per length and centroids of K sections."""

    bending: Array  # (K,) N m^2
    axial: Array | None  # (K,) N; None if there are no axial coordinates
    mass: Array  # (K,) kg/m
    centroid: Array  # (K,) m above the axis


@dataclass(frozen=True)
class Beam2D(Beam):
    """Planar beam on nodes (N,) m, given by its stiffnesses (`Profile`) or by its section (`Beam3DBody`)."""

    body: Profile | Beam3DBody
    nodes: Array
    along: SectionsAlong | None = None  # sections change at nodes; None: the same section all along

    @cached_property
    def sections(self) -> SectionsAlong | None:
        """Sections along the axis; None for a beam that is given by its stiffnesses."""
        if isinstance(self.body, Profile):
            return None
        return self.along or sections_of(self.body, self.nodes)

    @cached_property
    def stiffnesses(self) -> Stiffnesses:
        """Stiffnesses, masses per length and centroids of the sections.

        A body with given stiffnesses is one section with its centroid on the axis, and without an axial stiffness
        unless the body has axial coordinates.
        """
        body, sections = self.body, self.sections
        if isinstance(body, Profile):
            EI, EA, mass = (
                None if stiffness is None else np.array([stiffness])
                for stiffness in (body.bending_stiffness, body.axial_stiffness, body.mass_per_length)
            )
            assert EI is not None and mass is not None
            return Stiffnesses(EI, EA if body.axial else None, mass, np.zeros(1))
        assert sections is not None
        I = np.array([section.second_moment_y for section in sections.each])
        young, area = body.material.young, sections.area
        return Stiffnesses(young * I, young * area, body.material.density * area, sections.centroid[:, 1])

    @property
    def reference_frequency(self) -> float:
        """Scale of the lowest frequencies in rad/s: sqrt(EI / (rho A L^4)) with the least EI and the least rho A."""
        of = self.stiffnesses
        return float(np.sqrt(of.bending.min() / of.mass.min()) / self.body.length**2)

    @property
    def round_off(self) -> float:
        """Relative error to expect in the lowest frequency from round-off in the stiffness.

        The error is 2e-17 times the sum of (L / h)^3 over the elements, with the beam's length L and the elements'
        lengths h; the factor was found by tests.  Entries 12 EI / h^3 of an element cancel where the element only
        rotates.  The round-off that remains acts like a spring against this rotation.
        """
        return float(2e-17 * np.sum((self.body.length / np.diff(self.nodes)) ** 3))

    @property
    def masses(self) -> Array:
        """Mass per length (E,) in kg/m of each of E elements."""
        return self.stiffnesses.mass[self.section_number]

    @property
    def node_stations(self) -> Array:
        """Coordinates (N,) in m of the nodes along the axis."""
        return self.nodes

    @property
    def directions(self) -> tuple[str, ...]:
        """The directions ``z`` and ``ry``, with ``x`` before them if the beam has axial coordinates."""
        return ("z", "ry") if self.stiffnesses.axial is None else ("x", "z", "ry")

    @property
    def signs(self) -> Array:
        """Signs (d,) of the d directions: -1 for ``ry``, whose coordinate is w', minus the rotation; else 1."""
        return np.array([-1.0 if direction == "ry" else 1.0 for direction in self.directions])

    @cached_property
    def node_transformations(self) -> Array:
        """Matrices (K, d, d), one per section, that give u of the centroid, w and w' from coordinates on the axis.

        u is left out for a beam without axial coordinates.
        """
        U = np.tile(np.eye(len(self.directions)), (len(self.stiffnesses.mass), 1, 1))
        if "x" in self.directions:
            U[:, 0, 2] = -self.stiffnesses.centroid
        return U

    def space(self, domain: Mesh) -> FunctionSpace:
        """Function space of the beam on `domain`, a dolfinx interval mesh; collective."""
        return hermite_space(domain, linear=len(self.directions) - 2)

    def forms(self, space: FunctionSpace) -> Forms:
        """Mass and stiffness as UFL forms on `space`."""
        mesh, of = space.mesh, self.stiffnesses
        (u, _, w), (du, _, dw) = (self._displacement(field) for field in _trial_and_test(space))
        stiffness = self.element_property(mesh, of.bending) * w.dx(0).dx(0) * dw.dx(0).dx(0)
        if of.axial is not None:
            stiffness += self.element_property(mesh, of.axial) * u.dx(0) * du.dx(0)
        if isinstance(self.body, Profile) and self.body.tension:
            stiffness += self.element_property(mesh, np.array([self.body.tension])) * w.dx(0) * dw.dx(0)
        return Forms(self.inertia(space, ufl.Identity(3)), stiffness * measure(mesh))

    def inertia(self, space: FunctionSpace, S: Expr) -> Form:
        """UFL form of the integral of rho A v . S u along the axis, for trial and test displacements u and v.

        `S` is a tensor (3, 3) in UFL.  Rotary inertia is neglected.
        """
        u, v = (self._displacement(field) for field in _trial_and_test(space))
        return self.element_property(space.mesh, self.stiffnesses.mass) * ufl_product(S, v, u) * measure(space.mesh)

    def geometric_stiffness(self, space: FunctionSpace, state: UnitState) -> Form:
        """UFL form of the integral of N w' dw' along the axis, with the state's axial force N.

        w and dw are the deflections of trial and test function.
        """
        w, dw = (self._displacement(field)[2] for field in _trial_and_test(space))
        return self.axial_force(space.mesh, state) * w.dx(0) * dw.dx(0) * measure(space.mesh)

    def _displacement(self, field: Expr) -> tuple[Expr, ...]:
        """Displacements along x, y and z of a `field` in UFL; None for directions that the model does not have."""
        i = self.directions.index("z")
        J = ufl.JacobianDeterminant(field.ufl_function_space().ufl_domain())
        return field[0] if i else None, None, field[i] + J * field[i + 1]

    def shape_functions(self, h: Array, X: Array, number: Indices) -> Array:
        """Shape functions (q, d, 2 d): motion of the axis at a point in each of q elements.

        Point i is at the share X[i] in [0, 1] of an element with length h[i] in m and section number[i]; h, X and
        number are (q,).  Rows are the motions along and about the `directions`.  Columns are the d coordinates of the
        element's first node, then those of its second node; d is 3 with axial motion, else 2.
        """
        d, (value, slope) = len(self.directions), Bending(self.stiffnesses.bending).shape_weights(h, X, number)
        local = np.zeros((len(h), d, 2 * d))
        for k, component in enumerate((d - 2, d - 1, 2 * d - 2, 2 * d - 1)):
            local[:, d - 2, component], local[:, d - 1, component] = value[k], -slope[k]
        if d == 3:
            local[:, 0, 0], local[:, 0, 3] = 1.0 - X, X
            local[:, 0] -= self.stiffnesses.centroid[number, None] * local[:, 2]
        return local

    def faces(self, at: float) -> dict[str, tuple[Plane, Extent]]:
        """The faces ``bottom`` and ``top`` by name, each with its plane and its extent.

        Each face spans the whole beam, whatever `at` is.
        """
        return {name: (FACES[name], Extent((0.0, self.body.length))) for name in ("bottom", "top")}

    def corner_stresses(self, forces: ForceRows, element: Indices) -> StressRows | None:
        """Rows of the axial stresses in the lowest and highest fibre at both ends of the E elements, P = 2 E places.

        `forces` are the rows of the section forces at the places.  `element` (P,) has the number that the result gives
        to the element of each place.  The result is None if the beam is given by its stiffnesses, since its section has
        no shape.
        """
        if self.sections is None:
            return None
        return stresses_along(self.sections, np.repeat(self.section_number, 2), forces, element, fibre_stress_factors)

    def on_nodes(self, stations: Array) -> Beam2D:
        """Copy of this beam with nodes at `stations` (N,) m; the beam is cut through where two stations are equal."""
        return replace(self, nodes=stations)

    def bending_stiffness(self, direction: str) -> dict[int, Array]:
        """Bending stiffness EI (E,) in N m^2 of E elements for the direction z, empty for y.

        The only key is the number of the slope w' among a node's coordinates.
        """
        return {len(self.directions) - 1: self.stiffnesses.bending[self.section_number]} if direction == "z" else {}

    @property
    def resultants(self) -> Array:
        """Normal force, shear force and bending moment per unit force on each of a node's d coordinates, (E, d, d).

        Without axial coordinates there is no normal force.
        """
        of_own = np.diag([1.0, 1.0, -1.0][-len(self.directions) :])
        return (of_own @ np.linalg.inv(self.node_transformations).transpose(0, 2, 1))[self.section_number]

    @property
    def section_stiffness(self) -> dict[str, Array]:
        """Section forces (E, v) in N or N m in E elements per unit of each of v `strains`, by name.

        The keys are ``bending moment y`` and, if there are axial coordinates, ``normal force``.  A positive curvature
        w'' has a negative moment -EI w''.
        """
        of, rows = self.stiffnesses, {}
        bent = -of.bending[self.section_number]
        if of.axial is None:
            return {"bending moment y": bent[:, None]}
        rows["bending moment y"] = np.stack([np.zeros_like(bent), bent], axis=1)
        rows["normal force"] = np.stack([of.axial[self.section_number], np.zeros_like(bent)], axis=1)
        return rows

    def strains(self, space: FunctionSpace) -> Expr:
        """Strain u', if there are axial coordinates, and curvature w'' of a trial function as a UFL vector."""
        u, _, w = self._displacement(ufl.TrialFunction(space))
        return ufl.as_vector([*([] if u is None else [u.dx(0)]), w.dx(0).dx(0)])

    @property
    def deflection(self) -> Array:
        """Coefficients (4, E, 4) of the deflection w on E elements, a cubic in the distance from the first node.

        The first axis has the powers 3, 2, 1, 0, the last axis the element's coordinates in `bending_dofs`.
        """
        h = np.diff(self.nodes[self.grid.cells])[:, 0]
        powers = h ** -np.arange(3.0, -1.0, -1.0)[:, None]  # (x / h)^p
        c = np.asarray(HERMITE.T[:, None, :] * powers[:, :, None])
        c[:, :, [1, 3]] *= h[:, None]
        return c

    @property
    def bending_dofs(self) -> Indices:
        """Numbers (E, 4) of the coordinates w and w' at the first, then at the second node of each of E elements."""
        d = len(self.directions)
        of_node = d * self.grid.cells[:, :, None] + np.array([d - 2, d - 1])
        return np.asarray(of_node.reshape(-1, 4))


def planar_beam(body: Beam3DBody, box: Box, nodes: Array) -> Beam2D:
    """Planar beam of a box on `nodes` (N,) in m.

    If the box varies along the axis, `nodes` are not used.  The beam then has nodes at all places where the box
    changes, and about `body.elements` elements.
    """
    if not box.varying_keys:
        return Beam2D(body, nodes)
    stations = stations_of(box.breaks, body.elements)
    return Beam2D(body, stations, sections_of(body, stations, box))


def from_member(member: Member) -> Beam2D:
    """Planar beam of a body from its stiffnesses or its box, on generated nodes or on the nodes of a mesh file.

    Raises the errors of `read_nodes`.
    """
    body, mesh, length = member.part.body, member.part.mesh, member.part.length
    nodes = graded_nodes(length, mesh.elements, mesh.grading) if mesh.file is None else read_nodes(mesh.file, length)
    return Beam2D(body.profile, nodes) if body.profile else planar_beam(beam_body(member), member.box, nodes)


def _trial_and_test(space: FunctionSpace) -> tuple[Expr, ...]:
    """Trial and test function of a space."""
    return ufl.TrialFunction(space), ufl.TestFunction(space)
