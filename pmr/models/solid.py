r"""Solid: linear elasticity with quadratic displacements, on tetrahedra (P2) or hexahedra (Q2).

.. math::
    k = \int \lambda\, \mathrm{tr}\,\varepsilon\; \mathrm{tr}\,\delta\varepsilon
        + 2 \mu\, \varepsilon : \delta\varepsilon \, dV, \quad
    \varepsilon = \mathrm{sym}\, \nabla u, \qquad
    m = \int \rho\, u \cdot \delta u \, dV

Bathe: Finite Element Procedures, 1996, section 4.2.1.  Cells have straight edges.

Thin walls are the business of hexahedra: one of them across an 8 mm wall, 25 mm wide, gives the bending modes of the
reference boom to 0.06 % and its wall modes to 0.8 %; tetrahedra twice as wide are 0.2 to 0.9 % and up to 20 % off.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import ufl

from pmr.fem.compat import cellwise, lagrange_space, rule_points
from pmr.fields.stress import StressRows
from pmr.mesh.named import NamedMesh
from pmr.models import Forms
from pmr.models.meshed import MeshedModel
from pmr.models.regions import by_region, frequency_scale
from pmr.models.solid_stress import DEGREE, stress_rows
from pmr.models.tabulation import cell_values
from pmr.scene import Body
from pmr.scene.structures import Material, SolidBody

KINDS = ("tetrahedron", "hexahedron")


@dataclass(frozen=True)
class Solid(MeshedModel):
    """The model on a mesh of tetrahedra or hexahedra; it has no rotations, a place's rotation is that of its mean."""

    body: SolidBody
    mesh: NamedMesh

    @property
    def components(self) -> Mapping[int, tuple[int, ...]]:
        """Displacements on vertices and edges, of hexahedra on faces and cells too."""
        return dict.fromkeys(range(4 if self.mesh.cell == "hexahedron" else 2), (0, 1, 2))

    @cached_property
    def materials(self) -> list[Material]:
        """Of each cell."""
        return by_region(self.mesh, self.body.material, self.body.regions)

    @property
    def reference_frequency(self) -> float:
        return frequency_scale(self.mesh.points, self.body.material)

    def space(self, domain: Any) -> Any:
        return lagrange_space(domain, 2)

    def forms(self, space: Any) -> Forms:
        mesh, rho = space.mesh, cellwise(space.mesh, np.array([m.density for m in self.materials]))
        u, du = ufl.TrialFunction(space), ufl.TestFunction(space)
        # Tetrahedra: exact.  Hexahedra: exact for boxes, three Gauss points in each direction.
        k, m = (4, 4) if self.mesh.cell == "hexahedron" else (2, 4)
        dk, dm = (ufl.Measure("dx", domain=mesh, metadata={"quadrature_degree": degree}) for degree in (k, m))
        return Forms(rho * ufl.dot(u, du) * dm, ufl.inner(self._stress(mesh, u), ufl.sym(ufl.grad(du))) * dk)

    def _stress(self, mesh: Any, u: Any) -> Any:
        """The stress tensor in Pa of a displacement."""
        E, nu = (
            cellwise(mesh, np.array(values))
            for values in zip(*((m.young, m.poisson) for m in self.materials), strict=True)
        )
        lame, mu, epsilon = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu)), ufl.sym(ufl.grad(u))
        return lame * ufl.tr(epsilon) * ufl.Identity(3) + 2 * mu * epsilon

    def stress_components(self, space: Any) -> Any:
        """Stresses xx, yy, zz, yz, xz, xy in Pa of a trial function."""
        sigma = self._stress(space.mesh, ufl.TrialFunction(space))
        return ufl.as_vector([sigma[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))])

    def stresses(self) -> StressRows:
        at_points = cell_values(self, self.stress_components, rule_points(self.mesh.cell, DEGREE[self.mesh.cell]))
        return stress_rows(self.mesh, at_points, self.size)


def of(body: Body, mesh: NamedMesh) -> Solid:
    """The solid that a scene's body is."""
    regions = {name: region.material or body.material for name, region in body.regions.items()}
    return Solid(SolidBody(material=body.material, regions=regions), mesh)
