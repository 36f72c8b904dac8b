"""Files of other programs: matrices, node and direction of each coordinate, nodes and named groups.

CalculiX writes ``*.sti``, ``*.mas`` and ``*.dof`` in a step ``*FREQUENCY, SOLVER=MATRIXSTORAGE``.  The nodes and their
sets are in its input file, as for Abaqus.
"""

from __future__ import annotations

import warnings
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from os.path import isfile
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
import scipy.io
import scipy.sparse as sp

from pmr.errors import InputError, missing_file_reason
from pmr.files import labelled
from pmr.files.arrays import Array, Indices
from pmr.files.cards import Place, turned_axes
from pmr.files.deck_content import dependent_displacements, is_label_number
from pmr.files.decks import CONTACTS, TURNED, read_deck
from pmr.files.labelled import UnreadableError, read_harwell_boeing, read_mapping
from pmr.files.matrices import MODAL, GivenMatrices
from pmr.files.nastran import read_bulk
from pmr.files.rigid import DIRECTIONS

#: Errors that readers of SciPy and NumPy raise for damaged files; for a bad Fortran format this is a SyntaxError.
_OF_VALUES = (ValueError, TypeError, LookupError, AttributeError, OverflowError, NotImplementedError, SyntaxError)
DAMAGED = (*_OF_VALUES, OSError, BadZipFile, zlib.error)
#: Number of rows up to which a matrix may have fewer entries than rows, as the damping of a few dampers.
EMPTY_ROWS = 1_000_000


@dataclass(frozen=True)
class ForeignFiles:
    """Paths of the files in which another program stored its model."""

    #: File of the stiffness: ``.sti`` (CalculiX), ``.mtx`` (Matrix Market, or Abaqus's own format), ``.npz`` (SciPy),
    #: ``.rb``, ``.hb`` or ``.matrix`` (Harwell-Boeing), ``.bdf`` or ``.pch`` (DMIG of Nastran) or ``.op4`` (Nastran).
    #: If a file of Nastran has several matrices, the names of stiffness and mass begin with K (not K4) and M, or are
    #: said
    stiffness: Path
    mass: Path  #: File of the mass: ``.mas``, or a type that the stiffness may have
    #: File with node and direction (1 to 6) of each row: ``.dof`` with lines ``node.direction``, or ``.csv`` with lines
    #: ``node,direction``, or ``.mapping`` (Ansys); ``.bdf``, ``.pch`` and Abaqus's ``.mtx`` state them with each entry
    dofs: Path
    #: File of the nodes and their groups: ``.inp`` with ``*NODE`` and ``*NSET``, ``.bdf`` with GRID and SET1 (the group
    #: of set 7 is ``set7``), or ``.csv`` with lines ``node,x,y,z`` that end with the names of the node's groups
    nodes: Path
    stiffness_name: str = ""  #: Name of the stiffness in a file of Nastran with several matrices
    mass_name: str = ""  #: Name of the mass in such a file
    damping: Path | None = None  #: File of the viscous damping, of a type that the stiffness may have; None: no damping
    damping_name: str = ""  #: Name of the damping in a file of Nastran


def foreign_files(
    stiffness: Path,
    mass: Path | None,
    dofs: Path | None,
    nodes: Path | None,
    stiffness_name: str = "",
    mass_name: str = "",
    damping: Path | None = None,
    damping_name: str = "",
) -> ForeignFiles:
    """Return the files of a model, and the names of its matrices in them.

    Mass, degrees of freedom (`dofs`) and nodes that are None are in the file `stiffness` itself if files of its format
    hold them: the mass in .op4, `dofs` in .mtx, all three in files of DMIG cards.  Otherwise each has a file of the
    same name with the suffix .mas, .dof (.mapping for .matrix) or .inp.  For a .pch file the .inp file of the same name
    has the nodes, if it exists.

    A damping is read only if its file or its name is given; a name alone is that of a matrix in `stiffness`.
    `stiffness_name`, `mass_name` and `damping_name` are names of matrices in files of several.
    """
    suffix = stiffness.suffix.lower()
    combined = {".op4": ("mass",), ".mtx": ("dofs",), **dict.fromkeys(_DMIG, ("mass", "dofs", "nodes"))}
    if suffix == ".pch" and nodes is None and isfile(stiffness.with_suffix(".inp")):
        combined[suffix] = ("mass", "dofs")
    paths = {"mass": mass, "dofs": dofs, "nodes": nodes}
    suffixes = {"mass": ".mas", "dofs": ".mapping" if suffix == ".matrix" else ".dof", "nodes": ".inp"}
    resolved = {
        key: file or (stiffness if key in combined.get(suffix, ()) else stiffness.with_suffix(suffixes[key]))
        for key, file in paths.items()
    }
    if damping is None and damping_name:
        damping = stiffness
    return ForeignFiles(
        stiffness,
        **resolved,
        stiffness_name=stiffness_name,
        mass_name=mass_name,
        damping=damping,
        damping_name=damping_name,
    )


@dataclass(frozen=True)
class _Nodes:
    """Nodes of a model: their N numbers (N,), points (N, 3) in m and groups, and cards that constrain coordinates."""

    numbers: Indices
    points: Array
    groups: dict[str, Indices]  # numbers of the nodes in each group, by its name
    constraints: Sequence[tuple[Place, str]] = ()  # place and keyword of each card that constrains coordinates
    axes: Mapping[int, Array] = field(default_factory=dict)  # (3, 3): axes of coordinates as rows, by node with its own
    turned: Place | None = None  # card of axes in which the matrices may be, or not
    #: node and direction (from 1) of displacements that depend on others by a card, by its place
    dependent: Mapping[Place, set[tuple[int, int]]] = field(default_factory=dict)
    condensed: bool = False  # whether nodes without rows are condensed, not held

    def only(self, numbers: Indices) -> _Nodes:
        """Return those of the nodes that have one of the `numbers`: boundary nodes of a superelement."""
        at = np.isin(self.numbers, numbers)
        groups = {name: members[np.isin(members, numbers)] for name, members in self.groups.items()}
        groups = {name: members for name, members in groups.items() if len(members)}
        return replace(self, numbers=self.numbers[at], points=self.points[at], groups=groups)

    def without_dependent(self, pairs: Indices) -> _Nodes:
        """Return the nodes without those that cards tie to other nodes, and without these cards.

        A node is left out if all of its displacements depend on others and it has no row among the node and direction
        `pairs` (n, 2) of the matrices.  A card stays if it ties a displacement of any other node.
        """
        depending = set[tuple[int, int]]().union(*self.dependent.values())
        nodes = {node for node, _ in depending if {(node, 1), (node, 2), (node, 3)} <= depending} - {
            *pairs[:, 0].tolist()
        }
        if not nodes:
            return self
        explained = {
            place for place, coordinates in self.dependent.items() if {node for node, _ in coordinates} <= nodes
        }
        constraints = [(place, keyword) for place, keyword in self.constraints if place not in explained]
        return replace(self.only(np.setdiff1d(self.numbers, [*nodes])), constraints=constraints)


def read_foreign(files: ForeignFiles) -> GivenMatrices:
    """Read the matrices of another program, and the node and direction of each of their coordinates.

    Rotations without an entry in either matrix are left out.  Coordinates with the direction 0 are modal amplitudes.
    If a deck gives nodes axes of their own, rows along these axes and rows along those of the whole are tried; the ones
    that fit the nodes are taken.  Raises InputError if a file is missing, of another kind or incomplete, or if the
    files do not fit each other.
    """
    K, M = (
        _read_by_suffix(
            files.stiffness, _MATRICES | _nastran_readers("K", files.stiffness_name, files.damping is not None)
        ),
        _read_by_suffix(files.mass, _MATRICES | _nastran_readers("M", files.mass_name)),
    )
    pairs, nodes = _read_by_suffix(files.dofs, _DOFS), _read_by_suffix(files.nodes, _NODES)
    for file in (files.stiffness, files.mass):  # files whose entries name their nodes and directions
        if _is_labelled(file) and not np.array_equal(_read_by_suffix(file, _DOFS), pairs):
            raise InputError(str(file), "", None, f"the nodes and directions of {files.dofs.name} are allowed")
    if len(pairs) != K.shape[0]:
        allowed = f"a line for each of the {K.shape[0]} rows of {files.stiffness.name} is allowed"
        raise InputError(str(files.dofs), "", len(pairs), allowed)
    on_rows = [K, M, *([] if files.damping is None else [_read_damping(files, pairs)])]
    if all(A.shape == K.shape for A in on_rows):  # what no matrix has does not exist, as a rotation of solids' nodes
        sizes = sum(np.asarray(abs(A).sum(axis=1)).ravel() for A in on_rows)
        used = np.flatnonzero((sizes > 0.0) | (pairs[:, 1] < 4))
        on_rows, pairs = [A[used][:, used] for A in on_rows], pairs[used]
    modal = pairs[:, 1] == 0  # a scalar point: it has no node
    if modal.any() or nodes.condensed:
        nodes = nodes.only(np.unique(pairs[~modal, 0]))
    nodes = nodes.without_dependent(pairs)
    place = {int(number): k for k, number in enumerate(nodes.numbers)}
    _refuse_unknown(str(files.dofs), "node", pairs[~modal, 0], place, files.nodes)
    for name, members in nodes.groups.items():
        _refuse_unknown(str(files.nodes), f"group {name}", members, place, files.nodes)
    wrong = pairs[(pairs[:, 1] < 0) | (pairs[:, 1] > len(DIRECTIONS)), 1]
    if wrong.size:
        allowed = f"1 to {len(DIRECTIONS)} is allowed, or 0 of a modal amplitude"
        raise InputError(str(files.dofs), "direction", int(wrong[0]), allowed)
    _check_constraints(nodes, pairs)

    def body(Q: sp.csr_matrix | None) -> GivenMatrices:
        """Return the matrices on coordinates z with q = Q z, where q are the coordinates of the file.

        If Q is None, z = q.
        """
        turned = (A if Q is None or A.shape != Q.shape else sp.csr_matrix(Q.T @ A @ Q) for A in on_rows)
        stiffness, mass, *damping = turned  # another shape is refused
        return GivenMatrices(
            mass,
            stiffness,
            nodes.points,
            np.array([place.get(int(number), MODAL) if d else MODAL for number, d in pairs], dtype=np.int64),
            pairs[:, 1] - 1,
            {name: np.array([place[int(number)] for number in members]) for name, members in nodes.groups.items()},
            str(files.stiffness),
            *damping,
        ).without_condensed_nodes()

    if nodes.turned is None:
        return body(_turned_coordinates(files, pairs, nodes.axes) if nodes.axes else None)
    fitting, reasons = list[GivenMatrices](), list[str]()
    for turns in (False, True):  # Abaqus writes rows along the axes of *TRANSFORM, CalculiX along those of the whole
        try:
            fitting.append(body(_turned_coordinates(files, pairs, nodes.axes) if turns else None))
        except InputError as error:
            reasons.append(error.allowed)
    if len(fitting) != 1:
        which = "both" if fitting else f"neither; along the whole {reasons[0]}"
        allowed = f"rows along the axes of *TRANSFORM or along those of the whole are allowed: K fits {which}"
        raise nodes.turned.error(allowed)
    return fitting[0]


def _read_damping(files: ForeignFiles, pairs: Indices) -> sp.csr_matrix:
    """Return the damping (n, n) on the coordinates `pairs` (n, 2); without labels of its rows, in the size of the file.

    If its entries state their node and direction, coordinates that it does not have are not damped.  Raises InputError
    if the damping is structural, or acts on other coordinates than the stiffness.
    """
    path, name = files.damping, files.damping_name
    assert path is not None
    if name and path.suffix.lower() not in (*_DMIG, ".op4"):
        allowed = f"a name is allowed of a file of Nastran, not of {path.name}; --damping names files of other programs"
        raise InputError("command line", "--damping-name", name, allowed)
    if "_DMPS" in path.stem.upper():  # as Abaqus names its file
        raise InputError(str(path), "", None, labelled.VISCOUS)
    D = _read_by_suffix(path, _MATRICES | _nastran_readers("B", name))
    if not _is_labelled(path):
        return D
    damped_pairs = _read_by_suffix(path, _DOFS)
    number = {(int(node), int(direction)): k for k, (node, direction) in enumerate(pairs)}
    at = np.array([number.get((int(node), int(direction)), -1) for node, direction in damped_pairs], dtype=np.int64)
    for row in np.flatnonzero((at < 0) & (np.diff(D.indptr) > 0)):
        node, direction = damped_pairs[row]
        allowed = f"the coordinates of {files.dofs.name} are allowed, which has no direction {direction} of this node"
        raise InputError(str(path), "node", int(node), allowed)
    has = np.flatnonzero(at >= 0)
    T = sp.csr_matrix((np.ones(len(has)), (has, at[has])), shape=(len(damped_pairs), len(pairs)))
    return sp.csr_matrix(T.T @ D @ T)


def _turned_coordinates(files: ForeignFiles, pairs: Indices, axes: Mapping[int, Array]) -> sp.csr_matrix:
    """Return a matrix Q (n, n) with which coordinates along axes of nodes are Q u, for u along the axes of the whole.

    `pairs` (n, 2) are the node and the direction (from 1) of each coordinate.  Raises InputError for a node with axes
    of its own that has some of three coordinates only.
    """
    number = {(int(node), int(direction)): k for k, (node, direction) in enumerate(pairs)}
    Q = sp.eye(len(pairs), format="lil")
    for node, R in axes.items():
        for first in (1, 4):
            at = [number[node, d] for d in range(first, first + 3) if (node, d) in number]
            if len(at) not in (0, 3):
                allowed = "a node with axes of its own is allowed that has all three displacements or rotations"
                raise InputError(str(files.dofs), f"node {node}", None, allowed)
            for k, row in zip(at, R, strict=False):
                Q[k, at] = row
    return sp.csr_matrix(Q)


def _check_constraints(nodes: _Nodes, pairs: Indices) -> None:
    """Raise InputError for nodes with their own axes, and for cards that constrain coordinates.

    Such cards are refused only if some displacements have no row in the matrices.  `pairs` (n, 2) are the node and the
    direction (from 1) of each row.
    """
    missing = 3 * len(nodes.numbers) - int(np.isin(pairs[:, 1], (1, 2, 3)).sum())
    for place, keyword in nodes.constraints:
        if keyword == TURNED:
            allowed = (
                "rows along the axes of the whole are allowed: *TRANSFORM gives nodes axes of their own; matrices "
                "written without it are allowed"
            )
            raise place.error(allowed)
        is_nastran = Path(place.source).suffix.lower() in _DMIG
        is_rigid = is_nastran and keyword != "MPC"  # of several sets of MPC a run takes one
        with_rows = nodes.dependent.get(place, set()) & {(node, d) for node, d in pairs.tolist()} if is_rigid else set()
        if with_rows:
            node, direction = min(with_rows)
            allowed = (
                f"matrices are allowed that {keyword} is part of: it makes direction {direction} of grid point {node} "
                "depend on others, and the matrices have a row of it"
            )
            raise place.error(allowed)
        if missing > 0:
            star = "" if is_nastran else "*"
            allowed = (
                f"a model is allowed in which {star}{keyword} ties no coordinates to others: {missing} displacements "
                "have no row in the matrices, which pmr takes as fixed"
            )
            raise place.error(allowed)


def _read_by_suffix(path: Path, readers: dict[str, Callable[[Path], object]]) -> Any:
    """Return the result of the reader for the file's suffix; raises InputError if this reader can't read the file."""
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


def _complete_symmetric(A: sp.spmatrix) -> sp.csr_matrix:
    """Return a whole symmetric matrix from one that has only one triangle stored, or all entries.

    Raises UnreadableError if the matrix is not real and square, or if it has more than `EMPTY_ROWS` rows and fewer
    entries than rows.  The latter protects memory against a wrong size in the file.
    """
    n = A.shape[0]
    if np.iscomplexobj(A):
        raise UnreadableError("real entries are allowed: these have imaginary parts")
    if A.shape != (n, n) or n > max(A.nnz, EMPTY_ROWS):
        allowed = f"a square matrix with entries in all rows is allowed, not {A.nnz} entries in {n} x {A.shape[1]}"
        raise UnreadableError(allowed)
    if sp.isspmatrix_csr(A) or sp.isspmatrix_csc(A):
        A.check_format(full_check=True)  # SciPy would crash at indices out of range
    A = sp.csr_matrix(A, dtype=float)
    lower, upper = sp.tril(A, -1), sp.triu(A, 1)
    if lower.nnz and upper.nnz:
        return A
    return sp.csr_matrix(A + (lower + upper).T)


def _read_triplets(path: Path) -> sp.csr_matrix:
    """Read a matrix from lines with row, column (both from 1) and entry."""
    entries = labelled.read_number_table(path, (int, int, float), "row, column and entry")
    rows, columns = (entries[:, k].astype(np.int64) - 1 for k in (0, 1))
    n = int(max(rows.max(), columns.max())) + 1
    return _complete_symmetric(sp.coo_matrix((entries[:, 2], (rows, columns)), shape=(n, n)))


def _read_coordinates(path: Path, between: str, head: int) -> Indices:
    """Read node and direction (n, 2) from all lines after the first `head` ones; empty lines are left out.

    `between` is the sign that separates the two.  Raises UnreadableError with the number of a line of another form.
    """
    pairs = list[tuple[int, int]]()
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        parts = line.strip().split(between)
        if number <= head or parts == [""]:
            continue
        if len(parts) != 2 or not all(is_label_number(part.strip()) for part in parts):
            allowed = f"node and direction with {between!r} between them are allowed, not {line.strip()[:40]!r}"
            raise UnreadableError(allowed, number)
        pairs.append((int(parts[0]), int(parts[1])))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _read_csv_nodes(path: Path) -> _Nodes:
    """Read nodes and groups from a CSV file; its first line is skipped.

    Each line has node, x, y, z in m and the names of the groups that the node belongs to.  Raises UnreadableError with
    the number of a line of another form.
    """
    numbers, points, groups = list[int](), list[list[float]](), dict[str, list[int]]()
    for at, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        number, *parts = (part.strip() for part in line.split(","))
        if at == 1 or not line.strip():
            continue
        try:
            place = [float(part) for part in parts[:3]]
        except ValueError:
            place = []
        if len(place) != 3 or not is_label_number(number):
            raise UnreadableError("node, x, y, z and names of groups are allowed", at)
        numbers.append(int(number))
        points.append(place)
        for name in filter(None, parts[3:]):
            groups.setdefault(name, []).append(int(number))
    return _make_nodes(numbers, points, groups)


def read_groups(path: Path) -> dict[str, Array]:
    """Return the points (g, 3) in m of each group in a CSV file, such as `pmr matrices --nodes` takes.

    Raises InputError if the file can't be read.
    """
    nodes = _read_by_suffix(path, {".csv": _read_csv_nodes})
    return {name: nodes.points[np.isin(nodes.numbers, members)] for name, members in nodes.groups.items()}


def _read_deck_nodes(path: Path) -> _Nodes:
    """Read nodes, sets and constraint cards from an input deck of Abaqus or CalculiX.

    Raises InputError if two instances have nodes with the same number.
    """
    deck = read_deck(path)
    if deck.renumbered is not None:
        allowed = (
            "matrices name nodes by their numbers: instances whose nodes have numbers that no other has are allowed"
        )
        raise deck.renumbered.error(allowed)
    sets = {name: [*members] for name, members in (deck.surfaces | deck.node_sets).items() if name[0] != "_"}
    axes = dict[int, Array]()
    for card in deck.turned:
        name = card.options.get("NSET", "")
        if name.lower() not in deck.node_sets:
            raise card.place.error(f"NSET={name} is no set of nodes")
        numbers = sorted(deck.node_sets[name.lower()])
        axes |= zip(numbers, turned_axes(card, np.array([deck.nodes[number] for number in numbers])), strict=True)
    nodes = _make_nodes(list(deck.nodes), [*deck.nodes.values()], sets)
    turned = deck.turned[0].place if deck.turned else None
    dependent = dependent_displacements(deck)
    constraints = [(place, keyword) for place, keyword in deck.constraints if keyword not in CONTACTS]
    return replace(nodes, constraints=constraints, axes=axes, turned=turned, dependent=dependent)


def _make_nodes(numbers: list[int], points: Sequence[Sequence[float]], groups: dict[str, list[int]]) -> _Nodes:
    """Return nodes from their numbers, points and groups; groups without members are left out.

    Raises UnreadableError if there are no nodes.
    """
    if not numbers:
        raise UnreadableError("nodes are allowed: this file has none")
    sets_of_nodes = {name: np.unique(np.array(members, dtype=np.int64)) for name, members in groups.items() if members}
    return _Nodes(np.array(numbers, dtype=np.int64), np.array(points), sets_of_nodes)


def _refuse_unknown(source: str, key: str, numbers: Indices, place: dict[int, int], nodes: Path) -> None:
    """Raise an InputError for the first of `numbers` that is not a node in the file `nodes`.

    The error is about the key `key` of the file `source`.  `place` has the index of each node, by its number.
    """
    unknown = [int(number) for number in numbers if int(number) not in place]
    if unknown:
        raise InputError(source, key, unknown[0], f"nodes that {nodes.name} has are allowed")


def _is_labelled(path: Path) -> bool:
    """Whether the entries of a matrix file state the nodes and directions of their row and column."""
    return path.suffix.lower() in _DMIG or (path.suffix.lower() == ".mtx" and not _is_market(path))


def _is_market(path: Path) -> bool:
    """Whether a file has the format of Matrix Market."""
    return path.read_bytes()[:14] == b"%%MatrixMarket"


def _read_market(path: Path) -> sp.csr_matrix:
    """Read a matrix in the format of Matrix Market, or in the format that Abaqus writes.

    Raises UnreadableError unless it is real, and general or symmetric.
    """
    if not _is_market(path):
        entries = labelled.read_entries(path)
        return _complete_symmetric(entries.matrix(entries.pairs))
    lines = path.read_bytes().splitlines()[1:]
    if not any(line.strip() and line.lstrip()[:1] != b"%" for line in lines):  # SciPy would read on for ever
        raise UnreadableError("a line with the numbers of rows, columns and entries is allowed: this file is cut off")
    *_, kind, symmetry = scipy.io.mminfo(path)
    if kind not in ("real", "integer") or symmetry not in ("general", "symmetric"):
        raise UnreadableError(f"real entries, general or symmetric, are allowed, not {kind} {symmetry} ones", 1)
    return _complete_symmetric(sp.coo_matrix(scipy.io.mmread(path)))


def _read_bulk_nodes(path: Path) -> _Nodes:
    """Read grid points, their sets and own axes, and cards that constrain coordinates from Nastran's bulk data."""
    bulk = read_bulk(path)
    groups = {name: nodes.tolist() for name, nodes in bulk.groups.items()}
    ties = [(Place(str(path), line), name) for line, name in bulk.constraints]
    dependent = {Place(str(path), line): members for line, members in bulk.dependent.items()}
    nodes = _make_nodes(bulk.numbers.tolist(), bulk.points.tolist(), groups)
    return replace(nodes, axes=bulk.axes, constraints=ties, dependent=dependent, condensed=bulk.condensed)


def _nastran_readers(letter: str, name: str, damped: bool = False) -> dict[str, Callable[[Path], object]]:
    """Return readers, by the suffix of the file, for the matrix of a Nastran file that has a name.

    If `name` is empty, its name begins with `letter`.  If `damped`, viscous damping is read besides this matrix.
    """

    def choose(matrices: dict[str, sp.csr_matrix]) -> sp.csr_matrix:
        return labelled.only_matrix(matrices, letter, name, damped)

    entries = {s: lambda path: choose(read_bulk(path).matrices) for s in _DMIG}
    return {**entries, ".op4": lambda path: _complete_symmetric(choose(labelled.read_output4(path)))}


_DMIG = (".bdf", ".pch", ".dat", ".nas")
_MATRICES: dict[str, Callable[[Path], object]] = {
    ".sti": _read_triplets,
    ".mas": _read_triplets,
    ".mtx": _read_market,
    ".npz": lambda path: _complete_symmetric(sp.load_npz(path)),
    **dict.fromkeys((".rb", ".hb", ".matrix"), lambda path: _complete_symmetric(read_harwell_boeing(path))),
}
_DOFS: dict[str, Callable[[Path], object]] = {
    ".dof": lambda path: _read_coordinates(path, ".", 0),
    ".csv": lambda path: _read_coordinates(path, ",", 1),
    ".mapping": read_mapping,
    ".mtx": lambda path: labelled.read_entries(path).pairs,
    **{suffix: lambda path: read_bulk(path).pairs for suffix in _DMIG},
}
_NODES: dict[str, Callable[[Path], object]] = {
    ".inp": _read_deck_nodes,
    ".csv": _read_csv_nodes,
    **dict.fromkeys(_DMIG, _read_bulk_nodes),
}
