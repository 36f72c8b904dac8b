r"""Bodies that simulators work on: constant matrices and a few rows that move along a path.

`project` makes the Galerkin projection of a body that one process stores on a basis V,

.. math::
    V^T M V, \quad V^T D V, \quad V^T K V, \quad V^T B, \quad O V, \quad C(s) V

with the outputs O and the rows C(s) at the path coordinate s.  `pmr.reduction.basis` has the Galerkin projection of the
distributed full model.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, TypeAlias

import numpy as np
import scipy.sparse as sp
from scipy.interpolate import PPoly

from pmr.errors import InputError
from pmr.files.arrays import Array, Indices, Mask
from pmr.results.response import FORCES
from pmr.scene.signals.base import Interval
from pmr.system.body_matrices import Rayleigh, Reactions, symmetric_part
from pmr.system.carriers import CarrierRows
from pmr.system.polynomials import power_contributions, stack_tables, transpose
from pmr.system.reduced_model import ReducedModel
from pmr.system.rows import Rows, SharedCarriers

#: Rows on common carriers, of a reduced body or of a distributed one.
RowsOnCarriers: TypeAlias = CarrierRows | SharedCarriers


def kinds_of(body: Body) -> tuple[str, ...]:
    """Kind and direction of each output, such as ``"tip z"`` (`pmr.results.response`).

    If the body does not state them, as in models of earlier versions, they are derived from names and units.  Without
    units, all outputs are displacements of the beam, and the last one is the displacement of the tip.
    """
    if body.output_kinds:
        return body.output_kinds
    count = len(body.output_positions)
    if not body.output_units:
        return ("beam z",) * (count - 1) + ("tip z",) * bool(count)
    named = zip(body.output_names or ("",) * count, body.output_units, strict=True)
    return tuple(_kind_of_earlier_version(name, unit) for name, unit in named)


def names_of(body: Body) -> tuple[str, ...]:
    """Name of each output; number k is called ``output k`` if the body has no names."""
    return body.output_names or tuple(f"output {k}" for k in range(len(body.output_positions)))


def units_of(body: Body) -> tuple[str, ...]:
    """Unit of each output; m for all if the body has no units."""
    return body.output_units or ("m",) * len(body.output_positions)


def _kind_of_earlier_version(name: str, unit: str) -> str:
    """Kind and direction of an output in a model of an earlier version, from the output's name and unit.

    For the unit m, the name "z at 2 m" gives ``beam z``, and "tip z" gives ``tip z``.  For the unit N the kind is
    ``pad``, for any other unit ``probe``.
    """
    if unit != "m":
        return "pad" if unit == "N" else "probe"
    start, at, _ = name.partition(" at ")
    return f"beam {start}" if at else f"tip {name.rpartition(' ')[2]}".strip()


def _has_kind(body: Body, *kinds: str) -> Mask:
    """Mask (o,) of the outputs of a body that have one of the `kinds`, without regard to their direction."""
    return np.array([kind.split(" ")[0] in kinds for kind in kinds_of(body)], dtype=bool)


def force_outputs(body: Body) -> Mask:
    """Mask (o,) of the outputs that are forces of pads and of supports with a stiffness."""
    return _has_kind(body, *FORCES)


def length_outputs(body: Body) -> Mask:
    """Mask (o,) of the outputs that are displacements of the beam or of its tip."""
    return _has_kind(body, "beam", "tip")


def other_outputs(body: Body) -> Mask:
    """Mask (o,) of the outputs that are rotations or probes, neither forces nor displacements."""
    return np.asarray(~(length_outputs(body) | force_outputs(body)))


def pushing_rows(body: SlidingBody) -> list[int]:
    """Numbers of the rows that only push: multipliers of such rows are never negative, and zero while they are open."""
    return np.flatnonzero(~np.isnan(body.row_clearance)).tolist()


def released_rows(body: SlidingBody) -> list[int]:
    """Ascending numbers of the rows that move or only push; their multipliers are the forces of sliders and pads."""
    return sorted({*body.moving, *pushing_rows(body)})


def clear_rates_without_inertia(body: SlidingBody, v: Array) -> Array:
    """Rates v (T, n) with zeros for the coordinates without inertia; v itself if all coordinates have inertia."""
    if not len(body.quasi_static):
        return v
    rates = v.copy()
    rates[:, body.quasi_static] = 0.0
    return rates


@dataclass(frozen=True, kw_only=True)
class FullOrderBody(ABC):
    """Rows of a body in full order, names and places of its inputs and outputs, and all that follows from the rows."""

    rows: Rows  # supports first, then the sliders
    input_names: tuple[str, ...]
    output_positions: Array  # (o,) m along the axis
    output_names: tuple[str, ...] = ()
    output_units: tuple[str, ...] = ()
    output_kinds: tuple[str, ...] = ()
    # rows (1, n) that measure motions where something may be attached, by place and direction
    ports: Mapping[str, sp.csr_matrix] = field(default_factory=dict)
    node_stations: Array | None = None  # (N,) m: coordinates of a beam's nodes along its axis; None: no beam
    flexibility: ClassVar[None] = None  # a full model leaves no flexibility out
    section: ClassVar[None] = None  # a full model does not record to which boom it belongs

    @property
    @abstractmethod
    def carriers(self) -> RowsOnCarriers | None:
        """Rows of the body on carriers (`pmr.system.carriers`).

        None is returned by a kind of full model whose rows are on no carriers.
        """

    def ensure_whole(self, source: str) -> None:
        """Do nothing: a full model has all of its joints, so there is no error to raise about `source`."""
        return

    @property
    def row_compliance(self) -> Array:
        """Compliance 1/k (m,) of each row's pad, in m/N; 0 where the row is rigid."""
        return self.rows.compliance

    @property
    def row_clearance(self) -> Array:
        """Clearance (m,) in m of each row that only pushes; NaN for rows that hold both ways."""
        return self.rows.clearance

    @property
    def row_names(self) -> tuple[str, ...]:
        """Names (m,) of the rows C, in their order."""
        return self.rows.names

    @property
    def domain(self) -> Interval:
        """Lowest and highest path coordinate in m at which every row is defined."""
        return self.rows.domain

    @property
    def moving(self) -> list[int]:
        """Numbers of the rows that depend on s: the sliders."""
        return [number for number, row in enumerate(self.rows.rows) if row.moves]

    @property
    def held(self) -> dict[int, int]:
        """Numbers of the coordinates that supports on a single coordinate hold, by the number of the support's row."""
        rows = enumerate(self.rows.rows)
        return {number: row.held_coordinate for number, row in rows if row.held_coordinate is not None}

    @property
    def lasting_rows(self) -> tuple[str, ...]:
        """Names of the fixed rows (`Row.is_fixed`) that combine several coordinates; others hold a single one."""
        return tuple(row.name for row in self.rows.rows if row.is_fixed and row.held_coordinate is None)


#: Body of a system, whether one process stores its matrices or several do.
Body: TypeAlias = ReducedModel | FullOrderBody


@dataclass(frozen=True)
class FullBody(FullOrderBody):
    """Full model of a body on one process, with sparse matrices, for simulations of the full-order reference.

    The body has n coordinates, i inputs, o outputs and m rows: M, D, K (n, n), B (n, i), `outputs` (o, n).  The other
    fields are those of `pmr.fullmodel.model.FullModel`.
    """

    M: sp.csr_matrix
    D: sp.csr_matrix
    K: sp.csr_matrix
    B: Array
    outputs: sp.csr_matrix
    rayleigh: Rayleigh | None = None
    # by name: matrices (n, n) as in `pmr.fullmodel.model.FullModel`
    matrices: Mapping[str, sp.csr_matrix] = field(default_factory=dict)

    @property
    def size(self) -> int:
        """Number of coordinates n."""
        return int(self.M.shape[0])

    @property
    def quasi_static(self) -> Indices:
        """Numbers (0,) of the coordinates without inertia, of which a full model has none."""
        return np.zeros(0, np.int64)

    @cached_property
    def carriers(self) -> CarrierRows:
        """Rows on their carriers as dense arrays, for bodies small enough that full matrices of them can be solved."""
        return CarrierRows.from_rows(self.rows.shared_carriers.rows, self.rows.shared_carriers.carriers.toarray())

    @cached_property
    def reactions(self) -> Reactions | None:
        """Reactions of the h rows that are fixed (`Row.is_fixed`); None if there are none.

        Each of the h motions of the reactions changes the value of one fixed row by 1 and leaves the others unchanged.
        Of all motions that do so, those with the least sum of squares are taken.
        """
        numbers = self.rows.fixed
        if not numbers:
            return None
        S = self.C(self.domain[0])[numbers]
        motions = S.T @ np.linalg.pinv((S @ S.T).toarray())
        rows = transpose(self.rows_on(motions))
        rows.c[..., numbers] = 0.0
        return Reactions(
            names=tuple(self.row_names[k] for k in numbers),
            units=tuple(self.rows.rows[k].unit for k in numbers),
            inertia=(self.M @ motions).T,
            damping=(self.D @ motions).T,
            stiffness=(self.K @ motions).T,
            inputs=motions.T @ self.B,
            rows=rows,
        )

    def C(self, s: float, derivative: int = 0) -> sp.csr_matrix:
        """Sparse rows C(s) (m, n) at s in m, or their derivative of the order `derivative` with respect to s."""
        return self.rows.at(s, derivative)

    def apply_rows(self, s: Array, q: Array, derivative: int = 0) -> Array:
        """Product C(s) q (T, m) for s (T,) in m and coordinates q (T, n).

        With a `derivative` of 1 or more, that derivative of C with respect to s is used instead of C.
        """
        applied = [row.apply(s, q, derivative) for row in self.rows.rows]
        return np.stack(applied, axis=1) if applied else np.zeros((len(q), 0))

    def rows_on(self, V: Array) -> PPoly:
        """Piecewise polynomial C(s) V with values (m, r), for V (n, r)."""
        return stack_tables([row.project(V) for row in self.rows.rows], self.domain, V.shape[1])


#: Body that a simulator takes: constant matrices and a few rows that move with s (equations:
#: `pmr.system.reduced_model`).  They are dense for a reduced body and sparse for a full one.
SlidingBody: TypeAlias = ReducedModel | FullBody


@dataclass(frozen=True)
class Trajectory:
    """Coordinates of a simulated body at T times."""

    t: Array  # (T,) s
    # (T, n): coordinates and their rates; n = r of a reduced model
    q: Array
    v: Array
    multipliers: Array  # lambda (T, m) in N; the sliders push with -lambda on the body
    s: Array  # (T,) m: path coordinate; (T, m) in a system of bodies, where each row has a path coordinate
    seconds: float  # wall time of the solver alone
    # energy that neither loads nor moving rows put in, over the largest (`pmr.simulation.stepping`); NaN: unknown
    surplus: float = np.nan


def project(body: SlidingBody, V: Array) -> ReducedModel:
    """Reduced model of a body on the columns of V (n, r), with all of the body's rows and its flexibility.

    The result has no carriers, no enrichment modes, no provenance and no matrices of a moving frame.  An InputError is
    raised unless V has real, finite entries and a row for each of the body's n coordinates.
    """
    V = np.asarray(V)
    if V.dtype.kind not in "biuf" or V.shape[:1] != (body.size,) or V.ndim != 2:
        allowed = f"vectors of real numbers as columns, with {body.size} rows, one for each coordinate, are allowed"
        raise InputError("pmr.project", "V", list(V.shape), allowed)
    if not np.isfinite(V).all():
        raise InputError("pmr.project", "V", None, "finite numbers are allowed")
    M, D, K = (symmetric_part(V.T @ (A @ V)) for A in (body.M, body.D, body.K))
    clearance = body.row_clearance
    return ReducedModel(
        M=M,
        D=D,
        K=K,
        B=np.asarray(V.T @ body.B),
        outputs=np.asarray(body.outputs @ V),
        rows=body.rows_on(V),
        input_names=body.input_names,
        row_names=body.row_names,
        output_positions=body.output_positions,
        output_names=body.output_names,
        output_units=body.output_units,
        output_kinds=body.output_kinds,
        pads=body.row_compliance if body.row_compliance.any() else None,
        flexibility=body.flexibility,
        clearance=None if np.isnan(clearance).all() else clearance,
        rayleigh=body.rayleigh,
        reactions=None if body.reactions is None else body.reactions.project(V),
        section=body.section,
    )


#: Flexibility of a contact below this share of the largest is round-off of a rigid one.
ROUND_OFF = 1e-14


def is_round_off(F: Array, largest: float = 0.0) -> Mask:
    """Mask (..., m) of m contacts that are rigid: their flexibility, in F (..., m, m) in m/N, is round-off.

    The diagonal entry of a rigid contact is at most `ROUND_OFF` times the largest entry, or times `largest` if that is
    more.  `largest` is the largest flexibility of the bodies in m/N, needed because all of F may be round-off.
    """
    diagonal = np.diagonal(F, axis1=-2, axis2=-1)
    most = np.maximum(diagonal.max(axis=-1, keepdims=True, initial=0.0), largest)
    return np.asarray(diagonal <= ROUND_OFF * most)


def clear_rows(F: Array, mask: Mask) -> None:
    """Set to zero, in place, the rows and columns of the contacts in a `mask` (..., m) of F (..., m, m)."""
    F[np.broadcast_to(mask[..., :, None] | mask[..., None, :], F.shape)] = 0.0


def compliant_rows(body: SlidingBody) -> list[int]:
    """Numbers of the rows that have flexibility anywhere on the path: residual flexibility, or compliance of a pad."""
    F = np.diag(body.row_compliance)
    if body.flexibility is not None:
        F = F + np.abs(power_contributions(body.flexibility.rows)).max(axis=(0, 1))
    return np.flatnonzero(~is_round_off(F)).tolist()
