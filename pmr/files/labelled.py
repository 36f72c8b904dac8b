"""Matrices whose entries state node and direction of their row and column, as Abaqus and Nastran write them.

pyNastran reads the files of Nastran: matrices (DMIG entries, OUTPUT4) and grid points of bulk data.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.errors.environment import import_package

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
SQUARE, SYMMETRIC = 1, 6


@dataclass(frozen=True)
class Entries:
    """E entries `values` (E,) of a matrix; `rows` (E, 2) and `columns` (E, 2) are node and direction of each entry."""

    rows: Indices
    columns: Indices
    values: Array

    @property
    def pairs(self) -> Indices:
        """All different pairs (n, 2) of node and direction in rows and columns, in ascending order."""
        return np.unique(np.vstack([self.rows, self.columns]), axis=0)

    def matrix(self, pairs: Indices) -> sp.csr_matrix:
        """Return the symmetric matrix (n, n) on the coordinates `pairs` (n, 2).

        `pairs` have to include the coordinates of all entries.  Of two entries that mirror each other, the file may
        have both or only one.
        """
        number = {(int(node), int(direction)): k for k, (node, direction) in enumerate(pairs)}
        rows, columns = ([number[int(n), int(d)] for n, d in part] for part in (self.rows, self.columns))
        A = sp.coo_matrix((self.values, (rows, columns)), shape=(len(pairs), len(pairs))).tocsr()
        pattern = sp.csr_matrix((np.ones(A.nnz), A.indices, A.indptr), shape=A.shape)
        return sp.csr_matrix(A + A.T - A.T.multiply(pattern))


class UnreadableError(ValueError):
    """A file does not have the form `allowed`; `line` is the line that differs, or 0 for the whole file."""

    def __init__(self, allowed: str, line: int = 0) -> None:
        super().__init__(allowed)
        self.line = line  # from 1; 0 for the whole file


def read_entries(path: Path) -> Entries:
    """Read the entries of a matrix from lines ``node, direction, node, direction, entry``.

    Abaqus writes this form by ``*MATRIX OUTPUT``.  Raises UnreadableError for lines of another form.
    """
    form = "node, direction, node, direction and entry"
    columns = read_number_table(path, (int, int, int, int, float), form, delimiter=",", comment="*")
    labels = columns[:, :4].astype(np.int64)
    return Entries(labels[:, :2], labels[:, 2:], columns[:, 4])


def read_number_table(
    path: Path, kinds: Sequence[type], form: str, delimiter: str | None = None, comment: str = "#", head: int = 0
) -> Array:
    """Return the numbers (e, c) in the e lines after the first `head` ones.

    Each line has c numbers of the given `kinds`, and `form` describes a line in messages.  Raises UnreadableError with
    the number of the first line of another form, or if the file is cut off.
    """
    content = path.read_bytes()
    if not content.endswith(b"\n"):
        raise UnreadableError("a last line that ends is allowed: this file is cut off")
    try:
        data = np.loadtxt(path, delimiter=delimiter, comments=comment, skiprows=head, ndmin=2)
        ints = [k for k, kind in enumerate(kinds) if kind is int]
        if data.shape[1] == len(kinds) and np.all(data[:, ints] == np.trunc(data[:, ints])) and data.size:
            return data
    except (ValueError, UserWarning):
        pass
    for number, line in enumerate(content.decode("utf-8", "replace").splitlines()[head:], head + 1):
        text = line.partition(comment)[0].strip()
        if text and not _is_row(text.split(delimiter), kinds):
            raise UnreadableError(f"{form} are allowed, not {text[:40]!r}", number)
    raise UnreadableError(f"lines of {form} are allowed")


def _is_row(parts: Sequence[str], kinds: Sequence[type]) -> bool:
    """Whether the texts `parts` are as many numbers of the given `kinds`.

    For the kind int a whole number is needed, for float any number.
    """
    if len(parts) != len(kinds):
        return False
    try:
        return all(
            kind is float or float(part) == int(float(part)) for kind, part in zip(kinds, parts, strict=True)
        ) and all(np.isfinite(float(part)) or kind is float for kind, part in zip(kinds, parts, strict=True))
    except (ValueError, OverflowError):
        return False


@dataclass(frozen=True)
class Bulk:
    """Content of a bulk data file of Nastran."""

    matrices: dict[str, sp.csr_matrix]  #: Real DMIG matrices by name, square or symmetric
    pairs: Indices  #: (n, 2) array: grid point and component (1 to 6) of each of the n rows, ascending
    numbers: Indices  #: (N,) array: numbers of the grid points
    points: Array  #: (N, 3) array, m: positions of the grid points
    groups: dict[str, Indices]  #: Grid points of each SET1 entry, by names such as ``set7``


#: Cards of a file that pyNastran reads.  This module reads sets itself, as pyNastran expands their ranges to lists of
#: all numbers, even of points that do not exist.
CARDS = frozenset(("GRID", "DMIG", "INCLUDE", "ENDDATA"))


def read_bulk(path: Path) -> Bulk:
    """Read the matrices, grid points and sets of a bulk data file of Nastran.

    Raises InputError if pyNastran is missing.  Raises UnreadableError if the file can't be read, or if it has complex
    matrices or grid points with their own axes.
    """
    deck = import_package("pyNastran.bdf.bdf").BDF(debug=None)
    deck.disable_cards(deck.cards_to_read - CARDS)
    text = path.read_text(encoding="utf-8", errors="replace").splitlines()
    try:
        with redirect_stdout(StringIO()):
            deck.read_bdf(str(path), xref=False, punch=True)
    except (Exception, SystemExit):  # pyNastran raises many kinds of errors, and prints the reasons
        raise UnreadableError("bulk data of GRID, SET1 and DMIG entries are allowed") from None
    entries = dict[str, Entries]()
    for name, card in deck.dmig.items():
        line = next((k for k, row in enumerate(text, 1) if row.upper().startswith("DMIG") and name in row.upper()), 0)
        if card.is_complex:
            raise UnreadableError(f"real entries are allowed: those of {name} have imaginary parts", line)
        if card.matrix_form in (SQUARE, SYMMETRIC):
            values = np.asarray(card.Real, float)
            entries[name] = Entries(np.asarray(card.GCi, np.int64), np.asarray(card.GCj, np.int64), values)
    pairs = np.unique(np.vstack([np.empty((0, 2), np.int64), *(matrix.pairs for matrix in entries.values())]), axis=0)
    grids = sorted(deck.nodes)
    for grid in grids:
        for what, axes in (("places", deck.nodes[grid].Cp()), ("displacements", deck.nodes[grid].Cd())):
            if axes != 0:
                pattern = re.compile(rf"GRID\*?[\s,]+{grid}\b", re.IGNORECASE)
                line = next((k for k, row in enumerate(text, 1) if pattern.match(row)), 0)
                allowed = f"{what} along the basic axes are allowed: grid point {grid} has them in system {axes}"
                raise UnreadableError(allowed, line)
    return Bulk(
        {name: matrix.matrix(pairs) for name, matrix in entries.items()},
        pairs,
        np.array(grids, dtype=np.int64),
        np.array([deck.nodes[grid].xyz for grid in grids], dtype=float).reshape(-1, 3),
        _group_sets(text, np.array(grids, dtype=np.int64)),
    )


def _group_sets(text: Sequence[str], grids: Indices) -> dict[str, Indices]:
    """Return the members of each SET1 entry by name, such as ``set7``.

    A range contains all of its numbers that are in `grids`.
    """
    sets = dict[str, Indices]()
    for line, fields in _set_entries(text):
        number, *parts = [field for field in fields if field] or [""]
        members = list[Indices]()
        try:
            while parts:
                first = int(parts.pop(0))
                if parts and parts[0].upper() == "THRU":
                    last = int(parts[1])
                    parts = parts[2:]
                    members.append(grids[(grids >= first) & (grids <= last)])
                else:
                    members.append(np.array([first]))
            sets[f"set{int(number)}"] = np.unique(np.concatenate(members))
        except (ValueError, IndexError, OverflowError):
            raise UnreadableError("SET1 with numbers of grid points, and first THRU last, is allowed", line) from None
    return sets


def _set_entries(text: Sequence[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of the first line and the fields of each SET1 entry.

    Continuation lines of an entry begin with a blank, plus, star or comma.
    """
    begun, fields = 0, list[str]()
    for number, line in enumerate(text, 1):
        line = line.partition("$")[0].rstrip().expandtabs(8)
        if not line:
            continue
        starts = re.match(r"SET1\b", line, re.IGNORECASE) is not None
        if begun and (starts or line[0] not in " +*,"):
            yield begun, fields
            begun = 0
        if starts:
            begun, fields = number, []
        if begun:
            width = 16 if "*" in line[:8] else 8
            parts = line.split(",")[1:9] if "," in line else [line[k : k + width] for k in range(8, 72, width)]
            fields += [part.strip() for part in parts]
    if begun:
        yield begun, fields


def read_output4(path: Path) -> dict[str, sp.csr_matrix]:
    """Read the matrices of an OUTPUT4 file, by name; raises the errors of `read_bulk`."""
    read = import_package("pyNastran.op4.op4").read_op4
    try:
        with redirect_stdout(StringIO()):  # pyNastran prints what it can't read
            return {name.strip(): sp.csr_matrix(matrix.data) for name, matrix in read(str(path), debug=None).items()}
    except Exception:  # the file is cut off or of another form
        raise UnreadableError(
            "OUTPUT4 in binary form, or as text with short integers and exponents E, is allowed"
        ) from None


def only_matrix(matrices: dict[str, sp.csr_matrix], letter: str) -> sp.csr_matrix:
    """Return the only matrix, or else the only one whose name begins with `letter`.

    Raises UnreadableError if no name or several names begin with `letter`.
    """
    candidates = [matrix for name, matrix in matrices.items() if len(matrices) == 1 or name.upper().startswith(letter)]
    if len(candidates) != 1:
        raise UnreadableError(
            f"one square matrix whose name begins with {letter} is allowed, not {', '.join(matrices) or 'none'}"
        )
    return candidates[0]
