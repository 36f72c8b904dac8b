"""Matrices whose entries state node and direction of their row and column, matrices with names (OUTPUT4), and Ansys'.

Ansys writes matrices by HBMAT in the format of Harwell and Boeing, with a mapping file of their rows.
"""

from __future__ import annotations

import logging
import re
import warnings
import zlib
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from os.path import isfile
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import scipy.io
import scipy.sparse as sp

from pmr.errors import InputError, missing_file_reason
from pmr.errors.environment import import_package
from pmr.files.arrays import Array, Indices
from pmr.files.cards import is_label_number

logger = logging.getLogger(__name__)

#: Errors that readers of SciPy and NumPy raise for damaged files; for a bad Fortran format this is a SyntaxError.
_OF_VALUES = (ValueError, TypeError, LookupError, AttributeError, OverflowError, NotImplementedError, SyntaxError)
DAMAGED = (*_OF_VALUES, OSError, BadZipFile, zlib.error)


@dataclass(frozen=True)
class Entries:
    """E entries of a matrix: `values` (E,), and node and direction of their rows and columns, (E, 2) each."""

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
    """A file does not have the form that is `allowed`.

    `line` is the number of the line that differs, or 0 for the whole file.
    """

    def __init__(self, allowed: str, line: int = 0) -> None:
        super().__init__(allowed)
        self.line = line  # from 1; 0 for the whole file


def read_by_suffix(path: Path, readers: dict[str, Callable[[Path], object]]) -> Any:
    """Return the file's content, read by the function of `readers` for its suffix, such as ``.npz``.

    Raises an InputError if no function has that suffix, the file is missing, or the function can't read the file.
    """
    suffix = path.suffix.lower()
    if suffix not in readers:
        raise InputError(str(path), "", None, f"files that end in {', '.join(readers)} are allowed")
    if not isfile(path):
        raise InputError(str(path), "", None, missing_file_reason(path))
    try:
        with warnings.catch_warnings():  # SciPy warns of future return types and of keys of Harwell-Boeing files
            warnings.simplefilter("ignore")
            return readers[suffix](path)
    except InputError:
        raise
    except UnreadableError as error:
        raise InputError(str(path), f"line {error.line}" if error.line else "", None, str(error)) from None
    except MemoryError:
        raise InputError(str(path), "", None, f"a {suffix} file is allowed whose sizes fit into memory") from None
    except DAMAGED:
        allowed = f"a readable {suffix} file is allowed: this one is cut off, changed, or of another form"
        raise InputError(str(path), "", None, allowed) from None


def read_entries(path: Path) -> Entries:
    """Read the entries of a matrix from lines ``node, direction, node, direction, entry``.

    Abaqus writes this form by ``*MATRIX OUTPUT``.  Raises UnreadableError for lines of another form.
    """
    form = "node, direction, node, direction and entry"
    columns = read_number_table(path, (int, int, int, int, float), form, delimiter=",", comment="*")
    labels = columns[:, :4].astype(np.int64)
    return Entries(labels[:, :2], labels[:, 2:], columns[:, 4])


def read_number_table(
    path: Path, kinds: Sequence[type], form: str, delimiter: str | None = None, comment: str = "#"
) -> Array:
    """Return the numbers (e, c) in the e lines of a text file.

    Each line has c numbers of the given `kinds`, separated by the `delimiter`, or by blanks if it is None.  What
    follows the sign `comment` is ignored.  `form` describes a line in messages.  Raises UnreadableError if the file is
    cut off, has no such line, or has a line that is of another form; the error has this line's number.
    """
    content = path.read_bytes()
    if not content.endswith(b"\n"):
        raise UnreadableError("a last line that ends is allowed: this file is cut off")
    try:
        data = np.loadtxt(path, delimiter=delimiter, comments=comment, ndmin=2)
        ints = [k for k, kind in enumerate(kinds) if kind is int]
        if data.shape[1] == len(kinds) and np.all(data[:, ints] == np.trunc(data[:, ints])) and data.size:
            return data
    except (ValueError, UserWarning):
        pass
    for number, line in enumerate(content.decode("utf-8", "replace").splitlines(), 1):
        text = line.partition(comment)[0].strip()
        if text and not _is_row(text.split(delimiter), kinds):
            raise UnreadableError(f"{form} are allowed, not {text[:40]!r}", number)
    raise UnreadableError(f"lines of {form} are allowed")


def _is_row(parts: Sequence[str], kinds: Sequence[type]) -> bool:
    """Whether the texts `parts` are numbers of the given `kinds`, one for each kind.

    For the kind int a whole number is needed, for float any number.
    """
    if len(parts) != len(kinds):
        return False
    try:
        numbers = zip(map(float, parts), kinds, strict=True)
        return all([kind is float or number == int(number) for number, kind in numbers])
    except (ValueError, OverflowError):
        return False


def read_output4(path: Path) -> dict[str, sp.csr_matrix]:
    """Read the matrices (any shape) of an OUTPUT4 file, by name: a text, or a binary file by pyNastran.

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
    """Read the real matrices (any shape) of the `lines` of an OUTPUT4 text, by name, up to the first blank line.

    Integers have 8 or 16 digits, and numbers the width that the header states.  In general, a column is one run of
    numbers, which begins in the row that the column states.  If that row is 0, or the header's number of rows is
    negative, a column is several runs, each with its own first row.

    Raises UnreadableError with the number of a line that has another form, and for complex matrices.
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
        """Return the numbers of the next lines, each of which takes `width` characters.

        The header counts numbers (`length`) or words of memory, of which a number takes `words`.  Raises ValueError if
        the lines have neither `length` numbers nor ``length // words``.
        """
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
                column, row, remaining = integers(3)[:3]
                while remaining > 0:
                    length = remaining
                    if row == 0 or rows < 0:
                        first = integers(1)
                        length, start = (
                            (first[0] - 1, first[1]) if rows < 0 else (first[0] // 65536 - 1, first[0] % 65536)
                        )
                        remaining -= length + (2 if rows < 0 else 1)
                    else:
                        start, remaining = row, 0
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


#: Names of options by which a matrix is chosen, by the first letter of its usual names.
OPTIONS = {"K": "--stiffness-name", "M": "--mass-name", "B": "--damping-name"}
#: What is allowed as damping.
VISCOUS = "viscous damping in N s/m is allowed: this one is structural, a part of a complex stiffness in N/m"


def only_matrix(matrices: dict[str, sp.csr_matrix], letter: str, name: str = "", damped: bool = False) -> sp.csr_matrix:
    """Return the matrix called `name`; if `name` is empty, the only matrix or the only one that begins with `letter`.

    A matrix whose name begins with K4 is structural damping, and never taken for a stiffness.  If several names begin
    with `letter`, only the largest matrices count.  Of these, one is preferred if it alone has a partner whose name
    goes on in the same way, as MAAX and KAAX.

    For a stiffness, a warning names matrices of damping of the same size, as they are not read.  If `damped`, the
    viscous one is read, and the warning names structural ones only.  Raises UnreadableError if there is no such matrix,
    if there are several, or if the damping (letter B) is structural.
    """
    by_name = {key.upper(): matrix for key, matrix in matrices.items()}
    if letter == "B" and (name.upper().startswith("K4") or (not name and [key[:2] for key in by_name] == ["K4"])):
        raise UnreadableError(VISCOUS)
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
    damping = [key for key in square if key.startswith("K4") or (key.startswith("B") and not damped)]
    damping = [key for key in damping if by_name[key].shape[0] == largest]
    if letter == "K" and damping:
        logger.warning("damping is not read: %s; --damping-name chooses a viscous one", ", ".join(damping))
    partners = [key for key in begins if {"K" + key[1:], "M" + key[1:]} <= {*square}]
    begins = partners if len(partners) == 1 else begins
    candidates = [*by_name] if len(by_name) == 1 else begins
    if len(candidates) != 1:
        raise UnreadableError(
            f"one square matrix whose name begins with {letter} is allowed, not {', '.join(matrices) or 'none'}; "
            f"{OPTIONS[letter]} names one of them"
        )
    return by_name[candidates[0]]


#: Names of degrees of freedom, in the order of directions.
NAMES = ("UX", "UY", "UZ", "ROTX", "ROTY", "ROTZ")


def read_harwell_boeing(path: Path) -> sp.csr_matrix:
    """Read a matrix (n, n) in the format of Harwell and Boeing, of one triangle (RSA) or of all entries (RUA).

    The entries are those of the file: a triangle is not completed.  Right-hand sides, which HBMAT adds to a stiffness,
    are left out.  Raises UnreadableError for other types.
    """
    title, sizes, kind, formats, *lines = path.read_text(encoding="ascii").splitlines()
    if kind[:3].upper() not in ("RSA", "RUA"):
        raise UnreadableError(f"real assembled matrices, RSA or RUA, are allowed, not {kind[:3]!r}", 3)
    if int(sizes[56:70] or 0):
        lines = lines[1 : 1 + sum(int(sizes[k : k + 14]) for k in (14, 28, 42))]
    formats = re.sub(r"\d?P,?", "", formats.upper()).replace("D", "E")
    head = f"{title:<72}", f"{sizes[:56]}{0:>14}", f"RUA{kind[3:]:<67}", f"{formats[:52]:<72}"
    body = [re.sub(r"(?<=[\d.])[dD](?=[+-])", "E", line) for line in lines]
    matrix = sp.csc_matrix(scipy.io.hb_read(StringIO("\n".join([*head, *body, ""]))))
    matrix.check_format(full_check=True)  # of a damaged file, numbers of rows may lead beyond the matrix
    return sp.csr_matrix(matrix)


def read_mapping(path: Path) -> Indices:
    """Read node and direction (n, 2) of each row from the mapping file of Ansys's HBMAT.

    Its lines have row, node and name of a degree of freedom.  Raises UnreadableError with the number of a line of
    another form, or for rows that are not 1, 2 and so on.
    """
    pairs = list[tuple[int, int]]()
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        parts = line.split()
        if not parts or (not pairs and not parts[0].isdigit()):
            continue  # the headings
        row = len(pairs) + 1
        if len(parts) != 3 or parts[0] != str(row) or not is_label_number(parts[1]) or parts[2] not in NAMES:
            raise UnreadableError(f"row {row}, a node and one of {', '.join(NAMES)} are allowed", number)
        pairs.append((int(parts[1]), NAMES.index(parts[2]) + 1))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)
