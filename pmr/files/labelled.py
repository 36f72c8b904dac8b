"""Matrices whose entries state node and direction of their row and column, as Abaqus and Nastran write them.

pyNastran reads the files of Nastran: matrices (DMIG entries, OUTPUT4) and grid points of bulk data.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from functools import lru_cache
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import scipy.sparse as sp

from pmr.errors.environment import import_package
from pmr.files.arrays import Array, Indices

logger = logging.getLogger(__name__)

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
    #: (n, 2) array: grid point and component (1 to 6; 0 of scalar points) of each of the n rows, ascending; without
    #: matrices those of EXTRN in its order
    pairs: Indices
    numbers: Indices  #: (N,) array: numbers of the grid points
    points: Array  #: (N, 3) array, m: positions of the grid points
    groups: dict[str, Indices]  #: Grid points of each SET1 entry, by names such as ``set7``
    axes: dict[int, Array]  #: (3, 3) arrays: axes of displacements as rows, by grid point where they are its own
    constraints: list[tuple[int, str]]  #: Line and name of each entry that ties displacements to others
    dependent: dict[int, set[tuple[int, int]]]  #: Grid point and component that depend on others, by an entry's line


#: Cards of a file that pyNastran reads.  This module reads sets itself, as pyNastran expands their ranges to lists of
#: all numbers, even of points that do not exist.
CARDS = frozenset(
    ("GRID", "SPOINT", "DMIG", "INCLUDE", "ENDDATA", *(f"CORD{number}{kind}" for number in (1, 2) for kind in "RCS"))
)


#: Sine of the angle from the polar axis up to which a grid point is at a pole.
POLE = 1e-9
#: Entries that tie displacements of grid points to those of others.
TIES = re.compile(r"(MPC|RBAR1?|RBE[123]|RROD|RSPLINE|RTRPLT1?)\b", re.IGNORECASE)
#: Number and name of a SET1 of grid points in a comment of HyperMesh, and of ANSA.
NAMED = re.compile(r"\$(?:HMSET\s+(\d+)\s+1\s+\"([^\"]+)\"|ANSA_NAME_COMMENT;(\d+);SET;([^;]+);)")
BEGIN = re.compile(r"\s*BEGIN\s+(BULK|SUPER)\b", re.IGNORECASE)


def read_bulk(path: Path) -> Bulk:
    """Read the matrices, grid points and sets of a file of Nastran: its bulk data alone, or a deck with BEGIN BULK.

    The bulk data may be those of one superelement (BEGIN SUPER), as EXTSEOUT writes them.  Raises InputError if
    pyNastran is missing.  Raises UnreadableError if the file can't be read, or if it has complex matrices, several
    parts or displacements at a pole of their spherical axes.
    """
    state = path.stat()
    return _read_bulk(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=2)  # a deck has matrices, rows and nodes, and is read for each
def _read_bulk(path: Path, changed: int, size: int) -> Bulk:
    """Return the content of a file that was `changed` (ns) and has this `size`, as `read_bulk` says."""
    deck = import_package("pyNastran.bdf.bdf").BDF(debug=None)
    deck.disable_cards(deck.cards_to_read - CARDS)
    text = path.read_text(encoding="utf-8", errors="replace").splitlines()
    parts = [(k, begun[1].upper()) for k, line in enumerate(text, 1) if (begun := BEGIN.match(line))]
    if len(parts) > 1:
        raise UnreadableError("the bulk data of one part are allowed: a second one begins here", parts[1][0])
    is_super = bool(parts) and parts[0][1] == "SUPER"
    try:
        with redirect_stdout(StringIO()), TemporaryDirectory() as folder:
            if is_super:  # pyNastran reads superelements only beside a residual structure
                path = Path(folder, path.name)
                path.write_text("\n".join(text[parts[0][0] :]), encoding="utf-8")
            deck.read_bdf(str(path), xref=False, punch=is_super or not parts)
            deck.cross_reference()
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
    if not entries:
        pairs = _external_pairs(text)
    grids = sorted(deck.nodes)
    axes = dict[int, Array]()
    for grid in grids:
        if deck.nodes[grid].Cd() != 0:
            system, place = deck.nodes[grid].cd_ref, deck.nodes[grid].get_position()
            axes[grid] = _displacement_axes(system.type[-1], system.beta(), system.transform_node_to_local(place))
            if not np.isfinite(axes[grid]).all():
                pattern = re.compile(rf"GRID\*?[\s,]+{grid}\b", re.IGNORECASE)
                line = next((k for k, row in enumerate(text, 1) if pattern.match(row)), 0)
                allowed = "displacements along spherical axes are allowed away from their poles"
                raise UnreadableError(f"{allowed}: grid point {grid} is at one", line)
    ties = [(k, tie[1].upper()) for k, line in enumerate(text, 1) if (tie := TIES.match(line))]
    return Bulk(
        {name: matrix.matrix(pairs) for name, matrix in entries.items()},
        pairs,
        np.array(grids, dtype=np.int64),
        np.array([deck.nodes[grid].get_position() for grid in grids], dtype=float).reshape(-1, 3),
        _group_sets(text, np.array(grids, dtype=np.int64)),
        axes,
        ties,
        {k: _dependent(name, fields) for name in {*dict(ties).values()} for k, fields in _entries(text, name)},
    )


def _displacement_axes(kind: str, beta: Array, place: Array) -> Array:
    """Return the axes (3, 3) of a grid point's displacements, as rows; NaN at a pole of spherical ones.

    `kind` is that of their system, R, C or S, `beta` (3, 3) its axes as rows, and `place` (3,) that of the grid point
    in the system, with angles in degrees: from x of a cylindrical system, from z and from x of a spherical one.
    """
    turned, sine = np.eye(3), 1.0
    if kind != "R":
        angle = np.deg2rad(place[1 if kind == "C" else 2])
        c, s = np.cos(angle), np.sin(angle)
        turned = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    if kind == "S":
        cosine, sine = np.cos(np.deg2rad(place[1])), np.sin(np.deg2rad(place[1]))
        turned = np.array([[sine, 0.0, cosine], [cosine, 0.0, -sine], [0.0, 1.0, 0.0]]) @ turned
    return np.asarray(turned @ beta if sine > POLE else np.full((3, 3), np.nan))


def _group_sets(text: Sequence[str], grids: Indices) -> dict[str, Indices]:
    """Return the members of each SET1 entry in the lines `text` by name, such as ``set7``.

    A range contains all of its numbers that are in `grids`.  Raises UnreadableError for an entry of another form.
    """
    sets = dict[str, Indices]()
    for line, fields in _entries(text, "SET1"):
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
    for named in map(NAMED.match, text):
        if named and (key := f"set{int(named[1] or named[3])}") in sets:
            sets.setdefault((named[2] or named[4]).strip().lower(), sets[key])
    return sets


def _dependent(name: str, fields: Sequence[str]) -> set[tuple[int, int]]:
    """Return grid point and component of the displacements that the rigid element `name` makes depend on others.

    `fields` are those behind its name.  The result is empty for entries that are not of the plain forms of RBE2 (one
    independent point), RBE3 (without UM), RBAR (its first point independent in all components) and MPC.
    """
    _, first, second, third, *further = [*fields, *[""] * 7]
    points, components = list[str](), ""
    if name == "MPC":
        components, points = second, [first]
    elif name == "RBE2":
        components, points = second, [field for field in (third, *further) if field and "." not in field]
    elif name == "RBE3" and "UM" not in fields:
        components, points = third, [second]
    elif name == "RBAR" and (third, further[0], further[1]) == ("123456", "", ""):
        components, points = further[2] or third, [second]
    if not all(field.isdigit() for field in (components, *points)):
        return set()
    return {(int(point), int(component)) for point in points for component in components}


def _external_pairs(text: Sequence[str]) -> Indices:
    """Return grid point and component (n, 2) of the rows of a superelement's matrices, as EXTRN lists them in `text`.

    Raises UnreadableError for an entry of another form.
    """
    pairs = list[tuple[int, int]]()
    for line, fields in _entries(text, "EXTRN"):
        named = [field for field in fields if field]
        try:
            for node, components in zip(named[::2], named[1::2], strict=True):
                pairs += [(int(node), int(component)) for component in components]
        except ValueError:
            raise UnreadableError("EXTRN with pairs of grid point and components is allowed", line) from None
    return np.array(pairs, np.int64).reshape(-1, 2)


def _entries(text: Sequence[str], name: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of the first line and the fields of each entry of a `name` in the lines `text`.

    Continuation lines of an entry begin with a blank, plus, star or comma.
    """
    begun, fields = 0, list[str]()
    for number, line in enumerate(text, 1):
        line = line.partition("$")[0].rstrip().expandtabs(8)
        if not line:
            continue
        starts = re.match(rf"{name}\b", line, re.IGNORECASE) is not None
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
    """Read the matrices of an OUTPUT4 file, by name: a text, or a binary file by pyNastran.

    Raises InputError if pyNastran is missing, and UnreadableError if the file can't be read.
    """
    content = path.read_bytes()
    if re.match(rb"[ \d-]{32}", content):
        return _read_text4(content.decode("utf-8", "replace").splitlines())
    read = import_package("pyNastran.op4.op4").read_op4
    try:
        with redirect_stdout(StringIO()):  # pyNastran prints what it can't read
            return {name.strip(): sp.csr_matrix(matrix.data) for name, matrix in read(str(path), debug=None).items()}
    except Exception:  # the file is cut off or of another form
        raise UnreadableError("OUTPUT4 in binary form or as text is allowed") from None


#: Words of a number by the type of a matrix, real in single and double precision.
WORDS = {1: 1, 2: 2}


def _read_text4(lines: Sequence[str]) -> dict[str, sp.csr_matrix]:
    """Read the matrices of an OUTPUT4 text, by name; integers have 8 or 16 digits, numbers the width of the header.

    A column lists its numbers from one row on, or, where that row is 0, strings of numbers with a row each.  Raises
    UnreadableError with the number of the line that has another form.
    """
    matrices, at = dict[str, sp.csr_matrix](), 0

    def integers(count: int) -> list[int]:
        """Return all whole numbers of the next line; ValueError if they are fewer than `count`."""
        nonlocal at
        at += 1
        numbers = [int(part) for part in lines[at - 1].split()]
        if len(numbers) < count:
            raise ValueError
        return numbers

    def numbers(length: int, words: int, width: int) -> list[float]:
        """Return the numbers of the next lines, which have `length` words, or numbers as some programs count."""
        nonlocal at
        values = list[float]()
        while at < len(lines) and re.match(r"\s*[+-]?\d*\.", lines[at]):
            line = lines[at].rstrip()
            values += [_number4(line[k : k + width]) for k in range(0, len(line), width)]
            at += 1
        if len(values) not in (length, length // words):
            raise ValueError
        return values

    try:
        while at < len(lines) and lines[at].strip():
            head = re.fullmatch(
                r"([ \d-]{32}|[ \d-]{64})(\w[\w ]{7})\(?\s*(?:1P,?)?(\d*[ED](\d+)\..*)", lines[at].rstrip()
            )
            if head is None:
                raise ValueError
            columns, rows, _, kind = (int(part) for part in head[1].split())
            if kind not in WORDS:
                raise UnreadableError(f"real matrices are allowed: {head[2].strip()} has type {kind}", at + 1)
            width, words = int(head[4]), WORDS[kind]
            at += 1
            places, values = list[tuple[int, int]](), list[float]()
            while True:
                column, row, left = integers(3)[:3]
                while left > 0:
                    length = left
                    if row == 0 or rows < 0:
                        first = integers(1)
                        length, start = (
                            (first[0] - 1, first[1]) if rows < 0 else (first[0] // 65536 - 1, first[0] % 65536)
                        )
                        left -= length + (2 if rows < 0 else 1)
                    else:
                        start, left = row, 0
                    part = numbers(length, words, width)
                    if column <= columns and not (1 <= start and start + len(part) - 1 <= abs(rows) and column >= 1):
                        raise ValueError
                    places += [(start + k - 1, column - 1) for k in range(len(part)) if column <= columns]
                    values += part if column <= columns else []
                if column > columns:
                    break
            i, j = np.array(places, np.int64).reshape(-1, 2).T
            matrices[head[2].strip()] = sp.csr_matrix((values, (i, j)), shape=(abs(rows), columns))
    except (ValueError, IndexError, OverflowError) as error:
        if isinstance(error, UnreadableError):
            raise
        allowed = "OUTPUT4 as text is allowed: header, columns and numbers of the width that the header says"
        raise UnreadableError(allowed, min(at + 1, len(lines))) from None
    return matrices


def _number4(text: str) -> float:
    """Return a number of Fortran, whose exponent has E, D or its sign alone; raises ValueError for other texts."""
    return float(re.sub(r"(?<=[\d.])[DE]?([+-]\d+)$", r"E\1", text.strip().upper()))


def only_matrix(matrices: dict[str, sp.csr_matrix], letter: str, name: str = "") -> sp.csr_matrix:
    """Return the matrix called `name`; if `name` is empty, the only matrix or the only one that begins with `letter`.

    A name that begins with K4 is that of structural damping, and not taken for a stiffness.  If several names begin
    with `letter`, only the largest matrices count; if just one of these has a partner whose name goes on in the same
    way (MAAX beside KAAX), that one is returned.  Beside a stiffness, a warning names matrices of damping of its size,
    which are not read.  Raises UnreadableError if there is no such matrix, or several.
    """
    by_name = {key.upper(): matrix for key, matrix in matrices.items()}
    if name:
        if name.upper() not in by_name:
            raise UnreadableError(
                f"the name of a matrix of the file is allowed, not {name}: {', '.join(matrices) or 'none'}"
            )
        return by_name[name.upper()]
    square = [key for key, matrix in by_name.items() if matrix.shape[0] == matrix.shape[1]]
    begins = [key for key in square if key.startswith(letter) and not key.startswith("K4")]
    largest = max((by_name[key].shape[0] for key in begins), default=0)  # EXTSEOUT writes (1, 1) for what there is not
    begins = [key for key in begins if by_name[key].shape[0] == largest]
    damping = [key for key in square if key.startswith(("B", "K4")) and by_name[key].shape[0] == largest]
    if letter == "K" and damping:
        logger.warning("damping is not read, as the scene has its own: %s", ", ".join(damping))
    partners = [key for key in begins if {"K" + key[1:], "M" + key[1:]} <= {*square}]
    begins = partners if len(partners) == 1 else begins
    candidates = [*by_name] if len(by_name) == 1 else begins
    if len(candidates) != 1:
        raise UnreadableError(
            f"one square matrix whose name begins with {letter} is allowed, not {', '.join(matrices) or 'none'}; "
            f"{'--stiffness-name' if letter == 'K' else '--mass-name'} names one of them"
        )
    return by_name[candidates[0]]
