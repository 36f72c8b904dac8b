"""Files of other programs: matrices, node and direction of each coordinate, nodes and named groups.

CalculiX writes ``*.sti``, ``*.mas`` and ``*.dof`` in a step ``*FREQUENCY, SOLVER=MATRIXSTORAGE``.  The nodes and their
sets are in its input file, as for Abaqus.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from os.path import isfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.io
import scipy.sparse as sp

from pmr.errors import InputError
from pmr.files import labelled
from pmr.files.arrays import Array, Indices
from pmr.files.cards import is_label_number
from pmr.files.decks import NASTRAN_SUFFIXES, NODE_READERS, check_constraints
from pmr.files.labelled import UnreadableError, read_by_suffix, read_harwell_boeing, read_mapping
from pmr.files.matrices import MODAL, GivenMatrices
from pmr.files.nastran import read_bulk
from pmr.files.rigid import DIRECTIONS

#: Number of rows up to which a matrix may have fewer entries than rows, as the damping of a few dampers.
EMPTY_ROWS = 1_000_000


class MatrixNames(NamedTuple):
    """Names of the matrices in a file of Nastran that has several.

    A name may be empty: then the matrix is chosen by the first letter of its name.
    """

    stiffness: str = ""
    mass: str = ""
    damping: str = ""


UNNAMED = MatrixNames()


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
    damping: Path | None = None  #: File of the viscous damping, of a type that the stiffness may have; None: no damping
    names: MatrixNames = UNNAMED


def foreign_files(
    stiffness: Path,
    mass: Path | None,
    dofs: Path | None,
    nodes: Path | None,
    damping: Path | None = None,
    names: MatrixNames = UNNAMED,
) -> ForeignFiles:
    """Return the files of a model, with the names of the matrices in these files.

    Mass, degrees of freedom (`dofs`) and nodes may be None.  If the format of the file `stiffness` can hold them, this
    file has them:

    - the mass in .op4,
    - `dofs` in .mtx,
    - all three in files of DMIG cards.  But if there is an .inp file of the same name as a .pch file, it has the nodes.

    Otherwise each has a file with the name of the stiffness and the suffix .mas, .dof (.mapping for .matrix) or .inp.

    A damping is read only if its file or its name is given.  If only the name is given, the damping is in the file
    `stiffness`.
    """
    suffix = stiffness.suffix.lower()
    combined = {".op4": ("mass",), ".mtx": ("dofs",), **dict.fromkeys(NASTRAN_SUFFIXES, ("mass", "dofs", "nodes"))}
    if suffix == ".pch" and nodes is None and isfile(stiffness.with_suffix(".inp")):
        combined[suffix] = ("mass", "dofs")
    paths = {"mass": mass, "dofs": dofs, "nodes": nodes}
    suffixes = {"mass": ".mas", "dofs": ".mapping" if suffix == ".matrix" else ".dof", "nodes": ".inp"}
    resolved = {
        key: file or (stiffness if key in combined.get(suffix, ()) else stiffness.with_suffix(suffixes[key]))
        for key, file in paths.items()
    }
    return ForeignFiles(stiffness, **resolved, damping=damping or (stiffness if names.damping else None), names=names)


def read_foreign(files: ForeignFiles) -> GivenMatrices:
    """Read the matrices of another program, and the node and direction of each of their coordinates.

    Rotations without an entry in either matrix are left out.  Coordinates with the direction 0 are modal amplitudes.
    If a deck gives nodes axes of their own, rows along these axes and rows along those of the whole are tried; the ones
    that fit the nodes are taken.  Raises InputError if a file is missing, of another kind or incomplete, or if the
    files do not fit each other.
    """
    names, damped = files.names, files.damping is not None
    K = read_by_suffix(files.stiffness, _MATRICES | _nastran_readers("K", names.stiffness, damped))
    M = read_by_suffix(files.mass, _MATRICES | _nastran_readers("M", names.mass))
    pairs, nodes = read_by_suffix(files.dofs, _DOFS), read_by_suffix(files.nodes, NODE_READERS)
    for file in (files.stiffness, files.mass):  # files whose entries name their nodes and directions
        if _is_labelled(file) and not np.array_equal(read_by_suffix(file, _DOFS), pairs):
            raise InputError(str(file), "", None, f"the same nodes and directions as in {files.dofs.name} are needed")
    if len(pairs) != K.shape[0]:
        allowed = f"{K.shape[0]} lines are needed, one for each row of {files.stiffness.name}"
        raise InputError(str(files.dofs), "", len(pairs), allowed)
    on_rows = [K, M, *([] if files.damping is None else [_read_damping(files, files.damping, pairs)])]
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
        allowed = f"1 to {len(DIRECTIONS)}, or 0 for a modal amplitude, is allowed"
        raise InputError(str(files.dofs), "direction", int(wrong[0]), allowed)
    check_constraints(nodes, pairs)

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


def _read_damping(files: ForeignFiles, path: Path, pairs: Indices) -> sp.csr_matrix:
    """Return the damping (n, n) in the file `path` on the coordinates `pairs` (n, 2), node and direction of each.

    If the file's entries state their node and direction, coordinates without an entry are not damped.  Any other file
    is returned in the size that it has.  Raises InputError if the damping is structural, or if it acts on other
    coordinates than the stiffness.  It is also raised if a name of the damping is given, but the format of the file has
    no names.
    """
    name = files.names.damping
    if name and path.suffix.lower() not in (*NASTRAN_SUFFIXES, ".op4"):
        allowed = f"only files of Nastran have matrices with names; leave it out for {path.name}"
        raise InputError("command line", "--damping-name", name, allowed)
    if "_DMPS" in path.stem.upper():  # as Abaqus names its file
        raise InputError(str(path), "", None, labelled.VISCOUS)
    D = read_by_suffix(path, _MATRICES | _nastran_readers("B", name))
    if not _is_labelled(path):
        return D
    damped_pairs = read_by_suffix(path, _DOFS)
    number = {(int(node), int(direction)): k for k, (node, direction) in enumerate(pairs)}
    at = np.array([number.get((int(node), int(direction)), -1) for node, direction in damped_pairs], dtype=np.int64)
    for row in np.flatnonzero((at < 0) & (np.diff(D.indptr) > 0)):
        node, direction = damped_pairs[row]
        allowed = f"only coordinates of {files.dofs.name} are allowed; it has no direction {direction} of this node"
        raise InputError(str(path), "node", int(node), allowed)
    has = np.flatnonzero(at >= 0)
    T = sp.csr_matrix((np.ones(len(has)), (has, at[has])), shape=(len(damped_pairs), len(pairs)))
    return sp.csr_matrix(T.T @ D @ T)


def _turned_coordinates(files: ForeignFiles, pairs: Indices, axes: Mapping[int, Array]) -> sp.csr_matrix:
    """Return a matrix Q (n, n) that turns coordinates u along the model's axes into Q u along axes of nodes.

    `pairs` (n, 2) are the node and the direction (from 1) of each coordinate.  `axes` maps the number of a node with
    axes of its own to their rotation (3, 3).  Such a node needs all three displacements or none, and all three
    rotations or none.  Raises InputError, about `files`, for a node with one or two of them.
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


def _complete_symmetric(A: sp.spmatrix) -> sp.csr_matrix:
    """Return a whole symmetric matrix (n, n) from A (n, n), which stores one triangle or all entries.

    Raises UnreadableError if the matrix is not real and square.  It is also raised if A has more than `EMPTY_ROWS` rows
    and fewer entries than rows: a wrong size in the file must not fill the memory.
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
    """Read a square matrix (n, n) from lines with row, column (both from 1) and entry."""
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


def _refuse_unknown(source: str, key: str, numbers: Indices, place: dict[int, int], nodes: Path) -> None:
    """Raise an InputError for the first of `numbers` (k,) that is not the number of a node in the file `nodes`.

    The error is about the key `key` of the file `source`.  `place` has the index of each node, by its number.
    """
    unknown = [int(number) for number in numbers if int(number) not in place]
    if unknown:
        raise InputError(source, key, unknown[0], f"only nodes of {nodes.name} are allowed")


def _is_labelled(path: Path) -> bool:
    """Whether the entries of a matrix file state the nodes and directions of their row and column."""
    return path.suffix.lower() in NASTRAN_SUFFIXES or (path.suffix.lower() == ".mtx" and not _is_market(path))


def _is_market(path: Path) -> bool:
    """Whether a file has the format of Matrix Market."""
    return path.read_bytes()[:14] == b"%%MatrixMarket"


def _read_market(path: Path) -> sp.csr_matrix:
    """Read a square matrix (n, n) in the format of Matrix Market, or in the format that Abaqus writes.

    Raises UnreadableError if a matrix in the format of Matrix Market is not real, or is neither general nor symmetric.
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


def _nastran_readers(letter: str, name: str, damped: bool = False) -> dict[str, Callable[[Path], object]]:
    """Return readers of a matrix in Nastran's files, by the suffix of the file.

    The matrix is the one called `name` or, if `name` is empty, one whose name begins with `letter`.  `damped` says that
    viscous damping is read, too, so that no warning says that it is not.
    """

    def choose(matrices: dict[str, sp.csr_matrix]) -> sp.csr_matrix:
        return labelled.only_matrix(matrices, letter, name, damped)

    entries = {s: lambda path: choose(read_bulk(path).matrices) for s in NASTRAN_SUFFIXES}
    return {**entries, ".op4": lambda path: _complete_symmetric(choose(labelled.read_output4(path)))}


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
    **{suffix: lambda path: read_bulk(path).pairs for suffix in NASTRAN_SUFFIXES},
}
