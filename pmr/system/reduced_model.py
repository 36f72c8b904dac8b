r"""Reduced model: a small self-contained file that can be simulated without any finite-element library.

.. math::
    M \ddot p + D \dot p + K p + C(s)^T \lambda = B f(t), \qquad
    C(s)\, p + H(s) f - (G(s) + 1/k)\, \lambda = 0, \qquad y = O p + W f - X(s) \lambda

with r generalised coordinates p, their rows C(s), the outputs y by O, and the loads f.  For mass-normalised modes the
columns of the basis V carry 1/sqrt(kg), so p is in m sqrt(kg); for orthonormal POD vectors V is dimensionless and p
carries the unit of the coordinates (m, rad).  G, H, W and X belong to the residual flexibility (`pmr.system.carriers`)
and are zero without one; 1/k is the pads' compliance.  The multipliers lambda are in N: with rows that measure a
displacement in m, -C^T lambda is the force of the sliders on the body.  A row that only pushes is either closed, with
its clearance on the right-hand side of its equation and lambda >= 0, or open, with lambda = 0 (docs/pads_theory.md).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from os.path import isfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import PPoly

from pmr.errors import InputError, missing_file_reason, overview
from pmr.files import npz
from pmr.files.arrays import Array, Indices
from pmr.scene.signals.base import Interval
from pmr.system.body_matrices import (
    CONSTANT,
    LINEAR,
    Rayleigh,
    Reactions,
    describe_asymmetry,
    describe_misfit,
    describe_misshapen,
    describe_names,
)
from pmr.system.carriers import (
    CarrierRows,
    EnrichmentModes,
    Flexibility,
    TablesOnDemand,
    describe_fault,
    pack_model,
    unpack_model,
)
from pmr.system.polynomials import (
    apply_table,
    evaluate,
    multiply_matrix,
    power_contributions,
    select_columns,
    select_rows,
)

FORMAT = "pmr-reduced-model"
FORMAT_VERSION = 6
#: Errors that NumPy and this module raise for files with wrong content.
READING = (KeyError, ValueError, TypeError, IndexError, AttributeError, OverflowError, RecursionError)
_NAMES = ("input_names", "row_names", "left_out", "output_names", "output_units")
_OLD_NAMES = {"rows_": "rows.", "inertia.": "flexibility.inertia.", "companions.": "enrichment."}


@dataclass(frozen=True)
class SectionOf:
    """Boom to which a model belongs as a section: name of the section, title of the boom, and rows of the joints."""

    name: str
    boom: str
    joints: tuple[str, ...]


@dataclass(frozen=True)
class ReducedModel:
    """Reduced model of a sliding body: its Galerkin projection on a basis that is the same for all path coordinates.

    Attributes
    ----------
    M, D, K : (r, r) arrays
        Symmetric; units follow from the basis (module docstring).
    B : (r, i) array
        Generalised forces of unit inputs, one column each; inputs are in `input_units`, mostly N (or N m).
    outputs : (o, r) array
        Outputs by each coordinate, such as transverse displacements in m at `output_positions` and forces of pads in N.
    rows : PPoly with values (m, r)
        C(s), exact between its breaks; s in m.
    input_names, row_names : tuples of str
    output_positions : (o,) array, m
    output_names, output_units, output_kinds : tuples of str
        Name of each output, its unit, and its kind and direction, such as ``"tip z"`` (`pmr.results.response`).
        Without names and units, all outputs are displacements.  Models of earlier versions have no kinds
        (`pmr.system.body.kinds_of`).
    left_out : tuple of str
        Rows that all vectors of the basis satisfy.  They are left out, because they would make the system singular.
    provenance : dict
        How the model was made: scene hash, basis, versions.
    pads : (m,) array, m/N, or None
        Compliance 1/k of each row's pad, 0 for a rigid one; None if all are rigid.
    flexibility : Flexibility, optional
        Residual flexibility: the quasi-static response that the coordinates leave out.
    enrichment : EnrichmentModes, optional
        The first modes that the basis leaves out; the error is estimated with them (`pmr.compare.estimate`).
    clearance : (m,) array, m, or None
        Displacement at which a row that only pushes closes; NaN for rows that hold both ways, None if all rows do.
    rayleigh : Rayleigh, optional
        Factors of Rayleigh damping, if D is of this kind.
    carriers : CarrierRows, optional
        The rows on their carriers, for a system in which each row has a path coordinate of its own.
    reactions : Reactions, optional
        Work from which the forces of rigid supports are computed.
    section : SectionOf, optional
        The boom of which this is a section.
    ports : mapping of str to (r,) array
        Motion, by each coordinate, of a point where connectors may be attached: ``"tip z"`` in m, ``"tip ry"`` in rad.
    matrices : mapping of str to (r, r) array
        V^T A V for each matrix A of a moving frame or of axial forces, by the names of `pmr.system.body_matrices`;
        matrices that are zero are left out.
    rigid_work : (k, i) array, optional
        Work of unit inputs on the body's k rigid motions: translations along the axes, rotations about axes through
        the tail.
    quasi_static : (q,) array of int
        Numbers of the coordinates that simulators treat as without inertia (`pmr.system.attachment`), although M has
        inertia for them.
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
    carriers: CarrierRows | None = None
    reactions: Reactions | None = None
    AXES = {"M": "rr", "D": "rr", "K": "rr", "input_names": "i", "row_names": "m", "output_positions": "o"}
    AXES |= {"B": "ri", "outputs": "or", "rows": "mr", "pads": "m"}

    section: SectionOf | None = None
    ports: Mapping[str, Array] = field(default_factory=dict)
    output_kinds: tuple[str, ...] = ()
    matrices: Mapping[str, Array] = field(default_factory=dict)
    rigid_work: Array | None = None
    quasi_static: Indices = field(default_factory=lambda: np.zeros(0, np.int64))

    def __repr__(self) -> str:
        low, high = self.domain
        head = f"ReducedModel with {self.size} coordinates, s from {low:g} to {high:g} m"
        return overview(head, inputs=self.input_names, outputs=self.output_names)

    @property
    def size(self) -> int:
        """Number of generalised coordinates r."""
        return len(self.M)

    @property
    def cylinder_modes(self) -> int:
        """Number of modes of the section's cylinder (`pmr.system.attachment`), the last coordinates of the model."""
        answers = None if self.carriers is None else self.carriers.answers
        return 0 if answers is None else answers.turned.shape[1]

    @property
    def residual(self) -> Flexibility:
        """Residual flexibility; zeros on the breaks of the rows for a model without it."""
        if self.flexibility is not None:
            return self.flexibility
        m, i, o = len(self.row_names), len(self.input_names), len(self.outputs)
        rows, inputs, outputs = (
            PPoly(np.zeros((1, len(self.rows.x) - 1, *shape)), self.rows.x) for shape in ((m, m), (m, i), (o, m))
        )
        return Flexibility(rows, inputs, outputs, np.zeros((o, i)), np.zeros((i, i)))

    @property
    def row_compliance(self) -> Array:
        """Compliance 1/k (m,) of each row's pad, in m/N; 0 where the row is rigid."""
        return np.zeros(len(self.row_names)) if self.pads is None else self.pads

    @property
    def row_clearance(self) -> Array:
        """Clearance (m,) in m of each row that only pushes; NaN for rows that hold both ways."""
        return np.full(len(self.row_names), np.nan) if self.clearance is None else self.clearance

    @property
    def domain(self) -> Interval:
        """Lowest and highest path coordinate in m for which the rows are defined."""
        return Interval(float(self.rows.x[0]), float(self.rows.x[-1]))

    def C(self, s: ArrayLike, derivative: int = 0) -> Array:
        """Rows C(s) (m, r) at s in m, or (T, m, r) at s (T,); with a `derivative`, their derivative of that order by s.

        Raises ValueError if s lies outside `domain`.
        """
        return evaluate(self.rows, s, derivative, label=", ".join(self.row_names))

    @property
    def input_units(self) -> tuple[str, ...]:
        """Unit of each input, from the model's scene: N, N m, K, N/m of wind, m/s^2 or 1/s^2 for accelerations.

        An input that the scene does not describe has the unit N.
        """
        scene = self.provenance.get("scene")
        loads = scene.get("loads") if isinstance(scene, Mapping) else None
        listed = [load for load in loads if isinstance(load, Mapping)] if isinstance(loads, list | tuple) else []
        directions = {str(load.get("name")): str(load.get("direction")) for load in listed}
        units = {name: "N m" if direction.startswith("r") else "N" for name, direction in directions.items()}
        units |= {str(load.get("name")): "K" for load in listed if load.get("acts") == "temperature"}
        winds = tuple(f"{load.get('name')} " for load in listed if load.get("acts") == "wind")
        units |= {name: "N/m" for name in self.input_names if winds and name.startswith(winds)}
        units |= dict.fromkeys(("gravity", "extension", *CONSTANT), "m/s^2") | dict.fromkeys(LINEAR, "1/s^2")
        return tuple(units.get(name, "N") for name in self.input_names)

    def ensure_whole(self, source: str) -> None:
        """Raise an InputError about `source` if this is a section of a boom with rows for its joints to other sections.

        A section can be used by itself if none of its joints has a row.
        """
        if self.section is not None and set(self.row_names) & set(self.section.joints):
            allowed = f"the model of a whole body is allowed: this is a section of {self.section.boom!r} without what "
            allowed += "joins it to the others; `pmr run` and pmr.simulate(boom, models) know that"
            raise InputError(source, "section", self.section.name, allowed)

    def without_joints(self) -> ReducedModel:
        """Return the model without the rows of joints, so that only supports hold the body.

        The model is returned unchanged if it has no joints.
        """
        joints = () if self.section is None else self.section.joints
        return self.with_rows([k for k, name in enumerate(self.row_names) if name not in joints])

    @property
    def moving(self) -> list[int]:
        """Numbers of the rows that depend on s: the sliders."""
        return np.flatnonzero(np.any(self.rows.c[:-1] != 0.0, axis=(0, 1, 3))).tolist()

    @property
    def held(self) -> dict[int, int]:
        """Always empty: no row of a reduced model holds a single coordinate.

        A full model may have such rows (`pmr.system.body.FullOrderBody.held`).
        """
        return {}

    @property
    def lasting_rows(self) -> tuple[str, ...]:
        """Always empty: the basis of a reduced model satisfies all fixed rows, so none of them stays in the model.

        For a full model, `pmr.system.body.FullOrderBody.lasting_rows` has the fixed rows of several coordinates.
        """
        return ()

    def apply_rows(self, s: Array, q: Array, derivative: int = 0) -> Array:
        """Product C(s) q (T, m) for s (T,) in m and coordinates q (T, r).

        With a `derivative` of 1 or more, that derivative of C with respect to s is used instead of C.  Raises
        ValueError if s is outside the rows' domain.
        """
        return apply_table(self.rows, s, q, derivative)

    def rows_on(self, V: Array) -> PPoly:
        """Piecewise polynomial C(s) V with values (m, k), for V (r, k)."""
        return multiply_matrix(self.rows, V)

    def with_carriers(self, carriers: CarrierRows) -> ReducedModel:
        """Return the model with other `carriers` of its rows, and the tables over the path that follow from them."""
        rows = carriers.polynomials(self.rows.x).times(carriers.values)
        flexibility = None if carriers.flexibility is None else TablesOnDemand(carriers, self.rows.x)
        return replace(self, carriers=carriers, rows=rows, flexibility=flexibility)

    def with_rows(self, numbers: Sequence[int]) -> ReducedModel:
        """Return the model with only the rows `numbers`, in this order and numbered anew from 0.

        All other rows are dropped and hold nothing any more.  If rows are left out or their order changes, the result
        has no enrichment modes, so its errors can't be estimated.  Otherwise the model itself is returned.
        """
        chosen = list(numbers)
        if chosen == list(range(len(self.row_names))):
            return self
        return replace(
            self,
            flexibility=None if self.flexibility is None else self.flexibility.with_rows(chosen),
            enrichment=None,
            rows=select_rows(self.rows, chosen),
            row_names=tuple(self.row_names[i] for i in chosen),
            pads=None if self.pads is None else self.pads[chosen],
            clearance=None if self.clearance is None else self.clearance[chosen],
            carriers=None if self.carriers is None else self.carriers.with_rows(chosen),
            reactions=None if self.reactions is None else self.reactions.with_rows(chosen),
        )

    def leading(self, coordinates: int) -> ReducedModel:
        """Return the model on the first `coordinates` vectors of its basis; POD bases are nested.

        Raises
        ------
        ValueError
            If the model has a residual flexibility, which is right only for all coordinates together, or if it has
            fewer than `coordinates` vectors.
        """
        if self.flexibility is not None:
            raise ValueError("a residual flexibility belongs to all coordinates of its model")
        if not 0 < coordinates <= self.size:
            raise ValueError(f"1 to {self.size} coordinates are allowed, not {coordinates}")
        r = coordinates
        return replace(
            self,
            M=np.ascontiguousarray(self.M[:r, :r]),
            D=np.ascontiguousarray(self.D[:r, :r]),
            K=np.ascontiguousarray(self.K[:r, :r]),
            B=self.B[:r],
            outputs=np.ascontiguousarray(self.outputs[:, :r]),
            ports={name: row[:r] for name, row in self.ports.items()},
            matrices={name: np.ascontiguousarray(A[:r, :r]) for name, A in self.matrices.items()},
            rows=select_columns(self.rows, slice(r)),
            carriers=None if self.carriers is None else self.carriers.project(np.eye(self.size, r)),
        )

    def save(self, path: str | Path) -> Path:
        """Write the model to an npz file with a JSON header (`pmr.system.carriers`); return its path.

        Nothing in the file is pickled.
        """
        path = Path(path)
        header = {
            "format": FORMAT,
            "version": FORMAT_VERSION,
            "units": "SI; coordinates as the basis in provenance states",
        }
        npz.write(path, pack_model(self), header, compressed=True)
        return path

    @classmethod
    def load(cls, path: str | Path) -> ReducedModel:
        """Read a model that `save` wrote.

        A model of an earlier version that has no carriers is returned without its enrichment modes.

        Raises
        ------
        InputError
            If the file is missing or is no sound reduced model, if it has less content than its header says, or if its
            format is later than this version of pmr.  Also if it stores the residual inertia in the form of some
            earlier versions.
        """
        path = Path(path)
        if not isfile(path):
            raise InputError(str(path), "", None, f"{missing_file_reason(path)}; `pmr run` writes reduced.npz")
        try:
            data = npz.read(path, npz.MOST_EXPANSION, npz.ROOM)
            header = npz.pop_header(data)
            if header["format"] != FORMAT:
                raise InputError(str(path), "format", header["format"], f"{FORMAT!r} is allowed")
            if int(header["version"]) > FORMAT_VERSION:
                raise InputError(str(path), "version", header["version"], f"at most {FORMAT_VERSION} can be read")
            data = data if int(header["version"]) > 4 else _upgrade_version_4(header, data)
            if data.get("flexibility.inertia.kept", False):
                allowed = "a model without residual inertia is needed; more coordinates have the same effect"
                raise InputError(str(path), "flexibility.inertia", None, allowed)
            model = cls.from_arrays(data)
            if model.carriers is None:  # of an earlier version: its modes for the estimate need carriers
                model = replace(model, enrichment=None)
            wrong = model.contradiction()
        except READING as error:
            if isinstance(error, InputError):
                raise
            raise InputError(str(path), "", None, f"not a reduced model written by pmr ({error})") from None
        if wrong:
            raise InputError(str(path), "", None, f"not a sound reduced model: {wrong}")
        return model

    @classmethod
    def from_arrays(cls, data: Mapping[str, NDArray[Any]], prefix: str = "") -> ReducedModel:
        """Return the model that `pack_model` packed into arrays with this `prefix`; `data` has them by name.

        Raises ValueError if tables are missing and there are no sound carriers from which they follow.  The errors of
        `pmr.files.npz.record_from_arrays` are raised, too.
        """
        content = unpack_model(data, prefix)
        if {f"{name[:-7]}.coefficients" for name in content if name.endswith(".breaks")} <= set(content):
            return npz.record_from_arrays(cls, content, prefix)
        content = {name: array for name, array in content.items() if not name.startswith(f"{prefix}flexibility.")}
        content[f"{prefix}rows.coefficients"] = np.zeros((1, len(content[f"{prefix}rows.breaks"]) - 1, 0, 0))
        model = npz.record_from_arrays(cls, content, prefix)
        if model.carriers is None or (wrong := describe_fault(model.carriers)):
            raise ValueError(wrong if model.carriers else "tables are missing, and carriers from which they follow")
        return model.with_carriers(model.carriers)

    def contradiction(self) -> str | None:
        """Description of what is wrong with the arrays; None if shapes agree, breaks increase and values are finite."""
        o, m = len(self.output_positions), len(self.row_names)
        if not {len(self.output_names), len(self.output_units), len(self.output_kinds)} <= {0, o}:
            counts = (
                f"{len(self.output_names)} names, {len(self.output_units)} units and {len(self.output_kinds)} kinds"
            )
            return f"{counts} are given for {o} outputs"
        for names in ("output_names", "output_units", "output_kinds", "left_out"):
            if wrong := describe_names(names, tuple(name.replace("^", "") for name in getattr(self, names))):
                return wrong
        if wrong := describe_misfit(self, {}) or describe_asymmetry({"M": self.M, "D": self.D, "K": self.K}):
            return wrong
        if np.any(self.row_compliance < 0.0):
            return "pads has negative values, values from 0 on are allowed"
        clearance = self.row_clearance
        if clearance.shape != (m,) or not np.all(np.isnan(clearance) | (clearance >= 0.0) & np.isfinite(clearance)):
            return f"clearance has shape {clearance.shape} or values that are no lengths, {(m,)} from 0 on are allowed"
        for name, row in self.ports.items():
            if row.shape != (self.size,) or not np.isfinite(row).all():
                return f"ports.{name} has shape {row.shape} or is not finite, {(self.size,)} is allowed"
        if wrong := describe_misshapen("matrices", self.matrices, self.size):
            return wrong
        if self.rigid_work is not None and self.rigid_work.shape[1:] != (len(self.input_names),):
            return f"rigid_work has shape {self.rigid_work.shape}, a column for each input is allowed"
        still = self.quasi_static
        if still.ndim != 1 or len(set(still.tolist())) < still.size or not np.all((0 <= still) & (still < self.size)):
            return f"quasi_static names other coordinates than the model's {self.size}, or one twice"
        if not np.all(np.diagonal(self.K)[still] > 0.0):
            return "a coordinate without inertia has no stiffness"
        if self.enrichment is not None:
            if not np.all(self.enrichment.stiffness > 0.0):
                return "enrichment.stiffness is not positive"
            if wrong := describe_misshapen(
                "enrichment.matrices", self.enrichment.matrices, self.size + self.enrichment.count
            ):
                return wrong
        if self.reactions is not None and self.reactions.inertia.shape[1] < self.size:
            return f"reactions.inertia has {self.reactions.inertia.shape[1]} columns, {self.size} or more are allowed"
        return None if self.carriers is None else self.carriers.contradiction(m)


def _upgrade_version_4(header: Mapping[str, Any], data: Mapping[str, Array]) -> dict[str, NDArray[Any]]:
    """Arrays of a file of version 4 or earlier, from its arrays `data`, under the names of the current version.

    The header of such a file has the names of inputs, rows and outputs, the provenance and Rayleigh's factors; they
    become arrays.  Raises TypeError if a list of names holds anything but texts.
    """
    arrays = npz.rename_keys(data, _OLD_NAMES)
    for name in _NAMES:
        names = header.get(name, ())
        if not isinstance(names, list | tuple) or not all(isinstance(each, str) for each in names):
            raise TypeError(f"a list of names is allowed, not {names!r:.60}")
        arrays[name] = np.array(names, dtype=np.str_)
    arrays["provenance"] = np.array(npz.json_text(header["provenance"]))
    if header.get("rayleigh") is not None:
        alpha, beta = header["rayleigh"]
        arrays |= {"rayleigh.alpha": np.array(alpha), "rayleigh.beta": np.array(beta)}
    return arrays


def satisfied_rows(C: PPoly, tolerance: float, least: float = 0.0) -> list[int]:
    """Ascending numbers of the rows C, with values (m, r), that a basis satisfies identically.

    Such a row is zero up to a bound: no contribution of a power to it (`power_contributions`) exceeds the bound.  The
    bound is `tolerance` times the largest contribution to any row, but no less than `least`.  `tolerance` is the
    round-off to expect in the basis.
    """
    magnitude = np.abs(power_contributions(C)).max(axis=(0, 1, 3))
    return np.flatnonzero(magnitude <= max(least, tolerance * magnitude.max(initial=0.0))).tolist()
