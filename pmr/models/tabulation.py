"""Quantities of a model's weak form, such as strains, as rows on its coordinates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.fem.compat import MPI, cell_dofs, original_cells, tabulate, tabulation_space, unrolled_cell_dofs

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class CellValues:
    """A vector with v components at q points of each of C cells, linear in a model's coordinates."""

    entries: Array  # (C, q, v, d) on the coordinates of each cell
    coordinates: Indices  # (C, d): their numbers, as `FiniteElementModel.element_coordinates` counts


def cell_values(model: Any, quantity: Callable[[Any], Any], points: Array) -> CellValues:
    """Tabulate a quantity in all cells, in the order of the model's mesh, on each rank for itself.

    Parameters
    ----------
    model : FiniteElementModel
    quantity : callable
        From a function space to a UFL vector, linear in a trial function of it.
    points : (q, d) array
        On the reference cell.
    """
    space = tabulation_space(model.space(model.domain(MPI.COMM_SELF)))
    cells = original_cells(space.mesh)
    dofs = unrolled_cell_dofs(space)
    number = np.empty(dofs.max() + 1, np.int64)
    for ours, theirs in zip(model.element_coordinates(cells), cell_dofs(space), strict=True):
        number[theirs] = ours
    order = np.argsort(cells)
    return CellValues(tabulate(quantity(space), points, space)[order], number[dofs][order])


def as_rows(entries: Array, coordinates: Indices, size: int) -> sp.csr_matrix:
    """Rows (P v, size) from entries (P, v, d) on coordinates (P, d), point by point."""
    columns = np.broadcast_to(coordinates[:, None], entries.shape)
    ends = np.arange(0, entries.size + 1, entries.shape[-1])
    return sp.csr_matrix((entries.ravel(), columns.ravel(), ends), (len(ends) - 1, size))
