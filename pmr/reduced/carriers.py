r"""What the rows of a reduced body measure, as constants: any number of them, each with a path coordinate of its own.

With c(x) = b(x) U on the full body, V the basis and R what it leaves out,

.. math::
    c(x)\, V = b(x)\, (U V), \qquad c_\rho(x)\, R\, c_\sigma(y)^T = b_\rho(x)\, (U R U^T)\, b_\sigma(y)^T

so that rows which travel independently need no table in two variables.  Where all rows share one path coordinate, the
tables of `Flexibility` are these products, multiplied out.

Residual flexibility: what the truncated coordinates would have answered at once, as small tables in s.

Beside it the first modes in that part.

With R the flexibility that a basis leaves out and q = V p + R (B f - C^T lambda), the rows and outputs become

.. math::
    C V p + H f - (G + 1/k) \lambda = 0, \qquad y = O V p + W f - X \lambda, \qquad
    G = C R C^T, \quad H = C R B, \quad X = O R C^T, \quad W = O R B

(static correction after MacNeal 1971 and Rubin 1975, here with rows C(s) that move).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.constraints.polynomials import apply_table, columns, select_rows, side_by_side, transpose
from pmr.constraints.rows import Row, RowPolynomials
from pmr.reduced.soundness import symmetric


@dataclass(frozen=True)
class Flexibility:
    """Tables of the residual flexibility of a body with m rows, i inputs and o outputs."""

    AXES: ClassVar = {"rows": "mm", "inputs": "mi", "outputs": "om", "direct": "oi", "energy": "ii"}

    rows: PPoly  # G(s) = C R C^T (m, m) m/N: displacement at one row under a unit force at another
    inputs: PPoly  # H(s) = C R B (m, i) m/N
    outputs: PPoly  # X(s) = O R C^T (o, m) m/N
    direct: Array  # W = O R B (o, i) m/N
    energy: Array  # B^T R B (i, i) m/N: twice the residual strain energy under unit inputs

    def with_rows(self, numbers: Sequence[int]) -> Flexibility:
        """Return the flexibility of a body with none but these of its rows."""
        rows, inputs = (select_rows(table, numbers) for table in (self.rows, self.inputs))
        outputs = columns(self.outputs, numbers)
        return replace(self, rows=columns(rows, numbers), inputs=inputs, outputs=outputs)

    def row_motion(self, s: Array, multipliers: Array, loads: Array) -> Array:
        """H(s) f - G(s) lambda, (T, m) in m: what the residual part adds at the rows, along a trajectory."""
        return apply_table(self._at_rows, s, np.hstack([loads, -multipliers]))

    def input_motion(self, s: Array, multipliers: Array, loads: Array) -> Array:
        """B^T R g, (T, i) in m: what the residual part adds to the motion of the loads' points."""
        return np.asarray(loads @ self.energy - apply_table(self._of_rows, s, multipliers))

    @cached_property
    def _of_rows(self) -> PPoly:
        """H(s)^T."""
        return transpose(self.inputs)

    @cached_property
    def _at_rows(self) -> PPoly:
        """H(s) and G(s) side by side."""
        return side_by_side(self.inputs, self.rows)


@dataclass(frozen=True)
class EnrichmentModes:
    """The first c modes that a model truncates, M-orthonormal and in ascending order; m rows, i inputs, o outputs.

    Their flexibility is part of the model's tables; as coordinates they serve to estimate its error, or to have more
    coordinates after all (`pmr.reduced.truncation`).
    """

    AXES: ClassVar = {"stiffness": "c", "damping": "c", "B": "ci", "outputs": "oc", "rows": "mc"}

    stiffness: Array  # omega^2 (c,) in (rad/s)^2
    damping: Array  # phi^T D phi = 2 zeta omega (c,) 1/s
    B: Array  # (c, i)
    outputs: Array  # (o, c)
    rows: PPoly  # C(s) phi (m, c)
    # (r + c, r + c): what a model with them among its coordinates has as `matrices`
    matrices: Mapping[str, Array] = field(default_factory=dict)

    @property
    def count(self) -> int:
        return len(self.stiffness)


Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class CarrierFlexibility:
    """Residual flexibility between K carriers, i inputs and o outputs."""

    AXES: ClassVar = {"rows": "KK", "inputs": "Ki", "outputs": "oK", "direct": "oi", "energy": "ii"}

    rows: Array  # U R U^T (K, K) m/N
    inputs: Array  # U R B (K, i) m/N
    outputs: Array  # O R U^T (o, K) m/N
    direct: Array  # O R B (o, i) m/N
    energy: Array  # B^T R B (i, i) m/N

    def tables(self, C: RowPolynomials) -> Flexibility:
        """Tables over the path of rows on these carriers, all of them at the same path coordinate."""
        outputs = transpose(C.times(self.outputs.T))
        return Flexibility(C.quadratic_form(self.rows), C.times(self.inputs), outputs, self.direct, self.energy)

    def joined(self, U: Array, modes: EnrichmentModes, share: Array) -> CarrierFlexibility:
        """Add the flexibility of modes that measure U (K, c), `share` (c,) of phi phi^T each."""
        scaled = share[:, None] * modes.B
        return CarrierFlexibility(
            rows=self.rows + symmetric(U * share @ U.T),
            inputs=self.inputs + U @ scaled,
            outputs=self.outputs + modes.outputs * share @ U.T,
            direct=self.direct + modes.outputs @ scaled,
            energy=self.energy + symmetric(modes.B.T @ scaled),
        )


@dataclass(frozen=True)
class Answers:
    r"""Answers to a force on one row c that stays, at rest and by inertia, n vectors.

    .. math:: x_1 = R c^T, \qquad x_{k+1} = R M x_k

    With eigenmodes phi joining R (or leaving it) each :math:`x_k` gains :math:`\varphi\, (c \varphi) / \omega^{2k}`.
    """

    AXES: ClassVar = {"load": "K", "rows": "Kn", "inputs": "in", "outputs": "on", "stiffness": "nn", "inertia": "nn"}
    AXES |= {"supports": "hn", "turned": "ka"}

    load: Array  # c on the carriers (K,)
    rows: Array  # U x (K, n) m/N and, for each k more, s^2 more
    inputs: Array  # B^T x (i, n)
    outputs: Array  # O x (o, n)
    stiffness: Array  # x^T K x (n, n)
    inertia: Array  # x^T M x (n, n)
    supports: Array  # Phi^T M x (h, n) with the motions of `pmr.reduced.matrices`, of none but the largest basis
    # (k, a): combinations of the first k that are the model's last a coordinates; none where no such are
    turned: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def shares(self, U: Array, modes: EnrichmentModes) -> Array:
        """How much of each mode (c, n) the vectors gain; the modes measure U (K, c) on the carriers."""
        powers = np.arange(1, self.rows.shape[1] + 1)
        return np.asarray((self.load @ U)[:, None] / modes.stiffness[:, None] ** powers)

    def joined(self, U: Array, modes: EnrichmentModes, sign: float) -> Answers:
        """Add the modes to what is left out, or remove them where `sign` is -1; arguments as for `shares`."""
        shares = self.shares(U, modes)
        return replace(
            self,
            rows=self.rows + sign * U @ shares,
            inputs=self.inputs + sign * modes.B.T @ shares,
            outputs=self.outputs + sign * modes.outputs @ shares,
            stiffness=self.stiffness + sign * shares.T @ (modes.stiffness[:, None] * shares),
            inertia=self.inertia + sign * shares.T @ shares,
        )


@dataclass(frozen=True)
class CarriedRows:
    """m rows of a body of r coordinates on K carriers."""

    AXES: ClassVar = {"values": "Kr", "enrichment": "Kc"}

    values: Array  # U V (K, r): what the coordinates measure on the carriers
    # b(x) of each row, by its number, "0" and on, as `pmr.constraints.rows.Row` has it
    breaks: Mapping[str, Array]
    touched: Mapping[str, Indices]
    coefficients: Mapping[str, Array]
    enrichment: Array  # U phi (K, c) of the model's enrichment modes
    flexibility: CarrierFlexibility | None = None  # what the coordinates leave out between the carriers
    # R M R between the carriers, in s^2 m/N: what the inertia of that part moves (`pmr.compare.estimate`)
    inertia: CarrierFlexibility | None = None
    # what answers the cylinder of a boom's section (`pmr.reduced.attachment`)
    answers: Answers | None = None
    # the model's `matrices` between the R vectors of the largest basis, p vectors that span what the part that it
    # leaves out answers to loads on carriers and inputs (none where they are many), and the n of `answers` (if any)
    matrices: Mapping[str, Array] = field(default_factory=dict)
    ports: Mapping[str, Array] = field(default_factory=dict)  # its `ports` on all these, (R + p + n,)
    spanned: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (p, K + i): these answers by the p vectors
    # work (h, .) of `matrices` on the motions of rigid supports (`pmr.reduced.matrices`)
    supports: Mapping[str, Array] = field(default_factory=dict)

    @classmethod
    def of(cls, rows: Sequence[Row], values: Array, flexibility: CarrierFlexibility | None = None) -> CarriedRows:
        """Rows on common carriers, of which the coordinates measure `values` (K, r)."""
        breaks, touched, coefficients = (
            {str(k): getattr(row, name) for k, row in enumerate(rows)} for name in ("breaks", "touched", "coefficients")
        )
        return cls(np.asarray(values), breaks, touched, coefficients, np.zeros((len(values), 0)), flexibility)

    def row(self, number: int, name: str) -> Row:
        """One of the rows, by a name."""
        k = str(number)
        return Row(name, self.breaks[k], self._sparse, self.touched[k], self.coefficients[k])

    @cached_property
    def _sparse(self) -> sp.csr_matrix:
        return sp.csr_matrix(self.values)

    def polynomials(self, breaks: Array) -> RowPolynomials:
        """All rows on these breaks (k + 1,) in m, which hold their own."""
        return RowPolynomials.of([self.row(k, str(k)).refined(breaks) for k in range(len(self.breaks))])

    def on(self, X: Array) -> CarriedRows:
        """In other coordinates, q = X z with X (r, k)."""
        return replace(self, values=self.values @ X)

    def with_rows(self, numbers: Sequence[int]) -> CarriedRows:
        """Return the carriers with none but these rows."""
        return replace(
            self,
            breaks={str(k): self.breaks[str(number)] for k, number in enumerate(numbers)},
            touched={str(k): self.touched[str(number)] for k, number in enumerate(numbers)},
            coefficients={str(k): self.coefficients[str(number)] for k, number in enumerate(numbers)},
        )

    def truncated(self, r: int, modes: EnrichmentModes) -> CarriedRows:
        """Return the rows on the first r coordinates; the other `modes` join flexibility and enrichment modes."""
        values, beyond = self.values[:, :r], self.values[:, r:]
        return replace(self._joined(beyond, modes, 1.0), values=values, enrichment=np.hstack([beyond, self.enrichment]))

    def extended(self, modes: EnrichmentModes) -> CarriedRows:
        """Make the first enrichment modes, the `modes`, coordinates: the reverse of `truncated`."""
        back, enrichment = self.enrichment[:, : modes.count], self.enrichment[:, modes.count :]
        return replace(self._joined(back, modes, -1.0), values=np.hstack([self.values, back]), enrichment=enrichment)

    def _joined(self, U: Array, modes: EnrichmentModes, sign: float) -> CarriedRows:
        """Add the flexibility of modes that measure U (K, c) on the carriers, or take it out where `sign` is -1."""
        assert self.flexibility is not None
        flexibility = self.flexibility.joined(U, modes, sign / modes.stiffness)
        inertia = None if self.inertia is None else self.inertia.joined(U, modes, sign / modes.stiffness**2)
        answers = None if self.answers is None else self.answers.joined(U, modes, sign)
        return replace(self, flexibility=flexibility, inertia=inertia, answers=answers)

    def contradiction(self, m: int) -> str | None:
        """Describe what is wrong with b(x) of the m rows; None where all is sound."""
        for k in map(str, range(m)):
            x, touched, b = self.breaks[k], self.touched[k], self.coefficients[k]
            if x.ndim != 1 or touched.ndim != 2 or len(touched) != len(x) - 1 or not np.all(np.diff(x) > 0.0):
                return f"the carriers' row {k} has breaks that do not increase, or not one more than intervals"
            if b.ndim != 3 or b.shape[1:] != touched.shape or not np.isfinite(b).all():
                return f"the carriers' row {k} has coefficients of shape {b.shape} or that are not finite"
            if not np.all((touched >= 0) & (touched < len(self.values))):
                return f"the carriers' row {k} touches a carrier that there is none of"
        answers = self.answers
        least = self.values.shape[1] + (0 if answers is None else answers.rows.shape[1] - answers.turned.shape[1])
        if (p := len(self.spanned)) and (
            self.spanned.shape[1] < len(self.values) or not np.isfinite(self.spanned).all()
        ):
            return f"the carriers' spanned has shape {self.spanned.shape} or is not finite"
        least += p
        for name, A in self.matrices.items():
            if A.shape != (len(A), len(A)) or len(A) < least or not np.isfinite(A).all():
                return f"the carriers' matrices.{name} has shape {A.shape} or is not finite"
            least = len(A)
        for name, row in self.ports.items():
            if row.shape != (len(row),) or len(row) < least or not np.isfinite(row).all():
                return f"the carriers' ports.{name} has shape {row.shape} or is not finite"
        return None
