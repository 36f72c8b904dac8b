"""Matrices whose entries name node and direction of their row and column, as Abaqus and Nastran write them.

Files of Nastran are read by pyNastran: matrices (DMIG entries, OUTPUT4), grid points and sets of bulk data.
"""

from __future__ import annotations

import struct
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.errors.environment import needed

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
SQUARE, SYMMETRIC = 1, 6


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
    """Lines ``node, direction, node, direction, entry``: Abaqus's ``*MATRIX OUTPUT``; raises ValueError at others."""
    found = table(path, 5, "node, direction, node, direction and entry", delimiter=",", comments="*")
    labels = found[:, :4].astype(np.int64)
    if not np.array_equal(labels, found[:, :4]):
        raise ValueError("whole numbers of nodes and directions")
    return Entries(labels[:, :2], labels[:, 2:], found[:, 4])


def table(path: Path, columns: int, said: str, **read_as: Any) -> Array:
    """Numbers in so many columns; raises ValueError if there are others, or the file is cut off."""
    if not path.read_bytes().endswith(b"\n"):
        raise ValueError("a last line that ends: this one is cut off")
    found = np.loadtxt(path, ndmin=2, **read_as)
    if found.shape[1] != columns:
        raise ValueError(f"lines of {said}, not of {found.shape[1]} numbers")
    return found


@dataclass(frozen=True)
class Bulk:
    """What a bulk data file holds."""

    matrices: dict[str, sp.csr_matrix]  #: Symmetric DMIG matrices by name
    pairs: Indices  #: (n, 2) array: grid point and component (1 to 6) of each row, ascending
    numbers: Indices  #: (N,) array: grid points
    points: Array  #: (N, 3) array, m
    groups: dict[str, Indices]  #: Grid points of each SET1 entry, as ``set7``


def read_bulk(path: Path) -> Bulk:
    """What a bulk data file holds; raises InputError if pyNastran is missing, ValueError if the file is not read."""
    deck = needed("pyNastran.bdf.bdf").BDF(debug=None)
    try:
        with redirect_stdout(StringIO()):
            deck.read_bdf(str(path), xref=False, punch=True)
    except (RuntimeError, SyntaxError, AttributeError, AssertionError, SystemExit) as error:  # the first: its own
        raise ValueError(_first_line(error)) from None
    square = {name: card for name, card in deck.dmig.items() if card.matrix_form in (SQUARE, SYMMETRIC)}
    entries = {
        name: Entries(np.asarray(card.GCi, np.int64), np.asarray(card.GCj, np.int64), np.asarray(card.Real, float))
        for name, card in square.items()
    }
    pairs = np.unique(np.vstack([np.empty((0, 2), np.int64), *(one.pairs for one in entries.values())]), axis=0)
    grids = sorted(deck.nodes)
    if any(deck.nodes[grid].Cp() != 0 for grid in grids):
        raise ValueError("grid points in the basic coordinate system are allowed")
    return Bulk(
        {name: one.matrix(pairs) for name, one in entries.items()},
        pairs,
        np.array(grids, dtype=np.int64),
        np.array([deck.nodes[grid].xyz for grid in grids], dtype=float).reshape(-1, 3),
        {f"set{number}": np.array(sorted(one.ids), dtype=np.int64) for number, one in deck.sets.items()},
    )


def read_output4(path: Path) -> dict[str, sp.csr_matrix]:
    """Matrices of an OUTPUT4 file by name; raises as `read_bulk`."""
    read = needed("pyNastran.op4.op4").read_op4
    try:
        with redirect_stdout(StringIO()):  # it prints what it can't read
            return {name.strip(): sp.csr_matrix(one.data) for name, one in read(str(path), debug=None).items()}
    except (RuntimeError, AssertionError, AttributeError, struct.error) as error:  # of files that are cut off
        raise ValueError(_first_line(error)) from None


def _first_line(error: BaseException) -> str:
    """The first line of what pyNastran says."""
    return str(error).splitlines()[0] if str(error) else type(error).__name__


def named(matrices: dict[str, sp.csr_matrix], letter: str) -> sp.csr_matrix:
    """The only matrix, or the only one whose name begins with a letter; raises ValueError if none or several are."""
    found = [one for name, one in matrices.items() if len(matrices) == 1 or name.upper().startswith(letter)]
    if len(found) != 1:
        raise ValueError(f"one matrix whose name begins with {letter}, not {', '.join(matrices) or 'none'}")
    return found[0]
