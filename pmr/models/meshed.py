"""Common parts of models on a mesh: motions of named groups, materials by region, sides of walls, tabulated quantities.

`Assembler` assembles weak forms to distributed PETSc matrices, in the model's order of coordinates.  A quantity in a
weak form, such as a strain, is tabulated as rows on the model's coordinates.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy.sparse as sp

from pmr.errors import InputError
from pmr.fem.compat import (
    MPI,
    PETSc,
    assemble,
    cell_dofs,
    comm_of,
    compiled_form,
    create_mesh,
    function,
    original_cells,
    tabulate,
    tabulation_space,
    unrolled_cell_dofs,
)
from pmr.fem.distributed import free_objects, local_csr, share, sparse
from pmr.files.arrays import Array, Indices
from pmr.models import DIRECTIONS, FiniteElementModel, StructuralModel, is_assembled, rigid_motions
from pmr.models.mesh_nodes import Nodes, number_nodes
from pmr.models.named_mesh import CELLS_OF_KIND, NamedMesh
from pmr.models.trace import (
    FlatFace,
    Strip,
    Trace,
    Window,
    coordinates_on,
    face_strip,
    flat_face,
    group_trace,
    section_trace,
)
from pmr.results.field_series import Grid
from pmr.scene.structures import Material

if TYPE_CHECKING:
    from pmr.fem.compat import Expr, Function, FunctionSpace, Mesh

#: Faces of a wall on which stresses are evaluated.
FACES = ("outer", "middle", "inner")
#: Smallest cosine at which a normal counts as pointing away from the body's axis, or towards it.
CLEAR = 0.01


class TracedModel(ABC):
    """A body in space that measures the motion of a place by a trace, its displacement at quadrature points."""

    node_stations: None = None
    directions: tuple[str, ...] = DIRECTIONS

    @abstractmethod
    def trace(self, place: str | float) -> Trace:
        """Trace of the displacement on `place`: a named group, or the cross-section at a distance along the axis.

        The distance is in m.
        """

    def displacement(self, *places: str | float) -> sp.csr_matrix:
        """Rows (3 p, n) of the mean displacements of p places along x, y and z."""
        return sp.vstack([self.trace(place).mean for place in places], format="csr")

    def motion(self, place: str | float, about: Array | None = None) -> sp.csr_matrix:
        """Rows (6, n) of a place's displacement and rotation at the point `about` (3,) m, by default its centroid."""
        return self.trace(place).motion(about)

    def centroid(self, place: str | float) -> Array:
        """Centroid of a place, (3,) m."""
        return self.trace(place).centroid


class MeshedModel(TracedModel):
    """A structural model whose coordinates sit on a mesh; its displacement is quadratic."""

    mesh: NamedMesh
    transformation: None = None  # the space's coordinates are the model's

    def cut(self, parts: int) -> None:
        """Return None for any number of `parts`: a body that is no beam is not cut."""

    @property
    @abstractmethod
    def components(self) -> Mapping[int, tuple[int, ...]]:
        """Displacements (0, 1, 2) and rotations (3, 4, 5) of a node, by the dimension of the entity with the node.

        The dimensions 0 to 3 are those of vertices, edges, faces and cells.
        """

    @cached_property
    def nodes(self) -> Nodes:
        """Nodes of the model's function space, with the numbers of their coordinates."""
        return number_nodes(self.mesh.cell, self.mesh.points, self.mesh.cells, self.components)

    @property
    def size(self) -> int:
        """Number of coordinates n."""
        return self.nodes.size

    def domain(self, comm: MPI.Comm) -> Mesh:
        """The mesh in dolfinx, spread over `comm`; collective."""
        return create_mesh(comm, self.mesh.cell, self.mesh.points, self.mesh.cells)

    def element_coordinates(self, cells: Indices) -> list[Indices]:
        """Numbers (c, d) of the d coordinates on each of c cells, one array for each component."""
        tables = []
        for component in sorted({c for carried in self.nodes.components.values() for c in carried}):
            parts = [
                self.nodes.first[dim][self.nodes.in_cell[dim][cells]] + carried.index(component)
                for dim, carried in sorted(self.nodes.components.items())
                if component in carried
            ]
            tables.append(np.concatenate(parts, axis=1))
        return tables

    def trace(self, place: str | float) -> Trace:
        """Trace of the displacement on `place`: a named group, or the cross-section at a distance in m along the axis.

        Traces are cached.  Raises the errors of `group_trace` and `section_trace`.
        """
        if place not in self._traces:
            if isinstance(place, str):
                self._traces[place] = group_trace(self.mesh, self.nodes, place)
            else:
                self._traces[place] = section_trace(self.mesh, self.nodes, place)
        return self._traces[place]

    @cached_property
    def _traces(self) -> dict[str | float, Trace]:
        """Traces by place that have been computed so far; empty at first."""
        return {}

    def strip(self, face: str, window: Window) -> Strip:
        """Quadrature points of a face within a window; raises the errors of `flat_face` and `face_strip`."""
        if face not in self._faces:
            self._faces[face] = flat_face(self.mesh, face)
        return face_strip(self._faces[face], self.nodes, window)

    @cached_property
    def _faces(self) -> dict[str, FlatFace]:
        """Flat faces by name that have been computed so far; empty at first."""
        return {}

    def coordinates_on(self, place: str, directions: Sequence[str]) -> Indices:
        """Numbers (k,) of all coordinates that belong to the group `place` and to one of the given `directions`."""
        return coordinates_on(self.mesh, self.nodes, place, [DIRECTIONS.index(d) for d in directions])

    def rigid_motions(self) -> Array:
        """Coordinates (n, 6) under unit translations along and rotations about x, y and z through the origin."""
        return rigid_motions(self.nodes.points, self.nodes.component)

    @property
    def grid(self) -> Grid:
        """Grid of the mesh's cells, with displacements at vertices alone, though they are quadratic within cells."""
        name, order = next((name, order) for name, (kind, _, order) in CELLS_OF_KIND.items() if kind == self.mesh.cell)
        return Grid(name, self.mesh.points, self.mesh.cells[:, order], self.mesh.regions)

    def point_displacements(self) -> sp.csr_matrix:
        """Rows (3 N, n) that measure the displacements of the mesh's N vertices along x, y and z."""
        points = np.arange(len(self.mesh.points))
        first = self.nodes.first_coordinates(points[:, None], 0, len(points))
        columns = (first[:, None] + np.arange(3)).ravel()
        return sp.csr_matrix((np.ones(len(columns)), columns, np.arange(len(columns) + 1)), (len(columns), self.size))


@dataclass(frozen=True)
class CellProperties:
    """Different materials or thicknesses (`kinds`), and which of them each of C cells of a mesh has."""

    kinds: tuple[object, ...]
    number: Indices  # (C,): each cell's number among the kinds

    def values(self, name: str) -> Array:
        """Attribute `name` (C,) of each cell's material or thickness.

        `name` may be the attribute of an attribute, such as ``material.young``.
        """
        return np.array([attrgetter(name)(kind) for kind in self.kinds])[self.number]


def region_properties(mesh: NamedMesh, default: object, regions: Mapping[str, object]) -> CellProperties:
    """Material or thickness of each cell, by the region of the cell; cells of no region take `default`.

    Raises an `InputError` if the mesh has no group of cells with the name of a region, or two regions share cells.
    """
    owner = np.full(len(mesh.cells), -1)
    for number, name in enumerate(regions):
        if name not in mesh.regions:
            names = ", ".join(sorted(mesh.regions)) or "none"
            raise InputError("scene", f"body.regions.{name}", None, f"{mesh.source} has these regions: {names}")
        cells = mesh.regions[name]
        shared = owner[cells].max(initial=-1)
        if shared >= 0:
            raise InputError("scene", f"body.regions.{name}", None, f"shares cells with {list(regions)[shared]}")
        owner[cells] = number
    return CellProperties((*regions.values(), default), owner)  # number -1 is the last one, the default


def frequency_scale(points: Array, material: Material, thickness: float = 0.0) -> float:
    """Scale sqrt(E / rho) r / L^2 in rad/s of the frequencies of a slender beam.

    E is Young's modulus and rho the density of `material`.  L is the largest extent of `points` (N, 3) m; r is half the
    smallest extent or half of `thickness` (m) if that is larger.
    """
    extent = np.ptp(points, axis=0)
    depth = max(extent.min(), thickness) / 2.0
    return float(np.sqrt(material.young / material.density) * depth / extent.max() ** 2)


def outward_signs(mesh: NamedMesh, places: Array, normals: Array) -> Array:
    """Signs (f,) of the normals at f points: 1 away from the body's axis, -1 towards it, otherwise 0.

    The sign is 0 if a normal is nearly at a right angle to the line from the axis to its point.  `places` (f, 3) m are
    the points and `normals` (f, 3) their unit normals.  The axis is along the mesh's longest extent, in the middle of
    the other extents.
    """
    arm = places - (mesh.points.min(axis=0) + mesh.points.max(axis=0)) / 2.0
    arm[:, mesh.axis] = 0.0
    along = np.sum(arm * normals, axis=1)
    return np.asarray(np.where(np.abs(along) > CLEAR * np.linalg.norm(arm, axis=1), np.sign(along), 0.0))


@dataclass(frozen=True)
class CellValues:
    """A vector with v components at q points of each of C cells, linear in a model's coordinates."""

    entries: Array  # (C, q, v, d): factors of the d coordinates of each cell
    coordinates: Indices  # (C, d): numbers of these coordinates, as `FiniteElementModel.element_coordinates` counts


def cell_values(model: StructuralModel, quantity: Callable[[FunctionSpace], Expr], points: Array) -> CellValues:
    """Tabulate a quantity in all cells of a model's mesh, in the order of the model's cells.

    Each rank that calls this gets the values of the whole mesh; the call is not collective.

    Parameters
    ----------
    model : StructuralModel
        Model that has to be assembled (`is_assembled`).
    quantity : callable
        Returns, for a function space, a UFL vector that is linear in a trial function on this space.
    points : (q, d) array
        Points on the reference cell.
    """
    assert is_assembled(model)
    space = tabulation_space(model.space(model.domain(MPI.COMM_SELF)))
    cells = original_cells(space.mesh)
    dofs = unrolled_cell_dofs(space)
    number = np.empty(dofs.max() + 1, np.int64)
    for ours, theirs in zip(model.element_coordinates(cells), cell_dofs(space), strict=True):
        number[theirs] = ours
    order = np.argsort(cells)
    return CellValues(tabulate(quantity(space), points, space)[order], number[dofs][order])


def coordinate_rows(entries: Array, coordinates: Indices, size: int) -> sp.csr_matrix:
    """Rows (P v, size) on `size` coordinates from entries (P, v, d) at P points; the v rows of a point are neighbours.

    `coordinates` (P, d) are the numbers of the d coordinates to which the entries at each point belong.
    """
    columns = np.broadcast_to(coordinates[:, None], entries.shape)
    ends = np.arange(0, entries.size + 1, entries.shape[-1])
    return sp.csr_matrix((entries.ravel(), columns.ravel(), ends), (len(ends) - 1, size))


#: Exponent by which the weight of a cell in a fit falls with the square of its distance, over the largest distance.
FOCUS = 2.0


class NodeFits(NamedTuple):
    """Matrix from values of C cells to values at the p nodes of all walls, and the nodes at edges of two walls."""

    matrix: sp.csr_matrix  # (p, C)
    on_edge: Array  # (p,): 1 at these nodes, else 0


def node_fits(mesh: NamedMesh) -> NodeFits:
    """Return the matrix that turns values of cells into fitted values at the nodes of each wall, edges included.

    Walls are the mesh's regions.  The rows of the first wall's nodes come first, then those of the second wall, and so
    on.  So a node on an edge between two walls has two rows.  The value at a node is that of a quadratic polynomial in
    the two directions of the wall.  The polynomial is fitted to the values in the middles of the cells around the node:
    those that touch it, and those that share a node with these.  Cells that are farther away have less weight.
    """
    middles = mesh.points[mesh.cells].mean(axis=1)
    fits, walls = list[sp.csr_matrix](), np.zeros(len(mesh.points))
    for of_wall in mesh.regions.values():
        walls[np.unique(mesh.cells[of_wall])] += 1.0
    on_edge = list[Array]()
    for of_wall in mesh.regions.values():
        nodes, corners = np.unique(mesh.cells[of_wall], return_inverse=True)
        numbers = np.arange(len(of_wall)).repeat(mesh.cells.shape[1])
        touching = sp.csr_matrix((np.ones(len(numbers)), (numbers, corners.ravel())))
        around = (touching.T @ touching @ touching.T).tocsr()
        points, counts = mesh.points[nodes], np.diff(around.indptr)
        across = np.linalg.svd(points[:, 1:] - points[:, 1:].mean(axis=0), full_matrices=False)[2][0]
        directions = np.array([[1.0, 0.0, 0.0], [0.0, *across]]).T
        weights = np.zeros(around.nnz)
        for count in np.unique(counts):
            rows = np.flatnonzero(counts == count)
            entries = around.indptr[rows][:, None] + np.arange(count)
            apart = (middles[of_wall[around.indices[entries]]] - points[rows, None]) @ directions
            x, y = np.moveaxis(apart / np.abs(apart).max(axis=1, keepdims=True), -1, 0)
            terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
            weighted = np.exp(-FOCUS * (x * x + y * y))[..., None] * terms
            inverse = np.linalg.pinv(np.swapaxes(terms, 1, 2) @ weighted, hermitian=True)
            weights[entries] = np.einsum("pct,pt->pc", weighted, inverse[:, 0])
        on_edge.append((walls[nodes] > 1.0).astype(float))
        fits.append(sp.csr_matrix((weights, of_wall[around.indices], around.indptr), (len(nodes), len(mesh.cells))))
    return NodeFits(sp.vstack(fits, "csr"), np.concatenate(on_edge))


class Assembler:
    """Assembles weak forms on a model's function space to matrices in the model's order of coordinates."""

    def __init__(self, model: FiniteElementModel, domain: object) -> None:
        """Make the function space of `model` on its mesh `domain`, a dolfinx mesh, and the order of its coordinates.

        Collective.
        """
        self.model, self.comm, self.space = model, comm_of(domain), model.space(domain)
        self._order = model_order(model, self.space)
        self._projection: sp.csr_matrix | None = None  # None: the model's coordinates are those of the space, reordered
        if model.transformation is not None:
            numbers = np.arange(len(self._order))
            ordered = sp.csr_matrix((np.ones(len(numbers)), (self._order, numbers)))
            self._projection = sp.csr_matrix(ordered @ model.transformation)

    def matrix(self, form: object, zeros: bool = True) -> PETSc.Mat:
        """Assemble a UFL form to a matrix (n, n); zeros are stored in its pattern only if `zeros`.  Collective."""
        return self.assemble_form(compiled_form(form), zeros)

    def assemble_form(self, form: object, zeros: bool = True) -> PETSc.Mat:
        """Assemble a compiled form to a matrix (n, n) on the model's coordinates, which the ranks share equally.

        Zeros are stored in the pattern of the matrix only if `zeros`.  Collective.
        """
        A, size = assemble(form), len(self._order) if self._projection is None else self._projection.shape[1]
        low, high = (int(number) for number in share(size, self.comm))
        if self._projection is None:
            change = PETSc.IS().createGeneral(self._order[low:high].astype(PETSc.IntType), comm=A.comm)
            reordered = A.createSubMatrix(change, change)  # a tenth of the time of a product with a permutation
        else:
            change = sparse(self._projection[slice(*A.getOwnershipRange())], A, columns=high - low)
            reordered = A.PtAP(change)
        rows = local_csr(reordered)
        free_objects(change, reordered, A)
        if not zeros:
            rows.eliminate_zeros()
        sizes, csr = (high - low, size), (rows.indptr, rows.indices, rows.data)
        matrix = PETSc.Mat().createAIJ((sizes, sizes), csr=csr, comm=self.comm)  # `reordered` is on dolfinx' copy of it
        matrix.assemble()
        return matrix

    def displacement_function(self, q: Array) -> Function:
        """Function on the function space with the model's coordinates q (n,), the same on every rank; collective.

        Not to be called for a model with a `transformation`, whose coordinates are not those of the function space.
        """
        values = np.empty(len(q))
        values[self._order] = q
        return function(self.space, values)


def model_order(model: FiniteElementModel, space: FunctionSpace) -> Indices:
    """PETSc indices (n,) in the function space of the model's n coordinates; collective, the same on every rank.

    Raises
    ------
    RuntimeError
        If the model's numbering does not cover the coordinates of the function space exactly once.
    """
    ours = model.element_coordinates(original_cells(space.mesh))
    theirs = cell_dofs(space)
    order = np.full(space.dofmap.index_map.size_global * space.dofmap.index_map_bs, -1, np.int64)
    for mine, its in zip(ours, theirs, strict=True):
        order[mine.ravel()] = its.ravel()
    numbered = np.flatnonzero(order >= 0)
    for numbers, places in space.mesh.comm.allgather((numbered, order[numbered])):
        order[numbers] = places
    if not np.array_equal(np.sort(order), np.arange(len(order))):
        raise RuntimeError("the coordinates of the model do not match those of the function space")
    return order
