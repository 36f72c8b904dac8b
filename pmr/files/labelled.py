"""Matrices whose entries name node and direction of their row and column, as Abaqus and Nastran write them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class Entries:
    """Entries `values` (E,) in the rows and columns of nodes and directions (E, 2)."""

    rows: Indices
    columns: Indices
    values: Array

    @property
    def pairs(self) -> Indices:
        """All nodes and directions (n, 2), ascending."""
        return np.unique(np.vstack([self.rows, self.columns]), axis=0)

    def matrix(self, pairs: Indices) -> sp.csr_matrix:
        """A symmetric matrix (n, n) in these nodes and directions, which have those of all entries among them.

        Of two entries that mirror each other one may be left out, whichever it is.
        """
        number = {(int(node), int(direction)): k for k, (node, direction) in enumerate(pairs)}
        rows, columns = ([number[int(n), int(d)] for n, d in part] for part in (self.rows, self.columns))
        A = sp.coo_matrix((self.values, (rows, columns)), shape=(len(pairs), len(pairs))).tocsr()
        there = sp.csr_matrix((np.ones(A.nnz), A.indices, A.indptr), shape=A.shape)
        return sp.csr_matrix(A + A.T - A.T.multiply(there))


def read_entries(path: Path) -> Entries:
    """Lines ``node, direction, node, direction, entry``: what Abaqus writes of ``*MATRIX OUTPUT``.

    Raises ValueError if a line says something else.
    """
    if not path.read_bytes().endswith(b"\n"):
        raise ValueError("a last line that ends: this one is cut off")
    table = np.loadtxt(path, delimiter=",", comments="*", ndmin=2)
    if table.shape[1] != 5:
        raise ValueError(f"lines of node, direction, node, direction and entry, not of {table.shape[1]} numbers")
    labels = table[:, :4].astype(np.int64)
    if not np.array_equal(labels, table[:, :4]):
        raise ValueError("whole numbers of nodes and directions")
    return Entries(labels[:, :2], labels[:, 2:], table[:, 4])
