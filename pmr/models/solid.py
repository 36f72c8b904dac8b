r"""Solid: linear elasticity with quadratic displacements, on tetrahedra (P2) or hexahedra (Q2).

With the displacement u, the strain :math:`\varepsilon`, Lame's constants :math:`\lambda` and :math:`\mu` and the
density :math:`\rho`, stiffness k and mass m are

.. math::
    k = \int \lambda\, \mathrm{tr}\,\varepsilon\; \mathrm{tr}\,\delta\varepsilon
        + 2 \mu\, \varepsilon : \delta\varepsilon \, dV, \quad
    \varepsilon = \mathrm{sym}\, \nabla u, \qquad
    m = \int \rho\, u \cdot \delta u \, dV

Bathe: Finite Element Procedures, 1996, section 4.2.1.  Cells have straight edges.

Hexahedra suit thin walls: with a single one across an 8 mm wall, and a size of 25 mm along it, the bending modes of the
reference boom have errors of 0.06 % and its wall modes of 0.8 %.  With tetrahedra of twice the size the errors are 0.2
to 0.9 % and up to 20 %.

Strains of quadratic elements are most accurate at Gauss' points, two in each direction of a hexahedron (Barlow: Optimal
stress locations in finite element models, International Journal for Numerical Methods in Engineering 10, 1976,
243-251), four in a tetrahedron.  From these points the strains are continued linearly to the middle of each facet that
belongs to the surface, so that the bending of a wall with a single cell across shows on both of its faces.  In the
middle of a cell the strains are their mean over its points, in a wall the membrane strain.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import ufl

from pmr.fem.compat import cellwise, integration_measure, lagrange_rule, lagrange_space, rule_points
from pmr.models import Forms, UnitState
from pmr.models.meshed import (
    FACES,
    CellProperties,
    MeshedModel,
    cell_values,
    coordinate_rows,
    frequency_scale,
    outward_signs,
    region_properties,
)
from pmr.models.named_mesh import NamedMesh, skin
from pmr.results.field_stress import SPATIAL, StressRows
from pmr.scene import Body
from pmr.scene.structures import SolidBody

if TYPE_CHECKING:
    from pmr.fem.compat import Expr, Form, FunctionSpace, Mesh


KINDS = ("tetrahedron", "hexahedron")
#: Degree of the quadrature rule with two points in each direction of a hexahedron, or four in a tetrahedron.
DEGREE = {"hexahedron": 3, "tetrahedron": 2}


@dataclass(frozen=True)
class Solid(MeshedModel):
    """Solid on a mesh of tetrahedra or hexahedra.  No coordinate is a rotation; a place turns with its mean motion."""

    body: SolidBody
    mesh: NamedMesh

    @property
    def components(self) -> Mapping[int, tuple[int, ...]]:
        """Components of an entity's node, by the dimension of the entity.

        Displacements are on vertices and edges, on hexahedra also on faces and in cells.
        """
        return dict.fromkeys(range(4 if self.mesh.cell == "hexahedron" else 2), (0, 1, 2))

    @cached_property
    def materials(self) -> CellProperties:
        """Material of each cell.

        Raises the errors of `region_properties`.
        """
        return region_properties(self.mesh, self.body.material, self.body.regions)

    @property
    def reference_frequency(self) -> float:
        """Scale of the lowest circular frequencies in rad/s."""
        return frequency_scale(self.mesh.points, self.body.material)

    def space(self, domain: Mesh) -> FunctionSpace:
        """Function space on `domain`, the mesh in dolfinx; collective."""
        return lagrange_space(domain, 2)

    def forms(self, space: FunctionSpace) -> Forms:
        """Mass and stiffness as UFL forms on `space`."""
        u, du = ufl.TrialFunction(space), ufl.TestFunction(space)
        # Tetrahedra: exact.  Hexahedra: exact for boxes, three Gauss points in each direction.
        dk = integration_measure(space.mesh, 4 if self.mesh.cell == "hexahedron" else 2)
        stiffness = ufl.inner(self._stress(space.mesh, u), ufl.sym(ufl.grad(du))) * dk
        return Forms(self.inertia(space, ufl.Identity(3)), stiffness)

    def inertia(self, space: FunctionSpace, S: Expr) -> Form:
        """UFL form of the integral of rho v . S u over the volume, for the trial function u and the test function v."""
        rho = cellwise(space.mesh, self.materials.values("density"))
        u, du = ufl.TrialFunction(space), ufl.TestFunction(space)
        return rho * ufl.dot(du, ufl.dot(S, u)) * integration_measure(space.mesh, 4)

    def geometric_stiffness(self, space: FunctionSpace, state: UnitState) -> Form:
        """UFL form of the integral of sigma_jk u_i,j v_i,k over the volume, for trial and test functions u and v.

        sigma are the stresses of a unit state.
        """
        u, du = ufl.TrialFunction(space), ufl.TestFunction(space)
        sigma = self._stress(space.mesh, state.displacement())
        return ufl.inner(ufl.dot(ufl.grad(u), sigma), ufl.grad(du)) * integration_measure(space.mesh, 4)

    def _stress(self, mesh: Mesh, u: Expr) -> Expr:
        """Stress tensor in Pa of a displacement u, in UFL."""
        E, nu = (cellwise(mesh, self.materials.values(name)) for name in ("young", "poisson"))
        lame, mu, epsilon = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu)), ufl.sym(ufl.grad(u))
        return lame * ufl.tr(epsilon) * ufl.Identity(3) + 2 * mu * epsilon

    def stress_components(self, space: FunctionSpace) -> Expr:
        """Stresses xx, yy, zz, yz, xz and xy in Pa of a trial function, as a UFL vector."""
        sigma = self._stress(space.mesh, ufl.TrialFunction(space))
        return ufl.as_vector([sigma[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))])

    def stresses(self) -> StressRows:
        """Stresses at the middle of each facet of the surface, then in the middle of each cell.

        Facets are on the face ``outer``, or on ``inner`` if they look towards the body's axis; cells are on ``middle``.
        Only faces that have stresses are named.
        """
        mesh, degree, surface = self.mesh, DEGREE[self.mesh.cell], skin(self.mesh)
        at_points = cell_values(self, self.stress_components, rule_points(mesh.cell, degree))
        continued = np.linalg.inv(lagrange_rule(mesh.cell, 1, degree).functions)  # from the points to the vertices
        at_vertex = (surface.vertices[:, :, None] == mesh.cells[surface.cell][:, None, :]).any(axis=1)
        of_facet = (at_vertex / at_vertex.sum(axis=1, keepdims=True)) @ continued
        middle = np.einsum("q,cqvd->cvd", np.mean(continued, axis=0), at_points.entries)
        shown = np.einsum("fq,fqvd->fvd", of_facet, at_points.entries[surface.cell])
        cell = np.concatenate([surface.cell, np.arange(len(mesh.cells))])
        at = mesh.points[surface.vertices].mean(axis=1)
        inner = FACES.index("inner") * (outward_signs(mesh, at, surface.normals) < 0.0)
        face = np.concatenate([inner, np.full(len(mesh.cells), FACES.index("middle"))])
        rows = coordinate_rows(np.concatenate([shown, middle]), at_points.coordinates[cell], self.size)
        rows.eliminate_zeros()
        return StressRows(
            rows=rows,
            mises=SPATIAL,
            components=("xx", "yy", "zz", "yz", "xz", "xy"),
            points=np.concatenate([at, mesh.points[mesh.cells].mean(axis=1)]),
            cell=cell,
            faces=tuple(name for k, name in enumerate(FACES) if np.any(face == k)),
            face=np.unique(face, return_inverse=True)[1],
        )


def of(body: Body, mesh: NamedMesh) -> Solid:
    """Solid model of a scene's body on a mesh."""
    regions = {name: region.material or body.material for name, region in body.regions.items()}
    return Solid(SolidBody(material=body.material, regions=regions), mesh)
