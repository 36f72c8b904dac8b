r"""The reduced model: a small self-contained file that simulates without any finite-element library.

.. math::
    M \ddot p + D \dot p + K p + C(s)^T \lambda = B f(t), \qquad
    C(s)\, p + H(s) f - (G(s) + 1/k)\, \lambda = 0, \qquad y = O p + W f - X(s) \lambda

with r generalised coordinates p.  For mass-normalised modes the columns of V carry 1/sqrt(kg), so p is in
m sqrt(kg); for orthonormal POD vectors V is dimensionless and p carries the unit of the coordinates (m, rad).
G, H, W and X are those of the residual flexibility (`pmr.flexibility`) and vanish without one; 1/k is the pads'
compliance.  lambda is in N: with rows that measure a displacement in m, -C^T lambda is the force of the sliders on
the body.  A row that only pushes holds with its clearance on the right-hand side and lambda >= 0, or is open with
lambda = 0 (docs/pads.md).
"""

from __future__ import annotations

import json
import zipfile
import zlib
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PPoly

from pmr.companions import Companions
from pmr.errors import InputError
from pmr.flexibility import Flexibility
from pmr.sliding import contributions, evaluate

Array = NDArray[np.float64]
FORMAT = "pmr-reduced-model"
FORMAT_VERSION = 4
_MATRICES = ("M", "D", "K", "B", "outputs")


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
    companions : Companions, optional
        The first modes left out, with which the error is estimated (`pmr.estimate`).
    clearance : (m,) array, m, or None
        How far a row that only pushes lets the body go, NaN where it holds both ways; None where all do.
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
    companions: Companions | None = None
    clearance: Array | None = None

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
        return np.einsum("tmr,tr->tm", self.C(s, derivative), q)

    def rows_on(self, V: Array) -> PPoly:
        """C(s) V as a piecewise polynomial with values (m, k), for V (r, k)."""
        return PPoly(np.ascontiguousarray(self.rows.c @ V), self.rows.x)

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
            rows=PPoly(np.ascontiguousarray(self.rows.c[..., :r]), self.rows.x),
        )

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
            "output_names": self.output_names,
            "output_units": self.output_units,
            "provenance": self.provenance,
        }
        arrays = {name: getattr(self, name) for name in _MATRICES}
        arrays |= {"pads": self.row_compliance, "clearance": self.row_clearance}
        if self.flexibility is not None:
            arrays |= self.flexibility.arrays()
        if self.companions is not None:
            arrays |= self.companions.arrays()
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
                    pads=np.asarray(data["pads"], dtype=float) if "pads" in data else None,  # since version 2
                    flexibility=Flexibility.from_arrays(data),
                    companions=Companions.from_arrays(data),  # since version 3
                    clearance=np.asarray(data["clearance"], float) if "clearance" in data else None,  # since version 4
                    left_out=tuple(header["left_out"]),
                    output_names=tuple(header.get("output_names", ())),  # since version 4
                    output_units=tuple(header.get("output_units", ())),
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
        if not np.all(np.diff(self.rows.x) > 0.0):
            return "the rows' breaks do not increase"
        if self.row_compliance.shape != (m,) or not np.all(self.row_compliance >= 0.0):
            return f"pads has shape {self.row_compliance.shape} or negative values, {(m,)} from 0 on are allowed"
        clearance = self.row_clearance
        if clearance.shape != (m,) or not np.all(np.isnan(clearance) | (clearance >= 0.0) & np.isfinite(clearance)):
            return f"clearance has shape {clearance.shape} or values that are no lengths, {(m,)} from 0 on are allowed"
        parts = [part.contradiction(m, i, o) for part in (self.flexibility, self.companions) if part is not None]
        return next((wrong for wrong in parts if wrong), None)


def satisfied_rows(C: PPoly, tolerance: float = 1e-10) -> list[int]:
    """Numbers of the rows that a basis satisfies identically.

    Those are the rows none of whose coefficients, times its interval to the matching power, exceeds `tolerance` times
    the largest one of all rows; `tolerance` is the round-off to expect in the basis.
    """
    magnitude = np.abs(contributions(C)).max(axis=(0, 1, 3))
    return np.flatnonzero(magnitude <= tolerance * magnitude.max()).tolist()
