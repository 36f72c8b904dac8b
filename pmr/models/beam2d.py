r"""Planar Euler-Bernoulli beam with C1 cubic Hermite elements.

.. math::
    k(w, \delta w) = \int EI\, w'' \delta w'' + EA\, u' \delta u' \, dx, \qquad
    m(w, \delta w) = \int \rho A\, (w\, \delta w + u\, \delta u) \, dx, \qquad
    g(w, \delta w) = \int N\, w' \delta w' \, dx

Shear deformation and rotary inertia are neglected.  Cook, Malkus, Plesha: Concepts and Applications of Finite Element
Analysis, 3rd ed., 1989, sections 4.2 and 13.3; H. P. Gavin: Structural Element Stiffness, Mass, and Damping
Matrices, 2020.  Coordinates are ordered node by node: [u,] w, w'.  z is up: w is the displacement along z, and the
rotation about y is -w'.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
import ufl
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.fem.compat import constant, hermite_space
from pmr.fields.envelope import FORCES, ForceRows, force_rows
from pmr.fields.stress import StressRows
from pmr.mesh.strip import Extent, Strip, Window, line_points
from pmr.models import Forms, UnitState, bilinear
from pmr.models.beam import HERMITE, Beam
from pmr.models.profile_section import section_of, stress_rows
from pmr.scene.profile import BoxProfile
from pmr.scene.structures import Profile

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SLOPES = np.array([np.polyder(shape) for shape in HERMITE])
FACES = {"bottom": -1.0, "top": 1.0}  # outward normals along z


@dataclass(frozen=True)
class Beam2D(Beam):
    """The model on given nodes (N,) m."""

    body: Profile
    nodes: Array
    box: BoxProfile | None = None  # that its stiffnesses are of, where it is known

    @property
    def reference_frequency(self) -> float:
        """sqrt(EI / (rho A L^4)) in rad/s: the scale of the lowest frequencies."""
        body = self.body
        return float(np.sqrt(body.bending_stiffness / body.mass_per_length) / body.length**2)

    @property
    def round_off(self) -> float:
        """Relative error to expect in the lowest frequency from round-off in the stiffness, measured: 2e-17 times the
        sum of (L / h)^3 over the elements.

        Entries of 12 EI / h^3 have to cancel to leave rigid rotation free; what is left of them in each element acts as
        a spring.
        """
        return float(2e-17 * np.sum((self.body.length / np.diff(self.nodes)) ** 3))

    @property
    def masses(self) -> Array:
        return np.full(len(self.lengths), self.body.mass_per_length)

    @property
    def node_stations(self) -> Array:
        return self.nodes

    @property
    def directions(self) -> tuple[str, ...]:
        return ("x", "z", "ry") if self.body.axial else ("z", "ry")

    @property
    def transformation(self) -> None:
        """None: the space's coordinates are the model's."""

    def space(self, domain: Any) -> Any:
        """Function space on a dolfinx interval mesh."""
        return hermite_space(domain, linear=int(self.body.axial))

    def forms(self, space: Any) -> Forms:
        """Mass and stiffness as UFL forms."""
        mesh, body = space.mesh, self.body
        (u, _, w), (du, _, dw) = (self._displacement(field) for field in _trial_and_test(space))
        stiffness = constant(mesh, body.bending_stiffness) * w.dx(0).dx(0) * dw.dx(0).dx(0)
        if body.axial_stiffness is not None and u is not None:
            stiffness += constant(mesh, body.axial_stiffness) * u.dx(0) * du.dx(0)
        return Forms(self.inertia(space, ufl.Identity(3)), stiffness * _measure(mesh))

    def inertia(self, space: Any, S: Any) -> Any:
        """The form of int rho A v . S u dx; without rotary inertia."""
        u, v = (self._displacement(field) for field in _trial_and_test(space))
        return constant(space.mesh, self.body.mass_per_length) * bilinear(S, v, u) * _measure(space.mesh)

    def geometric_stiffness(self, space: Any, state: UnitState) -> Any:
        """The form of int N w' dw' dx."""
        w, dw = (self._displacement(field)[2] for field in _trial_and_test(space))
        return self.axial_force(space.mesh, state) * w.dx(0) * dw.dx(0) * _measure(space.mesh)

    def _displacement(self, field: Any) -> tuple[Any, None, Any]:
        """Along x, y and z, in UFL; None where the model does not know it."""
        i = self.directions.index("z")
        J = ufl.JacobianDeterminant(field.ufl_function_space().ufl_domain())
        return field[0] if i else None, None, field[i] + J * field[i + 1]

    def point(self, x: float, direction: str) -> tuple[NDArray[np.int64], Array]:
        """Coordinates (d,) and weights (d,) of the displacement along x or z, or rotation ry: exact interpolation.

        The same row applies a point force (or moment) there and measures a point displacement.
        """
        first = min(max(int(np.searchsorted(self.nodes, x, side="right")) - 1, 0), len(self.nodes) - 2)
        h = self.nodes[first + 1] - self.nodes[first]
        xi = (x - self.nodes[first]) / h
        if direction == "x":
            dofs, values = [self._dof(first, "x"), self._dof(first + 1, "x")], np.array([1.0 - xi, xi])
        else:
            dofs = self._bending_dofs(first)
            slope = direction == "ry"
            values = (SLOPES if slope else HERMITE) @ xi ** np.arange(2.0 if slope else 3.0, -1.0, -1.0)
            values[[1, 3]] *= h
            if slope:
                values /= -h
        used = np.abs(values) > 1e-14
        return np.array(dofs, np.int64)[used], values[used]

    def motion(self, place: str | float, about: Array | None = None) -> sp.csr_matrix:
        if about is not None:
            allowed = "the place itself is allowed: a planar beam has no points beside it"
            raise InputError("scene", "place", place, allowed)
        return self._rows([(self.station(place), direction) for direction in self.directions])

    def _rows(self, points: Sequence[tuple[float, str]]) -> sp.csr_matrix:
        """As `point`, of several, (len(points), n)."""
        parts = [self.point(x, direction) for x, direction in points]
        ends = np.cumsum([0, *(len(dofs) for dofs, _ in parts)])
        columns = np.concatenate([np.empty(0, np.int64), *(dofs for dofs, _ in parts)])
        weights = np.concatenate([np.empty(0), *(values for _, values in parts)])
        return sp.csr_matrix((weights, columns, ends), shape=(len(parts), self.size))

    def strip(self, face: str, window: Window) -> Strip:
        """The line that stands for bottom or top; how far below or above the axis it is plays no role."""
        if face not in FACES:
            raise InputError("scene", "pads.on", face, f"a planar beam has the faces {', '.join(FACES)}")
        points, weights = line_points(window, self.nodes)
        across = np.full(len(points), sum(window.across) / 2.0)
        normals = FACES[face] * self._rows([(x, "z") for x in points.tolist()])
        return Strip(points, across, weights, normals, Extent((0.0, self.body.length)), line=True)

    def rigid_motions(self) -> Array:
        motions = super().rigid_motions()
        motions[self.directions.index("ry") :: len(self.directions)] *= -1.0
        return motions

    def corner_stresses(self, forces: ForceRows, element: Indices) -> StressRows | None:
        """Axial stress below and above; None where no more than stiffnesses are known."""
        if self.box is None:
            return None
        section, heights = section_of(self.box, 0.0), [corner.at[1] for corner in self.box.corners]
        corners = {"bottom": np.array([0.0, min(heights)]), "top": np.array([0.0, max(heights)])}
        of = np.zeros((2, 1, len(FORCES)))
        of[:, 0, 0] = 1.0 / section.area
        of[:, 0, 4] = [(z - section.centroid[1]) / section.second_moment_y for _, z in corners.values()]
        return stress_rows(forces, element, corners, of)

    def on_nodes(self, stations: Array) -> Beam2D:
        return replace(self, nodes=stations)

    def interpolated(self, places: Array) -> sp.csr_matrix:
        rows = self._rows([(x, direction) for x in places.tolist() for direction in self.directions])
        turned = [-1.0 if direction == "ry" else 1.0 for direction in self.directions]
        return sp.csr_matrix(sp.diags(np.tile(turned, len(places))) @ rows)

    @property
    def resultants(self) -> Array:
        of_node = np.diag([1.0, 1.0, -1.0][-len(self.directions) :])
        return np.broadcast_to(of_node, (len(self.lengths), *of_node.shape))

    def section_forces(self) -> ForceRows:
        strains, coordinates = self._strains()
        stiffness = {"bending moment y": np.array([0.0, -self.body.bending_stiffness])}
        if self.body.axial and self.body.axial_stiffness is not None:
            stiffness["normal force"] = np.array([self.body.axial_stiffness, 0.0])
        return force_rows(self.nodes[self.grid.cells], strains, stiffness, coordinates, self.size)

    def _strains(self) -> tuple[Array, NDArray[np.int64]]:
        """The strains u' and w'' at both ends of the E elements, (E, 2, 2, d), and coordinates (E, d) they are of."""
        h, own = self.lengths, len(self.directions)
        strains = np.zeros((len(h), 2, 2, 2 * own))
        bent = [k for node in (0, own) for k in range(node + own - 2, node + own)]
        for end, xi in enumerate((0.0, 1.0)):
            second = np.array([np.polyval(np.polyder(shape, 2), xi) for shape in HERMITE])
            strains[:, end, 1, bent] = second / h[:, None] ** np.array([2.0, 1.0, 2.0, 1.0])
            if self.body.axial:
                strains[:, end, 0, [0, own]] = np.array([-1.0, 1.0]) / h[:, None]
        return strains, own * self.grid.cells[:, :1] + np.arange(2 * own)

    @property
    def lengths(self) -> Array:
        """Of the elements, m."""
        return np.diff(self.nodes[self.grid.cells])[:, 0]

    @property
    def deflection(self) -> Array:
        """W on each element as an exact cubic of the distance from its first node: coefficients (4, elements, 4).

        The highest power is first; the last axis counts the coordinates, which `bending_dofs` numbers.
        """
        h = self.lengths
        powers = h ** -np.arange(3.0, -1.0, -1.0)[:, None]  # (x / h)^p
        c = np.asarray(HERMITE.T[:, None, :] * powers[:, :, None])
        c[:, :, [1, 3]] *= h[:, None]
        return c

    def _dof(self, node: int, direction: str) -> int:
        return len(self.directions) * node + self.directions.index(direction)

    def bending_dofs(self, e: int) -> list[int]:
        """Numbers of w and w' at both nodes of an element."""
        return self._bending_dofs(int(self.grid.cells[e, 0]))

    def _bending_dofs(self, first: int) -> list[int]:
        return [self._dof(n, d) for n in (first, first + 1) for d in ("z", "ry")]


def _trial_and_test(space: Any) -> tuple[Any, Any]:
    return ufl.TrialFunction(space), ufl.TestFunction(space)


def _measure(mesh: Any) -> Any:
    return ufl.Measure("dx", domain=mesh, metadata={"quadrature_degree": 6})
