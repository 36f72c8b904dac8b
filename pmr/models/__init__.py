"""Structural models, one file each: weak forms, and displacements at places as rows on their coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol, TypeGuard

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.fem.compat import MPI
from pmr.fields.series import Grid
from pmr.fields.stress import ForceRows, StressRows
from pmr.files.rigid import DIRECTIONS, rigid_motions
from pmr.mesh.trace import Strip, Window

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

__all__ = ["DIRECTIONS", "rigid_motions"]


@dataclass(frozen=True)
class Forms:
    """Mass and stiffness as UFL forms of a trial and a test function."""

    mass: Any
    stiffness: Any


class UnitState(Protocol):
    """A state of stress of a body held at its tail, of one of the names `pmr.reduced.matrices.STATES`."""

    @property
    def acceleration(self) -> Array:
        """Acceleration of the frame, (3,) m/s^2."""

    @property
    def stretch(self) -> float:
        """By how much the frame's acceleration along x grows with x, 1/s^2."""

    @property
    def forces(self) -> Sequence[tuple[str, Array]]:
        """Forces (3,) in N on places of the body."""

    def displacement(self, space: Any) -> Any:
        """Displacement of the body under these loads, as a function on its space; collective."""


class StructuralModel(Protocol):
    """Places, motions and forces of a beam, a shell, a solid or given matrices, as the rooms further on need them.

    A model numbers its coordinates by itself, from its mesh alone: rows, loads and results are the same on any number
    of ranks and on every version of dolfinx.  Whoever asks for a place or face that there isn't gets an `InputError`.
    """

    @property
    def size(self) -> int:
        """Number of coordinates n, supports not yet held."""

    @property
    def reference_frequency(self) -> float:
        """Scale of the lowest frequencies in rad/s; eigensolvers shift by it."""

    @property
    def node_stations(self) -> Array | None:
        """Places of a beam's nodes along its axis (N,) m; None of bodies that are no lines."""

    @property
    def directions(self) -> tuple[str, ...]:
        """Directions in which a place can move: some of `DIRECTIONS`, in their order."""

    def displacement(self, *places: str | float) -> sp.csr_matrix:
        """Rows that measure the mean displacement of places, one after the other: of each the first rows of `motion`.

        Points are places here, too.
        """

    def motion(self, place: str | float, about: Array | None = None) -> sp.csr_matrix:
        """Rows (len(directions), n) that measure displacement (m) and rotation (rad) of a place.

        A place is a named group, whose mean counts, or a distance along the body's axis in m.  `about` (3,) m is a
        point that moves with the place, by default its centroid.  The rows also apply a force (N) or moment (N m): a
        load spread over the group in the way that the mean weighs it.

        Raises
        ------
        InputError
            Also if the place is a point or straight line of a body without rotations there.
        """

    def centroid(self, place: str | float) -> Array:
        """Centroid of a place, (3,) m."""

    def strip(self, face: str, window: Window) -> Strip:
        """Points of a flat face, or of the line that stands for it on a beam, where pads may be.

        Raises
        ------
        InputError
            Also if the face is not flat.
        """

    def coordinates_on(self, place: str, directions: Sequence[str]) -> Indices:
        """Numbers of all coordinates along some of the `directions` on a named group."""

    def rigid_motions(self) -> Array:
        """Coordinates (n, k) of the rigid motions, one for each of the `directions`; rotations about the origin."""


class FiniteElementModel(StructuralModel, Protocol):
    """A model that is assembled from forms on a mesh, and looked at there."""

    def domain(self, comm: MPI.Comm) -> Any:
        """The mesh in dolfinx, spread over `comm`; collective."""

    def space(self, domain: Any) -> Any:
        """Function space on `domain`."""

    def forms(self, space: Any) -> Forms:
        """Mass and stiffness."""

    def inertia(self, space: Any, S: Any) -> Any:
        """The form of int rho v . S u dV, with a matrix S (3, 3) in UFL: mass where S is the identity."""

    def geometric_stiffness(self, space: Any, state: UnitState) -> Any:
        """The form of int sigma_jk u_i,j v_i,k dV with the stresses sigma of a state."""

    def element_coordinates(self, cells: Indices) -> list[Indices]:
        """Numbers (c, d), for each scalar component of the space, of its coordinates on the given cells.

        Cells are counted as in the mesh that `domain` was created from.  They are the model's coordinates, or, where
        there is a `transformation`, those that it is applied to.
        """

    @property
    def transformation(self) -> sp.csr_matrix | None:
        """T (n_e, n), where the space's coordinates are T q; None where they are q."""

    @property
    def grid(self) -> Grid:
        """Cells by which the body is drawn; results have the same ones."""

    def point_displacements(self) -> sp.csr_matrix:
        """Rows (3 N, n) that measure the displacement along x, y, z of each of the grid's points."""

    def stresses(self) -> StressRows | None:
        """Stresses of the grid's cells, from the strains of `forms`; None for a beam without a profile."""

    def cut(self, parts: int) -> Cut | None:
        """A beam in so many pieces an element; None of bodies that are no lines."""


class Line(FiniteElementModel, Protocol):
    """A beam."""

    @property
    def node_stations(self) -> Array: ...

    def station(self, place: str | float) -> float:
        """Distance of a place from the beam's first end in m; raises an `InputError` if it is not on the beam."""

    def section_forces(self) -> ForceRows:
        """Section forces at both ends of each element, from its strains: exact where nothing acts between nodes."""

    def end_forces(self) -> sp.csr_matrix:
        """The section forces, in the order of `section_forces`, of forces on coordinates that pull at elements, (P, n).

        On the face that looks along x: what pulls at an element's second end, with the other sign at its first.
        """

    def corner_stresses(self, forces: ForceRows, element: Indices) -> StressRows | None:
        """Stresses in the corners of the profile of section forces, whose places are in these elements (P,).

        Their rows are on what the rows of `forces` are on; None where no profile is known.
        """


@dataclass(frozen=True)
class Cut:
    """A beam that is cut at its nodes and, in equal parts, between them: each piece has its ends for itself.

    Coordinates of the pieces are those of `beam`, whose nodes stand at every inner cut twice.
    """

    beam: Line
    coordinates: sp.csr_matrix  # (c, n): of the pieces, from the whole beam's
    joined: sp.csr_matrix  # (c, m): of the pieces, from those of the cuts between nodes alone
    element: Indices  # (2 p,): the whole beam's, of both ends of each of the pieces


def bilinear(S: Any, v: Sequence[Any], u: Sequence[Any]) -> Any:
    """The product v . S u in UFL, of components some of which are None, as a model does not have them."""
    return sum(S[j, k] * v[j] * u[k] for j in range(3) for k in range(3) if v[j] is not None and u[k] is not None)


def is_assembled(model: StructuralModel) -> TypeGuard[FiniteElementModel]:
    """Whether a model has forms on a mesh; otherwise it was given as matrices."""
    return hasattr(model, "forms")
