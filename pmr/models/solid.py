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

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
import ufl
from numpy.typing import NDArray

from pmr.dolfinx_compat import MPI, cellwise, lagrange_space
from pmr.mesh.named import NamedMesh
from pmr.mesh.nodes import Nodes, number_nodes
from pmr.mesh.strip import Strip, Window, face_strip
from pmr.mesh.trace import Trace, coordinates_on, section, trace
from pmr.models import DIRECTIONS, Forms
from pmr.models.regions import by_region, frequency_scale, rigid_motions
from pmr.scene.structures import Material, SolidBody

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

KINDS = ("tetrahedron", "hexahedron")
DISPLACEMENTS = (0, 1, 2)


@dataclass(frozen=True)
class Solid:
    """The model on a mesh of tetrahedra or hexahedra; it has no rotations, a place's rotation is that of its mean."""

    body: SolidBody
    mesh: NamedMesh

    @cached_property
    def nodes(self) -> Nodes:
        """On vertices and edges, for hexahedra on faces and cells too."""
        dims = range(4) if self.mesh.cell == "hexahedron" else range(2)
        return number_nodes(self.mesh.cell, self.mesh.points, self.mesh.cells, dict.fromkeys(dims, DISPLACEMENTS))

    @cached_property
    def materials(self) -> list[Material]:
        """Of each cell."""
        return by_region(self.mesh, self.body.material, self.body.regions)

    @property
    def size(self) -> int:
        return self.nodes.size

    @property
    def reference_frequency(self) -> float:
        return frequency_scale(self.mesh.points, self.body.material)

    @property
    def directions(self) -> tuple[str, ...]:
        return DIRECTIONS

    @property
    def transformation(self) -> None:
        """None: the space's coordinates are the model's."""

    def domain(self, comm: MPI.Comm) -> Any:
        return self.mesh.distribute(comm)

    def space(self, domain: Any) -> Any:
        return lagrange_space(domain, 2)

    def forms(self, space: Any) -> Forms:
        mesh = space.mesh
        E, nu, rho = (
            cellwise(mesh, np.array(values))
            for values in zip(*((m.young, m.poisson, m.density) for m in self.materials), strict=True)
        )
        lame, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
        u, du = ufl.TrialFunction(space), ufl.TestFunction(space)
        epsilon, d_epsilon = ufl.sym(ufl.grad(u)), ufl.sym(ufl.grad(du))
        # Tetrahedra: exact.  Hexahedra: exact for boxes, three Gauss points in each direction.
        k, m = (4, 4) if self.mesh.cell == "hexahedron" else (2, 4)
        dk, dm = (ufl.Measure("dx", domain=mesh, metadata={"quadrature_degree": degree}) for degree in (k, m))
        stiffness = (lame * ufl.tr(epsilon) * ufl.tr(d_epsilon) + 2 * mu * ufl.inner(epsilon, d_epsilon)) * dk
        return Forms(rho * ufl.dot(u, du) * dm, stiffness)

    def element_coordinates(self, cells: Indices) -> list[Indices]:
        return self.nodes.per_component(cells)

    def trace(self, place: str | float) -> Trace:
        """Displacements on a named group, or of a cross-section."""
        if isinstance(place, str):
            return trace(self.mesh, self.nodes, place, degree=2)
        return section(self.mesh, self.nodes, place, degree=2)

    def displacement(self, place: str | float) -> sp.csr_matrix:
        return self.trace(place).mean()

    def motion(self, place: str | float, about: Array | None = None) -> sp.csr_matrix:
        return self.trace(place).motion(about)

    def centroid(self, place: str | float) -> Array:
        return self.trace(place).centroid

    def strip(self, face: str, window: Window) -> Strip:
        return face_strip(self.mesh, self.nodes, face, window)

    def coordinates_on(self, place: str, directions: Sequence[str]) -> Indices:
        return coordinates_on(self.mesh, self.nodes, place, [DIRECTIONS.index(d) for d in directions])

    def rigid_motions(self) -> Array:
        return rigid_motions(self.nodes)
