"""Mass, stiffness and damping of another program's model, with node and direction of each coordinate, checked."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from os.path import isfile
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from pmr.errors import NAMED, InputError, is_name, missing_file_reason
from pmr.files import npz
from pmr.files.arrays import Array, Indices, Mask
from pmr.files.fit import centre_of_mass, indefinite, misfit, negative_damping
from pmr.files.rigid import DIRECTIONS, Resistance, rigid_motions

logger = logging.getLogger(__name__)

#: Version 2 has a damping; files without one are of version 1.
FORMAT, FORMAT_VERSION = "pmr-matrices", 2
#: Largest difference between a matrix (M, K or D) and its transpose, as a share of the largest entry of the matrix.
SYMMETRY = 1e-9
#: Node and direction of a coordinate that has neither, as of a modal amplitude.
MODAL = -1
_PARTS = ("data", "indices", "indptr")


@dataclass(frozen=True)
class GivenMatrices:
    """Mass M, stiffness K and damping D of a body whose n coordinates q are displacements and rotations of N nodes.

    With the forces f on the coordinates, the body moves by M q'' + D q' + K q = f.  A scene adds its own damping to D.
    A coordinate without a node is a modal amplitude (Craig-Bampton), which is zero in every rigid motion.

    Raises InputError in these cases:

    - The matrices are not square, of one size, finite and symmetric.
    - A diagonal entry of M or K is not positive, or D gives energy to some motion.
    - `node`, `direction` or `groups` refer to a node or direction that does not exist.
    - The matrices do not fit the nodes (`pmr.files.fit.misfit`).
    """

    M: sp.csr_matrix  #: (n, n), symmetric, in SI units; without supports that slide
    K: sp.csr_matrix  #: (n, n), symmetric, in SI units; without supports that slide
    points: Array  #: (N, 3), m: positions of the nodes
    #: (n,) node of each coordinate, from 0, or `MODAL`; nodes are fixed along directions without a coordinate
    node: Indices
    direction: Indices  #: (n,) direction of each coordinate, an index of `DIRECTIONS`, or `MODAL`
    groups: Mapping[str, Indices] = field(default_factory=dict)  #: (g,) nodes by group: faces for pads, tail and tip
    source: str = "matrices"  #: Name of the file, for messages
    D: sp.csr_matrix | None = None  #: (n, n), symmetric, in SI units: viscous damping; None: none
    #: (h, 6) matrix on rigid motions about the origin: its product with a motion is zero if and only if supports and
    #: springs in K leave the motion free
    held: Array = field(init=False, repr=False, compare=False)
    #: whether all nodes are near supports that are included in K, so that points and axes can't be checked against K
    unchecked: bool = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check all fields, and find the rigid motions that supports and springs in K hold."""
        n = self.K.shape[0]
        for name, A in (("K", self.K), ("M", self.M), *([] if self.D is None else [("D", self.D)])):
            self._check_matrix(name, A, n)
        if self.points.ndim != 2 or self.points.shape[1] != 3 or not np.isfinite(self.points).all():
            raise self._refusal("points", None, f"finite (N, 3) coordinates are allowed, not {self.points.shape}")
        for name, values in (("node", self.node), ("direction", self.direction)):
            if values.shape != (n,):
                raise self._refusal(name, len(values), f"one for each of the {n} coordinates is allowed")
        for name, least, most, values in (
            ("node", 0, len(self.points) - 1, self.node),
            ("direction", 0, len(DIRECTIONS) - 1, self.direction),
        ):
            outside = values[((values < least) | (values > most)) & ~self.modal]
            if outside.size:
                raise self._refusal(name, int(outside[0]), f"{least} to {most} is allowed")
        at = np.flatnonzero(~self.modal)
        if not len(at):
            raise self._refusal("node", None, "coordinates of nodes are allowed, not modal amplitudes alone")
        if len(np.unique(self.node[at] * len(DIRECTIONS) + self.direction[at])) != len(at):
            raise self._refusal("node", None, "one coordinate for each node and direction is allowed")
        for name, nodes in self.groups.items():
            if not is_name(name):
                raise self._refusal("groups", name, NAMED)
            if not nodes.size or nodes.min() < 0 or nodes.max() >= len(self.points):
                raise self._refusal(
                    f"groups.{name}", None, f"at least one node, 0 to {len(self.points) - 1}, is allowed"
                )
        M, K = (self.M, self.K) if len(at) == n else (self.M[at][:, at], self.K[at][:, at])
        body = Resistance(K, self.points, self.node[at], self.direction[at])
        checked = misfit(M, body) or (next(indefinite(self.M, self.K), None) if len(at) < n else None)
        if reason := checked or (None if self.D is None else negative_damping(self.D)):
            raise self._refusal(reason[0], None, reason[1])
        object.__setattr__(self, "held", body.held_motions())
        used = np.unique(body.node)
        object.__setattr__(self, "unchecked", bool(body.near(body.missing_displacements.any(axis=1))[used].all()))

    def without_condensed_nodes(self) -> GivenMatrices:
        """Return the body without nodes that have no coordinate; unchanged if K holds a rigid motion.

        A warning tells the number of these nodes.  If K leaves all rigid motions free, nothing holds these nodes: such
        nodes are condensed, or belong to no element.
        """
        has = np.isin(np.arange(len(self.points)), self.node[~self.modal])
        if len(self.held) or has.all():
            return self
        logger.warning(
            "%s: %d nodes have no coordinate, but K holds no rigid motion: they are taken as condensed and left out",
            self.source,
            np.count_nonzero(~has),
        )
        number = np.cumsum(has) - 1
        groups = {name: number[nodes[has[nodes]]] for name, nodes in self.groups.items() if has[nodes].any()}
        node = np.where(self.modal, MODAL, number[self.node])
        return replace(self, points=self.points[has], node=node, groups=groups)

    @property
    def modal(self) -> Mask:
        """Mask (n,) of the coordinates that have no node, such as amplitudes of fixed-interface modes."""
        return (self.node == MODAL) & (self.direction == MODAL)

    def rigid_motions(self) -> Array:
        """Coordinates (n, 6) under the six rigid motions of the nodes.

        The motions are unit translations along x, y, z, and unit rotations about axes through the origin along x, y, z.
        Modal amplitudes are zero.
        """
        return np.where(self.modal[:, None], 0.0, rigid_motions(self.points[self.node], self.direction))

    @property
    def size(self) -> int:
        """Number of coordinates n."""
        return int(self.K.shape[0])

    @cached_property
    def _inertia(self) -> Array:
        """Inertia R^T M R (6, 6) under the six rigid motions R about the origin."""
        R = self.rigid_motions()
        return np.asarray(R.T @ (self.M @ R))

    @property
    def lacks(self) -> bool:
        """Whether some node has no coordinate for its displacement along some axis.

        The node may stand on a support, or belong to no element.
        """
        return int(np.isin(self.direction, (0, 1, 2)).sum()) < 3 * len(self.points)

    @property
    def mass(self) -> float:
        """Total mass in kg, the mean over three axes; mass at displacements without a coordinate is not included."""
        return float(np.trace(self._inertia[:3, :3]) / 3.0)

    @property
    def centre(self) -> Array:
        """Centre of mass (3,) in m."""
        return centre_of_mass(self._inertia)

    def save(self, path: str | Path) -> Path:
        """Write matrices, points and groups to an npz file without pickle; return its path."""
        arrays: dict[str, Any] = {"points": self.points, "node": self.node, "direction": self.direction}
        for name, A in (("M", self.M), ("K", self.K), *([] if self.D is None else [("D", self.D)])):
            arrays |= {f"{name}.{part}": getattr(A, part) for part in _PARTS}
        arrays |= {f"groups.{k}": nodes for k, nodes in enumerate(self.groups.values())}
        version = 1 if self.D is None else FORMAT_VERSION
        npz.write(Path(path), arrays, {"format": FORMAT, "version": version, "groups": list(self.groups)})
        return Path(path)

    @classmethod
    def load(cls, path: Path) -> GivenMatrices:
        """Return the matrices from a file that `save` wrote.

        Raises InputError if the file is missing or of another kind, or if its content is not valid.
        """
        if not isfile(path):
            raise InputError(str(path), "", None, f"{missing_file_reason(path)}; pmr matrices writes one")
        try:
            stored = npz.read(path)
            header = npz.pop_header(stored)
            if header.get("format") != FORMAT or int(header["version"]) > FORMAT_VERSION:
                raise InputError(str(path), "", None, f"{FORMAT} of version {FORMAT_VERSION} or less is allowed")
            n = len(stored["node"])
            matrices = {
                name: sp.csr_matrix(tuple(stored[f"{name}.{part}"] for part in _PARTS), (n, n))
                for name in ("M", "K", *(["D"] if int(header["version"]) > 1 else []))
            }
            for A in matrices.values():
                A.check_format()
            groups = {str(name): whole_numbers(stored[f"groups.{k}"]) for k, name in enumerate(header["groups"])}
            points = stored["points"].astype(float)
            node, direction = (whole_numbers(stored[name]) for name in ("node", "direction"))
        except InputError:
            raise
        except (KeyError, ValueError, TypeError, IndexError, AttributeError, OverflowError, RecursionError):
            allowed = "matrices that pmr wrote are allowed: these are damaged or of another kind"
            raise InputError(str(path), "", None, allowed) from None
        M, K = matrices["M"], matrices["K"]
        return cls(M, K, points, node, direction, groups, str(path), matrices.get("D"))

    def _check_matrix(self, name: str, A: sp.csr_matrix, n: int) -> None:
        """Raise an InputError unless the matrix A is (n, n) with n > 0, finite and symmetric with a positive diagonal.

        Asymmetry is allowed up to the share `SYMMETRY` of the largest entry.  The diagonal of D is not checked here;
        `negative_damping` looks at its eigenvalues.  `name` is the name of the matrix in the message.
        """
        if A.shape != (n, n) or n == 0:
            raise self._refusal(name, list(A.shape), f"a square matrix of the size of K, {n}, is allowed")
        if not np.isfinite(A.data).all():
            row = int(np.repeat(np.arange(n), np.diff(A.indptr))[~np.isfinite(A.data)][0])
            raise self._refusal(name, None, f"finite entries are allowed; row {row + 1} has another")
        asymmetry = float(np.abs(A - A.T).max())
        if asymmetry > SYMMETRY * np.abs(A.data).max(initial=0.0):
            raise self._refusal(
                name, None, f"a symmetric matrix is allowed; it differs by {asymmetry:.3g} from its own"
            )
        diagonal = A.diagonal()
        if name != "D" and diagonal.min() <= 0.0:
            at = int(np.argmin(diagonal))
            what = "mass" if name == "M" else "stiffness"
            allowed = f"positive diagonal entries are allowed: coordinate {at + 1} has none, and no {what}"
            raise self._refusal(name, float(diagonal[at]), allowed)

    def _refusal(self, key: str, value: Any, allowed: str) -> InputError:
        """Return an InputError about the entry `key` of the matrices' file, with its value and what is allowed."""
        return InputError(self.source, key, value, allowed)


def from_matrices(
    M: Any,
    K: Any,
    points: ArrayLike,
    groups: Mapping[str, ArrayLike] | None = None,
    node: ArrayLike | None = None,
    direction: ArrayLike | None = None,
    D: Any = None,
) -> GivenMatrices:
    """Check mass, stiffness and damping from another program and return these matrices as a body.

    The method `save` of the body writes a file that scenes can name.  Nodes without coordinates are left out, with a
    warning, if K leaves all rigid motions free (`GivenMatrices.without_condensed_nodes`).

    Parameters
    ----------
    M, K : (n, n) arrays or sparse matrices
        Mass and stiffness, symmetric, in SI units.
    points : (N, 3) array, m
        Positions of the nodes, with z upwards and the body's axis along x.
    groups : mapping of name to sequence of int, optional
        Nodes of the faces that pads slide on, and of tail and tip: numbers from 0, or a mask of N truth values.
    node, direction : sequences of int, optional
        Node and direction of each coordinate, the direction as 0 to 5 for x, y, z, rx, ry, rz; -1 and -1 for a modal
        amplitude of a superelement.  If they are not given, all nodes have the same three or six coordinates, node by
        node.
    D : (n, n) array or sparse matrix, optional
        Viscous damping, symmetric, in SI units; the damping of a scene is added to it.

    Raises InputError in the cases of `GivenMatrices`, and for values of another shape or kind.
    """
    at = _read_argument("points", points, lambda A: np.asarray(A, dtype=float))
    M, K = (_read_argument(name, A, _real_sparse) for name, A in (("M", M), ("K", K)))
    n, count = K.shape[0], max(len(at), 1)
    if node is None and direction is None:
        each = n // count
        if each not in (3, 6) or each * count != n:
            allowed = f"three or six times the {len(at)} nodes is allowed, or node and direction of each coordinate"
            raise InputError("matrices", "K", n, allowed)
        node, direction = np.repeat(np.arange(count), each), np.tile(np.arange(each), count)
    if node is None or direction is None:
        raise InputError("matrices", "node", None, "node and direction are allowed together")
    named = {
        name: _read_argument(f"groups.{name}", members, lambda A: _group_members(np.asarray(A), len(at)))
        for name, members in (groups or {}).items()
    }
    whose, along = (_read_argument(name, A, whole_numbers) for name, A in (("node", node), ("direction", direction)))
    damping = None if D is None else _read_argument("D", D, _real_sparse)
    return GivenMatrices(M, K, at, whose, along, named, D=damping).without_condensed_nodes()


def whole_numbers(values: ArrayLike) -> Indices:
    """Return values (n,) as integers; raises ValueError if a value is not a whole number, or is a truth value."""
    values = np.asarray(values)
    integers = values.astype(np.int64)
    if values.dtype.kind not in "iuf" or values.ndim != 1 or not np.array_equal(integers, values):
        raise ValueError("a list of whole numbers is allowed")
    return integers


def _group_members(values: NDArray[Any], count: int) -> Indices:
    """Return the numbers (k,) of nodes from 0, ascending and each once.

    `values` are the numbers, or a mask of `count` truth values.  Raises ValueError for a mask of another length and for
    anything but whole numbers.
    """
    if values.dtype == bool:
        if values.shape != (count,):
            raise ValueError(f"a mask of {count} truth values is allowed, not of {values.shape}")
        return np.flatnonzero(values)
    return np.unique(whole_numbers(values))


def _real_sparse(A: Any) -> sp.csr_matrix:
    """Return a matrix as a sparse matrix of floats; raises ValueError if the matrix is not real."""
    matrix = sp.csr_matrix(A)
    if matrix.dtype.kind not in "iuf":
        raise ValueError(f"real numbers are allowed, not {matrix.dtype}")
    return matrix.astype(float)


def _read_argument(key: str, values: Any, read: Callable[[Any], Any]) -> Any:
    """Return read(values); raises InputError with the key `key` if this call fails."""
    try:
        with np.errstate(invalid="ignore"):  # casts are checked, so NumPy need not warn of them
            return read(values)
    except (ValueError, TypeError, OverflowError) as error:
        raise InputError("matrices", key, None, str(error)) from None
