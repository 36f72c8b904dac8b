"""What shells and solids share: displacements on named groups of a mesh, whatever the cells carry besides."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.fem.compat import MPI
from pmr.fields.grid import Grid
from pmr.mesh.named import KINDS, NamedMesh
from pmr.mesh.nodes import Nodes, number_nodes
from pmr.mesh.strip import Strip, Window, face_strip
from pmr.mesh.trace import Trace, coordinates_on, section, trace
from pmr.models import DIRECTIONS
from pmr.models.regions import rigid_motions

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class MeshedModel(ABC):
    """A structural model whose coordinates sit on a mesh; its displacement is quadratic."""

    mesh: NamedMesh
    transformation: None = None  # the space's coordinates are the model's
    node_stations: None = None

    @property
    @abstractmethod
    def components(self) -> Mapping[int, tuple[int, ...]]:
        """Which displacements (0, 1, 2) and rotations (3, 4, 5) vertices, edges, faces and cells carry."""

    @cached_property
    def nodes(self) -> Nodes:
        return number_nodes(self.mesh.cell, self.mesh.points, self.mesh.cells, self.components)

    @property
    def size(self) -> int:
        return self.nodes.size

    @property
    def directions(self) -> tuple[str, ...]:
        return DIRECTIONS

    def domain(self, comm: MPI.Comm) -> Any:
        return self.mesh.distribute(comm)

    def element_coordinates(self, cells: Indices) -> list[Indices]:
        return self.nodes.per_component(cells)

    def trace(self, place: str | float) -> Trace:
        """Displacements on a named group, or of a cross-section; looked for once."""
        if place not in self._traces:
            if isinstance(place, str):
                self._traces[place] = trace(self.mesh, self.nodes, place, degree=2)
            else:
                self._traces[place] = section(self.mesh, self.nodes, place, degree=2)
        return self._traces[place]

    @cached_property
    def _traces(self) -> dict[str | float, Trace]:
        return {}

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

    @property
    def grid(self) -> Grid:
        """The mesh as it is; displacements within its cells are quadratic, a picture takes their vertices'."""
        name, order = next((name, order) for name, (kind, _, order) in KINDS.items() if kind == self.mesh.cell)
        return Grid(name, self.mesh.points, self.mesh.cells[:, order], self.mesh.regions)

    def point_displacements(self) -> sp.csr_matrix:
        points = np.arange(len(self.mesh.points))
        first = self.nodes.of(points[:, None], 0, len(points))
        columns = (first[:, None] + np.arange(3)).ravel()
        return sp.csr_matrix((np.ones(len(columns)), columns, np.arange(len(columns) + 1)), (len(columns), self.size))
