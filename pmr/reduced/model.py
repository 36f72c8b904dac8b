r"""The reduced model: a small self-contained file that simulates without any finite-element library.

.. math::
    M \ddot p + D \dot p + K p + C(s)^T \lambda = B f(t), \qquad
    C(s)\, p + H(s) f - (G(s) + 1/k)\, \lambda = 0, \qquad y = O p + W f - X(s) \lambda

with r generalised coordinates p.  For mass-normalised modes the columns of V carry 1/sqrt(kg), so p is in
m sqrt(kg); for orthonormal POD vectors V is dimensionless and p carries the unit of the coordinates (m, rad).
G, H, W and X are those of the residual flexibility (`pmr.reduced.flexibility`) and vanish without one; 1/k is the pads'
compliance.  lambda is in N: with rows that measure a displacement in m, -C^T lambda is the force of the sliders on
the body.  A row that only pushes holds with its clearance on the right-hand side and lambda >= 0, or is open with
lambda = 0 (docs/pads.md).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PPoly

from pmr.constraints.polynomials import columns, contributions, evaluate, select_rows, times
from pmr.errors import InputError
from pmr.files import jsonfile
from pmr.files.npz import read, write
from pmr.files.whole import replaced
from pmr.reduced.damping import Rayleigh
from pmr.reduced.enrichment import EnrichmentModes
from pmr.reduced.flexibility import Flexibility
from pmr.reduced.soundness import contradiction

Array = NDArray[np.float64]
#: Numbers that rows at several steps may have together.
ENTRIES = 2**19
FORMAT = "pmr-reduced-model"
FORMAT_VERSION = 4
_MATRICES = ("M", "D", "K", "B", "outputs")
_NAMES = ("input_names", "row_names", "left_out", "output_names", "output_units")  # the last two since version 4


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
        What is observed at `output_positions`: transverse displacements in m, in space forces of pads too.
    rows : PPoly with values (m, r)
        C(s), exact between its breaks; s in m.
    input_names, row_names : tuples of str
    output_positions : (o,) array, m
    output_names, output_units : tuples of str
        What each output is, and whether it is in m, rad or N; empty: all are displacements.
    left_out : tuple of str
        Rows that the basis satisfies identically (its vectors vanish there): they would make the system singular.
    provenance : dict
        How the model came about: scene hash, basis, versions.
    pads : (m,) array, m/N, or None
        Compliance 1/k of each row's pad; None where all are rigid.
    flexibility : Flexibility, optional
        What the coordinates leave out, quasi-static.
    enrichment : EnrichmentModes, optional
        The first modes left out, with which the error is estimated (`pmr.compare.estimate`).
    clearance : (m,) array, m, or None
        How far a row that only pushes lets the body go, NaN where it holds both ways; None where all do.
    rayleigh : Rayleigh, optional
        What D is made of, where it is Rayleigh's.
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
    output_names: tuple[str, ...] = ()
    output_units: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    provenance: dict[str, Any] = field(default_factory=dict)
    pads: Array | None = None
    flexibility: Flexibility | None = None
    enrichment: EnrichmentModes | None = None
    clearance: Array | None = None
    rayleigh: Rayleigh | None = None

    @property
    def size(self) -> int:
        """Number of generalised coordinates r."""
        return len(self.M)

    @property
    def row_compliance(self) -> Array:
        """1/k of each row's pad, (m,) in m/N."""
        return np.zeros(len(self.row_names)) if self.pads is None else self.pads

    @property
    def row_clearance(self) -> Array:
        """Clearance of each row that only pushes, (m,) in m; NaN where it holds both ways."""
        return np.full(len(self.row_names), np.nan) if self.clearance is None else self.clearance

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
        m = len(self.row_names)
        found, block = np.empty((len(s), m)), max(1, ENTRIES // max(1, m * self.size))
        for first in range(0, len(s), block):  # the rows at many steps take far more than what comes of them
            part = slice(first, first + block)
            found[part] = np.einsum("tmr,tr->tm", self.C(s[part], derivative), q[part])
        return found

    def rows_on(self, V: Array) -> PPoly:
        """C(s) V as a piecewise polynomial with values (m, k), for V (r, k)."""
        return times(self.rows, V)

    def with_rows(self, numbers: Sequence[int]) -> ReducedModel:
        """The model with none but these of its rows, which no residual flexibility may know."""
        chosen = list(numbers)
        return replace(
            self,
            rows=select_rows(self.rows, chosen),
            row_names=tuple(self.row_names[i] for i in chosen),
            pads=None if self.pads is None else self.pads[chosen],
            clearance=None if self.clearance is None else self.clearance[chosen],
        )

    def leading(self, coordinates: int) -> ReducedModel:
        """The model on the first `coordinates` vectors of its basis: POD bases are nested.

        Raises
        ------
        ValueError
            If it has a residual flexibility, which belongs to all of its coordinates.
        """
        if self.flexibility is not None:
            raise ValueError("a residual flexibility belongs to all coordinates of its model")
        r = coordinates
        return replace(
            self,
            M=np.ascontiguousarray(self.M[:r, :r]),
            D=np.ascontiguousarray(self.D[:r, :r]),
            K=np.ascontiguousarray(self.K[:r, :r]),
            B=self.B[:r],
            outputs=np.ascontiguousarray(self.outputs[:, :r]),
            rows=columns(self.rows, slice(r)),
        )

    def save(self, path: str | Path) -> Path:
        """Write the model as npz, not compressed, with a JSON header; nothing in it is pickled."""
        path = Path(path)
        header = {
            "format": FORMAT,
            "version": FORMAT_VERSION,
            "units": "SI; coordinates as the basis in provenance states",
            "input_names": self.input_names,
            "row_names": self.row_names,
            "left_out": self.left_out,
            "output_names": self.output_names,
            "output_units": self.output_units,
            "provenance": self.provenance,
            "rayleigh": None if self.rayleigh is None else [self.rayleigh.alpha, self.rayleigh.beta],
        }
        arrays = {name: getattr(self, name) for name in _MATRICES}
        arrays |= {"pads": self.row_compliance, "clearance": self.row_clearance}
        if self.flexibility is not None:
            arrays |= self.flexibility.arrays()
        if self.enrichment is not None:
            arrays |= self.enrichment.arrays()
        arrays |= {"header": np.array(jsonfile.text(header)), "output_positions": self.output_positions}
        arrays |= {"rows_breaks": self.rows.x, "rows_coefficients": self.rows.c}
        with replaced(path) as part:
            write(part, arrays)
        return path

    @classmethod
    def load(cls, path: str | Path) -> ReducedModel:
        """Read a model that `save` wrote.

        Raises
        ------
        InputError
            If the file is missing, is no reduced model, claims to hold more than it does, or was written by a later
            format.
        """
        path = Path(path)
        if not path.is_file():
            raise InputError(str(path), "", None, "no such file; `pmr run` writes reduced.npz")
        try:
            found = read(path)
            header = json.loads(str(found.pop("header")))
            if header["format"] != FORMAT:
                raise InputError(str(path), "format", header["format"], f"{FORMAT!r} is allowed")
            if int(header["version"]) > FORMAT_VERSION:
                raise InputError(str(path), "version", header["version"], f"at most {FORMAT_VERSION} can be read")
            data = {name: np.asarray(array, dtype=float) for name, array in found.items()}
            parts: dict[str, Any] = {name: data[name] for name in _MATRICES}
            parts |= {name: _names(header.get(name, ())) for name in _NAMES}
            model = cls(
                **parts,
                rows=PPoly(data["rows_coefficients"], data["rows_breaks"]),
                output_positions=data["output_positions"],
                pads=data.get("pads"),  # since version 2
                flexibility=Flexibility.from_arrays(data),
                enrichment=EnrichmentModes.from_arrays(data),  # since version 3
                clearance=data.get("clearance"),  # since version 4
                provenance=_table(header["provenance"]),
                rayleigh=_rayleigh(header.get("rayleigh")),
            )
            wrong = contradiction(model)
        except (KeyError, ValueError, TypeError, IndexError, AttributeError, OverflowError, RecursionError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError(str(path), "", None, f"not a reduced model written by pmr ({error})") from None
        if wrong:
            raise InputError(str(path), "", None, f"not a sound reduced model: {wrong}")
        return model


def _names(found: Any) -> tuple[str, ...]:
    if not isinstance(found, list | tuple) or not all(isinstance(name, str) for name in found):
        raise TypeError(f"a list of names is allowed, not {found!r:.60}")
    return tuple(found)


def _table(found: Any) -> dict[str, Any]:
    if not isinstance(found, dict):
        raise TypeError(f"a table is allowed for provenance, not {found!r:.60}")
    return found


def satisfied_rows(C: PPoly, tolerance: float = 1e-10) -> list[int]:
    """Numbers of the rows that a basis satisfies identically.

    Those are the rows none of whose coefficients, times its interval to the matching power, exceeds `tolerance` times
    the largest one of all rows; `tolerance` is the round-off to expect in the basis.
    """
    magnitude = np.abs(contributions(C)).max(axis=(0, 1, 3))
    return np.flatnonzero(magnitude <= tolerance * magnitude.max()).tolist()


def _rayleigh(pair: Any) -> Rayleigh | None:
    return None if pair is None else Rayleigh(*map(float, pair))
