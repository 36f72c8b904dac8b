r"""Rows whose path is a few carriers: C(s) = c(s) U, with U (K, n) fixed and c(s) a sparse piecewise polynomial.

A pad that slides over a mesh touches thousands of coordinates, but only through K weighted means.  What a full model
has to know of its path, its compliance U R U^T say, is then K static solves, however fine the mesh is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.constraints.rows import Row

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class RowOnCarriers(Row):
    """A row as any other one, that knows its carriers.

    Attributes
    ----------
    path : Row
        c(s): its `dofs` are numbers of carriers.
    carriers : (K, n) sparse matrix
        U.
    """

    path: Row = field(kw_only=True)
    carriers: sp.csr_matrix = field(kw_only=True)

    def refined(self, breaks: Array) -> Row:
        """The same row on finer breaks, as `Row.refined`."""
        return on_carriers(self.path.refined(breaks), self.carriers)


def on_carriers(path: Row, carriers: sp.csr_matrix) -> RowOnCarriers:
    """C(s) = c(s) U as a row on the coordinates; it has the name, breaks, compliance and clearance of c(s)."""
    U = sp.csr_matrix(carriers)
    used = np.unique(U[np.unique(path.dofs)].indices).astype(np.int64)
    U_used = U[:, used].toarray()
    entries = np.einsum("pkd,kdu->pku", path.coefficients, U_used[path.dofs])
    touched = np.any(U_used[path.dofs] != 0.0, axis=1)
    width = int(touched.sum(axis=1).max())
    # Intervals that touch fewer coordinates are filled with others, all different, and entries of zero.
    chosen = np.sort(np.argsort(~touched, axis=1, kind="stable")[:, :width], axis=1)
    return RowOnCarriers(
        path.name,
        path.breaks,
        used[chosen],
        np.take_along_axis(entries, chosen[None], axis=2),
        path.compliance,
        path.clearance,
        path=path,
        carriers=U,
    )


@dataclass(frozen=True)
class Path:
    """What rows touch: loads on it, and the rows over these loads.

    Attributes
    ----------
    loads : (n, P) sparse matrix
        Carriers, and unit loads on the coordinates that rows without carriers touch.
    rows : tuple of Row
        Each row over the P loads: C(s) = rows(s) loads^T.
    """

    loads: sp.csr_matrix
    rows: tuple[Row, ...]

    @property
    def size(self) -> int:
        """Number of loads P."""
        return int(self.loads.shape[1])


def path_of(rows: Sequence[Row], size: int) -> Path:
    """The path of rows on `size` coordinates."""
    plain = [row for row in rows if not isinstance(row, RowOnCarriers)]
    touched = np.unique(np.concatenate([np.empty(0, np.int64), *(row.dofs.ravel() for row in plain)]))
    count = len(touched)
    blocks = [sp.csr_matrix((np.ones(count), (touched, np.arange(count))), shape=(size, count))]
    on_path = []
    for row in rows:
        if isinstance(row, RowOnCarriers):
            on_path.append(replace(row.path, dofs=row.path.dofs + count))
            blocks.append(row.carriers.T)
            count += row.carriers.shape[0]
        else:
            on_path.append(replace(row, dofs=np.searchsorted(touched, row.dofs)))
    return Path(sp.hstack(blocks, format="csr"), tuple(on_path))
