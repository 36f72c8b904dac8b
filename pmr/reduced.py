r"""The reduced model: a small self-contained file that simulates without any finite-element library.

.. math::
    M \ddot p + D \dot p + K p + C(s)^T \lambda = B f(t), \qquad C(s)\, p = 0, \qquad y = O p

with r generalised coordinates p.  For mass-normalised modes the columns of V carry 1/sqrt(kg), so p is in
m sqrt(kg); for orthonormal POD vectors V is dimensionless and p carries the unit of the coordinates (m, rad).
lambda is in N: with rows that measure a displacement in m, -C^T lambda is the force of the sliders on the body.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PPoly

from pmr.errors import InputError
from pmr.sliding import Rows, evaluate

Array = NDArray[np.float64]
FORMAT = "pmr-reduced-model"
FORMAT_VERSION = 1
_MATRICES = ("M", "D", "K", "B", "outputs")


class SlidingBody(Protocol):
    """What a simulator asks of a body: constant matrices and a few rows that move with s.

    `ReducedModel` is one (dense), `FullBody` another (sparse).  Shapes: M, D, K (n, n), B (n, i), outputs (o, n),
    C(s) (m, n).
    """

    @property
    def M(self) -> Any: ...
    @property
    def D(self) -> Any: ...
    @property
    def K(self) -> Any: ...
    @property
    def B(self) -> Any: ...
    @property
    def outputs(self) -> Any: ...
    @property
    def input_names(self) -> tuple[str, ...]: ...
    @property
    def row_names(self) -> tuple[str, ...]: ...
    @property
    def domain(self) -> tuple[float, float]: ...
    @property
    def size(self) -> int: ...
    def C(self, s: float, derivative: int = 0) -> Any:
        """Constraint rows (m, n) at the path coordinate s in m, or their derivative with respect to s."""
        ...

    @property
    def output_positions(self) -> Array: ...
    @property
    def moving(self) -> list[int]:
        """Numbers of the rows that depend on s: the sliders."""
        ...

    @property
    def held(self) -> dict[int, int]:
        """Rows that hold one coordinate and do nothing else: number of the row to that of the coordinate."""
        ...

    def dense_rows(self, s: Array) -> Array:
        """C(s) (T, m, n) at several path coordinates (T,), dense."""
        ...

    def apply_rows(self, s: Array, q: Array, derivative: int = 0) -> Array:
        """C(s) q (T, m) along a trajectory, s (T,) and q (T, n); or with the derivative of C."""
        ...


@dataclass(frozen=True)
class FullBody:
    """The full model on one process, sparse: what the full-order reference simulates."""

    M: sp.csr_matrix
    D: sp.csr_matrix
    K: sp.csr_matrix
    B: Array
    outputs: sp.csr_matrix
    rows: Rows
    input_names: tuple[str, ...]
    output_positions: Array

    @property
    def size(self) -> int:
        return int(self.M.shape[0])

    @property
    def row_names(self) -> tuple[str, ...]:
        return self.rows.names

    @property
    def domain(self) -> tuple[float, float]:
        return self.rows.domain

    def C(self, s: float, derivative: int = 0) -> sp.csr_matrix:
        """Rows (m, n) at s in m, or their derivative with respect to s."""
        return self.rows.at(s, derivative)

    @property
    def moving(self) -> list[int]:
        """Numbers of the rows that depend on s: the sliders."""
        return [i for i, row in enumerate(self.rows.rows) if row.moves]

    @property
    def held(self) -> dict[int, int]:
        """Rows of supports on nodes: number of the row to that of the coordinate it holds."""
        return {i: row.held for i, row in enumerate(self.rows.rows) if row.held is not None}

    def dense_rows(self, s: Array) -> Array:
        """C(s) (T, m, n) at several path coordinates (T,): for a few at a time."""
        result = np.zeros((len(s), len(self.rows.rows), self.size))
        for i, row in enumerate(self.rows.rows):
            dofs, entries = row.at(s)
            np.put_along_axis(result[:, i], dofs, entries, axis=1)
        return result

    def apply_rows(self, s: Array, q: Array, derivative: int = 0) -> Array:
        """C(s) q (T, m) along a trajectory, or with the derivative of C."""
        return np.stack([row.apply(s, q, derivative) for row in self.rows.rows], axis=1)


@dataclass(frozen=True)
class ReducedModel:
    """Galerkin projection of a sliding body on a global basis.

    Attributes
    ----------
    M, D, K : (r, r) arrays
        Symmetric; units follow from the basis (module docstring).
    B : (r, i) array
        One column an input; inputs are forces in N (or moments in N m).
    outputs : (o, r) array
        Transverse displacement in m at `output_positions`.
    rows : PPoly with values (m, r)
        C(s), exact between its breaks; s in m.
    input_names, row_names : tuples of str
    output_positions : (o,) array, m
    left_out : tuple of str
        Rows that the basis satisfies identically (its vectors vanish there): they would make the system singular.
    provenance : dict
        How the model came about: scene hash, basis, versions.
    """

    M: Array
    D: Array
    K: Array
    B: Array
    outputs: Array
    rows: PPoly
    input_names: tuple[str, ...]
    row_names: tuple[str, ...]
    output_positions: Array
    left_out: tuple[str, ...] = ()
    provenance: dict[str, Any] = field(default_factory=dict)

    @property
    def size(self) -> int:
        """Number of generalised coordinates r."""
        return len(self.M)

    @property
    def domain(self) -> tuple[float, float]:
        """Path coordinates for which the rows are defined, in m."""
        return float(self.rows.x[0]), float(self.rows.x[-1])

    def C(self, s: ArrayLike, derivative: int = 0) -> Array:
        """Rows (m, r) at s in m (or (T, m, r) at s (T,)), or their derivative with respect to s.

        Raises
        ------
        ValueError
            If s lies outside `domain`.
        """
        return evaluate(self.rows, s, derivative, what=", ".join(self.row_names))

    @property
    def moving(self) -> list[int]:
        """Numbers of the rows that depend on s: the sliders."""
        return np.flatnonzero(np.any(self.rows.c[:-1] != 0.0, axis=(0, 1, 3))).tolist()

    @property
    def held(self) -> dict[int, int]:
        """None: all rows of a reduced model are treated alike."""
        return {}

    def dense_rows(self, s: Array) -> Array:
        """C(s) (T, m, r) at several path coordinates (T,)."""
        return self.C(s)

    def apply_rows(self, s: Array, q: Array, derivative: int = 0) -> Array:
        """C(s) q (T, m) along a trajectory, or with the derivative of C."""
        return np.einsum("tmr,tr->tm", self.C(s, derivative), q)

    def save(self, path: str | Path) -> Path:
        """Write the model as npz with a JSON header; nothing in it is pickled."""
        path = Path(path)
        header = {
            "format": FORMAT,
            "version": FORMAT_VERSION,
            "units": "SI; coordinates as the basis in provenance states",
            "input_names": self.input_names,
            "row_names": self.row_names,
            "left_out": self.left_out,
            "provenance": self.provenance,
        }
        arrays = {name: getattr(self, name) for name in _MATRICES}
        with path.open("wb") as file:
            np.savez(
                file,
                header=np.array(json.dumps(header)),
                output_positions=self.output_positions,
                rows_breaks=self.rows.x,
                rows_coefficients=self.rows.c,
                **arrays,
            )
        return path

    @classmethod
    def load(cls, path: str | Path) -> ReducedModel:
        """Read a model that `save` wrote.

        Raises
        ------
        InputError
            If the file is missing, is no reduced model, or was written by a later format.
        """
        path = Path(path)
        if not path.is_file():
            raise InputError(str(path), "", None, "no such file; `pmr run` writes reduced.npz")
        if not zipfile.is_zipfile(path):
            raise InputError(str(path), "", None, "not a reduced model written by pmr")
        try:
            with np.load(path, allow_pickle=False) as data:
                header = json.loads(str(data["header"]))
                if header["format"] != FORMAT:
                    raise InputError(str(path), "format", header["format"], f"{FORMAT!r} is allowed")
                if int(header["version"]) > FORMAT_VERSION:
                    raise InputError(str(path), "version", header["version"], f"at most {FORMAT_VERSION} can be read")
                model = cls(
                    **{name: np.asarray(data[name], dtype=float) for name in _MATRICES},
                    rows=PPoly(data["rows_coefficients"], data["rows_breaks"]),
                    input_names=tuple(header["input_names"]),
                    row_names=tuple(header["row_names"]),
                    output_positions=np.asarray(data["output_positions"], dtype=float),
                    left_out=tuple(header["left_out"]),
                    provenance=dict(header["provenance"]),
                )
        except (KeyError, ValueError, TypeError, AttributeError, OSError, zipfile.BadZipFile, zlib.error) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(str(path), "", None, f"not a reduced model written by pmr ({error})") from None
        wrong = model.contradiction()
        if wrong:
            raise InputError(str(path), "", None, f"not a sound reduced model: {wrong}")
        return model

    def contradiction(self) -> str | None:
        """What is wrong with the arrays, in words; None where shapes agree, breaks increase and all is finite."""
        r, i, o, m = len(self.M), len(self.input_names), len(self.output_positions), len(self.row_names)
        shapes = {"M": (r, r), "D": (r, r), "K": (r, r), "B": (r, i), "outputs": (o, r)}
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array.shape != shape:
                return f"{name} has shape {array.shape}, {shape} is allowed"
            if not np.isfinite(array).all():
                return f"{name} is not finite"
        if self.rows.c.shape[2:] != (m, r) or not np.isfinite(self.rows.c).all():
            return f"the rows have shape {self.rows.c.shape[2:]} or are not finite, {(m, r)} is allowed"
        return None if np.all(np.diff(self.rows.x) > 0.0) else "the rows' breaks do not increase"


@dataclass(frozen=True)
class Trajectory:
    """Coordinates of a simulated body over time.

    Attributes
    ----------
    t : (T,) array, s
    q, v : (T, n) arrays
        Coordinates and their rates; n = r for a reduced model.
    multipliers : (T, m) array, N
        lambda; the sliders push with -lambda on the body.
    s : (T,) array, m
        Path coordinate.
    seconds : float
        Wall time of the solver alone.
    """

    t: Array
    q: Array
    v: Array
    multipliers: Array
    s: Array
    seconds: float


def satisfied_rows(C: PPoly, tolerance: float = 1e-10) -> list[int]:
    """Numbers of the rows that a basis satisfies identically.

    Those are the rows none of whose coefficients, times its interval to the matching power, exceeds `tolerance` times
    the largest one of all rows; `tolerance` is the round-off to expect in the basis.
    """
    size = np.diff(C.x)[None, :] ** np.arange(len(C.c) - 1, -1, -1)[:, None]
    magnitude = np.abs(C.c * size[:, :, None, None]).max(axis=(0, 1, 3))
    return np.flatnonzero(magnitude <= tolerance * magnitude.max()).tolist()
