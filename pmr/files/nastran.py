"""Bulk data of Nastran: matrices (DMIG entries), grid points, sets, and entries that tie displacements."""

from __future__ import annotations

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
from pmr.files.labelled import Entries, UnreadableError

SQUARE, SYMMETRIC = 1, 6
#: Number and text of each line.
Lines = Sequence[tuple[int, str]]


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
    condensed: bool  #: Whether entries say that displacements were condensed


#: Cards of a file that pyNastran reads.  This module reads sets itself, as pyNastran expands their ranges to lists of
#: all numbers, even of points that do not exist.
CARDS = frozenset(
    ("GRID", "SPOINT", "DMIG", "INCLUDE", "ENDDATA", *(f"CORD{number}{kind}" for number in (1, 2) for kind in "RCS"))
)


#: What pyNastran need not look up for the places of grid points.
NOT_NEEDED = tuple(
    f"xref_{of}" for of in ("elements", "properties", "materials", "loads", "constraints", "aero", "sets")
)
#: What is left out where a line is compared with a reason that quotes it.
NOT_IN_WORDS = re.compile(r"None|[^A-Za-z0-9.+-]")
#: Sine of the angle from the polar axis up to which a grid point is at a pole.
POLE = 1e-9
#: Entries that tie displacements of grid points to those of others.
TIES = re.compile(r"(MPC|RBAR1?|RBE[123]|RJOINT|RROD|RSPLINE|RSSCON|RTRPLT1?)\b", re.IGNORECASE)
#: Entries that say which displacements a condensation has kept, or left out.
CONDENSED = re.compile(r"(ASET1?|OMIT1?|BSET1?|CSET1?|QSET1?)\b", re.IGNORECASE)
#: Number and name of a SET1 of grid points in a comment of HyperMesh, and of ANSA.
NAMED = re.compile(r"\$(?:HMSET\s+(\d+)\s+1\s+\"([^\"]+)\"|ANSA_NAME_COMMENT;(\d+);SET;([^;]+);)")
#: Name of a file in an entry INCLUDE, and largest depth to which files include others.
INCLUDED, DEEPEST = re.compile(r"\s*INCLUDE\s+['\"]?([^'\"]+)", re.IGNORECASE), 5
BEGIN = re.compile(r"\s*BEGIN\s+(BULK|SUPER)\b", re.IGNORECASE)


def read_bulk(path: Path) -> Bulk:
    """Read the matrices, grid points and sets of a file of Nastran: its bulk data alone, or a deck with BEGIN BULK.

    The bulk data may be those of one superelement (BEGIN SUPER), as EXTSEOUT writes them.  Raises InputError if
    pyNastran is missing.  Raises UnreadableError if the file can't be read, or if it has

    - complex matrices,
    - several parts,
    - a grid point whose displacements are in spherical axes, and which lies on the polar axis of these.
    """
    return _read_bulk(path, tuple(_read_lines(path)))


@lru_cache(maxsize=2)  # a deck has matrices, rows and nodes, and is read for each
def _read_bulk(path: Path, lines: Lines) -> Bulk:
    """Return the content of a file with these lines; raises UnreadableError as `read_bulk` says."""
    deck = import_package("pyNastran.bdf.bdf").BDF(debug=None)
    deck.disable_cards(deck.cards_to_read - CARDS)
    parts = [(k, begun[1].upper()) for k, (_, text) in enumerate(lines) if (begun := BEGIN.match(text))]
    if len(parts) > 1:
        allowed = "the bulk data of one part are allowed: a second one begins here"
        raise UnreadableError(allowed, lines[parts[1][0]][0])
    is_super = bool(parts) and parts[0][1] == "SUPER"
    try:
        with redirect_stdout(StringIO()), TemporaryDirectory() as folder:
            bulk = Path(folder, path.name)  # with the files that it includes in place
            first = parts[0][0] + 1 if is_super else 0  # pyNastran reads superelements only beside a residual structure
            bulk.write_text("\n".join(text for _, text in lines[first:]), encoding="utf-8")
            deck.read_bdf(str(bulk), xref=False, punch=is_super or not parts)
            deck.cross_reference(**dict.fromkeys(NOT_NEEDED, False))
    except (Exception, SystemExit) as error:  # pyNastran raises many kinds of errors
        raise _unreadable_bulk(lines, str(error)) from None
    entries = dict[str, Entries]()
    for name, card in deck.dmig.items():
        line = next((k for k, text in lines if text.upper().startswith("DMIG") and name in text.upper()), 0)
        if card.is_complex:
            raise UnreadableError(f"real entries are allowed: those of {name} have imaginary parts", line)
        if card.matrix_form in (SQUARE, SYMMETRIC):
            values = np.asarray(card.Real, float)
            entries[name] = Entries(np.asarray(card.GCi, np.int64), np.asarray(card.GCj, np.int64), values)
    pairs = np.unique(np.vstack([np.empty((0, 2), np.int64), *(matrix.pairs for matrix in entries.values())]), axis=0)
    if not entries:
        pairs = _external_pairs(lines)
    grids = sorted(deck.nodes)
    axes = dict[int, Array]()
    for grid in grids:
        if deck.nodes[grid].Cd() != 0:
            system, place = deck.nodes[grid].cd_ref, deck.nodes[grid].get_position()
            if system is None:
                raise UnreadableError(
                    f"points of a structure are allowed: {grid} is one of a fluid", _line_of(lines, grid)
                )
            axes[grid] = _displacement_axes(system.type[-1], system.beta(), system.transform_node_to_local(place))
            if not np.isfinite(axes[grid]).all():
                allowed = "displacements along spherical axes are allowed away from their poles"
                raise UnreadableError(f"{allowed}: grid point {grid} is at one", _line_of(lines, grid))
    for line, fields in _entries(lines, "GRDSET"):
        if any(field not in ("", "0") for field in (fields + [""] * 6)[1:6:4]):
            raise UnreadableError("grid points with CP and CD of their own are allowed, without those of GRDSET", line)
    dependent = dict[int, set[tuple[int, int]]]()
    ties = [(k, tie[1].upper()) for k, text in lines if (tie := TIES.match(text))]
    for name in {name for _, name in ties}:
        for k, fields in _entries(lines, name):
            dependent.setdefault(k, set()).update(_dependent(name, fields))
    return Bulk(
        {name: matrix.matrix(pairs) for name, matrix in entries.items()},
        pairs,
        np.array(grids, dtype=np.int64),
        np.array([deck.nodes[grid].get_position() for grid in grids], dtype=float).reshape(-1, 3),
        _group_sets(lines, np.array(grids, dtype=np.int64)),
        axes,
        ties,
        dependent,
        any(CONDENSED.match(text) for _, text in lines),
    )


def _read_lines(path: Path, within: Sequence[Path] = ()) -> Lines:
    """Return the lines of a file with their numbers; lines of included files stand in place of their INCLUDE.

    Lines of an included file have the number of the line with INCLUDE.  `within` are the files that include this one,
    the deck first.  An included file is looked for in the folder of the deck, then in that of the file that names it.
    Raises UnreadableError for a file that is missing or includes itself, and beyond the depth `DEEPEST`.
    """
    lines = list[tuple[int, str]]()
    for number, text in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        name = INCLUDED.match(text)
        if name is None:
            lines.append((number, text))
            continue
        folders = (*within[:1], path)
        file = next((of.parent / name[1].strip() for of in folders if (of.parent / name[1].strip()).is_file()), None)
        if file is None or file in (*within, path) or len(within) > DEEPEST:
            allowed = f"INCLUDE {name[1].strip()}: a file beside the deck is allowed that does not include itself"
            raise UnreadableError(allowed, number)
        try:
            lines += [(number, inner) for _, inner in _read_lines(file, (*within, path))]
        except UnreadableError as error:
            raise UnreadableError(str(error), number) from None
    return lines


def _line_of(lines: Lines, grid: int) -> int:
    """Return the number of the line out of `lines` on which a grid point begins; 0 for a point that is missing."""
    pattern = re.compile(rf"GRID\*?[\s,]*{grid}\b", re.IGNORECASE)
    return next((k for k, text in lines if pattern.match(text)), 0)


def _unreadable_bulk(lines: Lines, reason: str) -> UnreadableError:
    """Return the error for bulk data that pyNastran can't read.

    `reason` is pyNastran's message.  If the message quotes one of `lines`, the error has the number of this line.
    """
    quoted = NOT_IN_WORDS.sub("", reason)
    line = next((k for k, text in lines if len(words := NOT_IN_WORDS.sub("", text)[:20]) > 7 and words in quoted), 0)
    allowed = "bulk data of GRID, SET1 and DMIG entries are allowed"
    return UnreadableError(f"{allowed}: this line can't be read" if line else allowed, line)


def _displacement_axes(kind: str, beta: Array, place: Array) -> Array:
    """Return the axes (3, 3) of a grid point's displacements, as rows.

    `kind` is the kind of their coordinate system: R (rectangular), C (cylindrical) or S (spherical).  `beta` (3, 3) has
    the system's axes as rows.  `place` (3,) are the coordinates of the grid point in the system, with angles in
    degrees: from x in a cylindrical system, from z and from x in a spherical one.  The result is NaN at a pole of a
    spherical system.
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


def _group_sets(lines: Lines, grids: Indices) -> dict[str, Indices]:
    """Return the members (k,) of each SET1 entry in `lines` by name, such as ``set7``.

    A range contains all of its numbers that are in `grids` (N,).  Raises UnreadableError for an entry of another form.
    """
    sets = dict[str, Indices]()
    for line, fields in _entries(lines, "SET1"):
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
    for named in (NAMED.match(text) for _, text in lines):
        if named and (key := f"set{int(named[1] or named[3])}") in sets:
            sets.setdefault((named[2] or named[4]).strip().lower(), sets[key])
    return sets


def _dependent(name: str, fields: Sequence[str]) -> set[tuple[int, int]]:
    """Return grid point and component of the displacements that the rigid element `name` makes depend on others.

    `fields` are the fields after the name.  Known forms are an RBE2, an RBE3 without UM, an RBAR whose first point is
    independent in all components, and an MPC.  For any other entry the result is the pair (0, 0) alone.
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
        return {(0, 0)}
    return {(int(point), int(component)) for point in points for component in components}


def _external_pairs(lines: Lines) -> Indices:
    """Return grid point and component (n, 2) of the n rows of a superelement's matrices, from entries EXTRN.

    Raises UnreadableError for an entry of another form.
    """
    pairs = list[tuple[int, int]]()
    for line, fields in _entries(lines, "EXTRN"):
        named = [field for field in fields if field]
        try:
            for node, components in zip(named[::2], named[1::2], strict=True):
                pairs += [(int(node), int(component)) for component in components]
        except ValueError:
            raise UnreadableError("EXTRN with pairs of grid point and components is allowed", line) from None
    return np.array(pairs, np.int64).reshape(-1, 2)


def _entries(lines: Lines, name: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the number of the first line, and the fields after the name, of each entry called `name`.

    Continuation lines of an entry begin with a blank, plus, star or comma.
    """
    begun, fields = 0, list[str]()
    for number, line in lines:
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
