"""Meshes, and structural models, one file each: weak forms, and rows that measure displacements of places.

A row is a vector (1, n) of weights of the model's n coordinates; its product with the coordinates is the measure.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeGuard

import scipy.sparse as sp

from pmr.fem.compat import MPI
from pmr.files.arrays import Array, Indices
from pmr.files.rigid import DIRECTIONS, rigid_motions
from pmr.models.trace import Strip, Window
from pmr.results.field_series import Grid
from pmr.results.field_stress import StressRows

if TYPE_CHECKING:
    from pmr.fem.compat import Expr, Form, Function, FunctionSpace, Mesh
    from pmr.models.beam import Beam


__all__ = ["DIRECTIONS", "rigid_motions"]


@dataclass(frozen=True)
class Forms:
    """Mass and stiffness as UFL forms of a trial function and a test function."""

    mass: Form
    stiffness: Form


@dataclass(frozen=True)
class UnitState:
    """A state of stress of a body that is held at its tail, by an acceleration or a force of unit size.

    The states are those of `pmr.system.body_matrices.STATES`.
    """

    acceleration: Array  # (3,) m/s^2, of the frame in which the body rests
    stretch: float  # 1/s^2: increase of the frame's acceleration along x per metre along x
    forces: Sequence[tuple[str | float, Array]]  # pairs of a place on the body and the force (3,) in N that acts there
    solve: Callable[[UnitState], Function]  # returns the displacement under the loads of a state; collective

    def displacement(self) -> Function:
        """Displacement under the loads of this state, a new function on the model's function space; collective."""
        return self.solve(self)


class StructuralModel(Protocol):
    """Coordinates of a beam, shell, solid or given matrices, and rows that measure motions of places on them.

    A model numbers its n coordinates from its mesh alone: rows, loads and results are the same on any number of ranks
    and on every version of dolfinx.  Methods raise an `InputError` for a place or face that the model does not have.
    """

    @property
    def size(self) -> int:
        """Number n of coordinates, with those that supports will hold."""

    @property
    def reference_frequency(self) -> float:
        """Scale of the lowest circular frequencies in rad/s; eigensolvers shift by its square."""

    @property
    def node_stations(self) -> Array | None:
        """Coordinates (N,) in m of a beam's nodes along its axis, or of both ends of a mover; None for other bodies."""

    @property
    def directions(self) -> tuple[str, ...]:
        """Directions along or about which a place can move: some of `DIRECTIONS`, in their order."""

    def displacement(self, *places: str | float) -> sp.csr_matrix:
        """Matrix (p t, n) from coordinates to the mean displacements of p `places` along x, y and z.

        A model that has only t of these three directions has rows for these alone.  The t rows of the first place come
        first.  Unlike in `motion`, a place may be a single point.
        """

    def motion(self, place: str | float, about: Array | None = None) -> sp.csr_matrix:
        """Rows (len(directions), n) that measure displacement (m) and rotation (rad) of a place.

        A place is a named group, whose mean motion is measured, or a distance along the body's axis in m.  `about` (3,)
        m is a point that moves with the place, by default the place's centroid.  The transpose of the rows applies a
        force (N) or moment (N m), spread over the group with the weights of the mean.

        Raises
        ------
        InputError
            If the place does not exist, or is a point or straight line of a body that has no rotations there.
        """

    def centroid(self, place: str | float) -> Array:
        """Centroid of a place, (3,) m."""

    def strip(self, face: str, window: Window) -> Strip:
        """Points for the integrals of pads, within `window`, on a flat face.  A beam has points on a line instead.

        Raises
        ------
        InputError
            If the face does not exist or is not flat.
        """

    def coordinates_on(self, place: str, directions: Sequence[str]) -> Indices:
        """Ascending numbers (k,) of the coordinates of the group `place` along or about one of the `directions`."""

    def rigid_motions(self) -> Array:
        """Coordinates (n, k) under unit rigid motions along and about the model's k `directions`.

        Rotations are about the origin.
        """


class FiniteElementModel(StructuralModel, Protocol):
    """A structural model that is assembled from weak forms on a mesh, with cells to draw and stresses in the cells."""

    def domain(self, comm: MPI.Comm) -> Mesh:
        """The dolfinx mesh of the model, spread over `comm`; collective."""

    def space(self, domain: Mesh) -> FunctionSpace:
        """Function space of the model on `domain`, the dolfinx mesh; collective."""

    def forms(self, space: FunctionSpace) -> Forms:
        """Mass and stiffness as UFL forms on `space`."""

    def inertia(self, space: FunctionSpace, S: Expr) -> Form:
        """UFL form of the integral of rho v . S u over the volume, for trial and test displacements u and v.

        `S` is a tensor (3, 3) in UFL, and rho is the density.  If S is the identity, the form is the mass.
        """

    def geometric_stiffness(self, space: FunctionSpace, state: UnitState) -> Form:
        """UFL form of the integral of sigma_jk u_i,j v_i,k over the volume, for trial and test displacements u and v.

        sigma are the stresses of the unit state; u_i,j is the derivative of component i of u along j.
        """

    def element_coordinates(self, cells: Indices) -> list[Indices]:
        """Numbers (c, d) of the d coordinates on each of c cells, one array per scalar component of the function space.

        `cells` (c,) are numbers of cells in the mesh from which `domain` was created.  If the model has a
        `transformation`, the coordinates are those of the function space, otherwise those of the model.
        """

    @property
    def transformation(self) -> sp.csr_matrix | None:
        """Matrix T (n_e, n) that gives the n_e coordinates T q of the function space from the model's n coordinates q.

        None is returned if both have the same coordinates.
        """

    @property
    def grid(self) -> Grid:
        """Grid of cells by which the body is drawn, and to which results refer."""

    def point_displacements(self) -> sp.csr_matrix:
        """Rows (3 N, n) that measure the displacements along x, y and z of each of the N points of `grid`."""

    def stresses(self) -> StressRows | None:
        """Stress rows for the cells of `grid`, from the strains in `forms`; None for a beam without a profile."""

    def cut(self, parts: int) -> Cut | None:
        """Beam of this model, cut into `parts` pieces per element; None for a body that is no beam."""


@dataclass(frozen=True)
class Cut:
    """A beam that is cut into p pieces, at its nodes and at equal distances between them.

    Each piece has coordinates of its own at both ends, c coordinates in all.  `beam` has two nodes at each inner cut.
    """

    beam: Beam
    coordinates: sp.csr_matrix  # (c, n): gives the coordinates of the pieces from those of the whole beam
    joined: sp.csr_matrix  # (c, m): gives them from the m coordinates at the cuts between nodes
    element: Indices  # (2 p,): number of the whole beam's element at both ends of each piece


def ufl_product(S: Expr, v: Sequence[Expr | None], u: Sequence[Expr | None]) -> Expr:
    """Product v . S u in UFL for S (3, 3); components of v or u that are None count as zero."""
    return sum(S[j, k] * v[j] * u[k] for j in range(3) for k in range(3) if v[j] is not None and u[k] is not None)


def is_assembled(model: StructuralModel) -> TypeGuard[FiniteElementModel]:
    """Whether a model has weak forms on a mesh.  Given matrices and movers have none."""
    return hasattr(model, "forms")


def is_beam(model: StructuralModel) -> TypeGuard[Beam]:
    """Whether a model is a beam, with section forces along its axis."""
    return hasattr(model, "section_forces")
