r"""Rows of a reduced body on carriers, as constants: any number of rows, each with a path coordinate of its own.

A row c(x) = b(x) U of the full body has the weights b(x) and the carriers U (`pmr.system.rows`).  For two rows rho and
sigma, at the path coordinates x and y, with the basis V and the flexibility R that V leaves out,

.. math::
    c(x)\, V = b(x)\, (U V), \qquad c_\rho(x)\, R\, c_\sigma(y)^T = b_\rho(x)\, (U R U^T)\, b_\sigma(y)^T

so rows that travel independently need no table in two variables.  If all rows share one path coordinate, the tables of
`Flexibility` are these products, multiplied out on demand; files have the factors alone (`pack_model`).  The residual
flexibility is the static response of the truncated coordinates.  The first modes of the truncated part are stored too
(`EnrichmentModes`).

With q = V p + R (B f - C^T lambda) for coordinates p, loads f, multipliers lambda and pads of the compliance 1/k, the
rows and outputs y become

.. math::
    C V p + H f - (G + 1/k) \lambda = 0, \qquad y = O V p + W f - X \lambda, \qquad
    G = C R C^T, \quad H = C R B, \quad X = O R C^T, \quad W = O R B

(static correction after MacNeal 1971 and Rubin 1975, here with rows C(s) that move).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import attrgetter
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.files import npz
from pmr.files.arrays import Array, Indices
from pmr.system.body_matrices import describe_misfit, symmetric_part
from pmr.system.polynomials import apply_table, select_columns, select_rows, transpose
from pmr.system.rows import Row, RowPolynomials


@dataclass(frozen=True)
class Flexibility:
    """Tables of the residual flexibility of a body with m rows, i inputs and o outputs over its path coordinate s."""

    AXES = {"rows": "mm", "inputs": "mi", "outputs": "om", "direct": "oi", "energy": "ii"}

    rows: PPoly  # G(s) = C R C^T (m, m) m/N: displacement at one row under a unit force at another
    inputs: PPoly  # H(s) = C R B (m, i) m/N
    outputs: PPoly  # X(s) = O R C^T (o, m) m/N
    direct: Array  # W = O R B (o, i) m/N
    energy: Array  # B^T R B (i, i) m/N: twice the residual strain energy under unit inputs

    def with_rows(self, numbers: Sequence[int]) -> Flexibility:
        """Return the flexibility of the body with only the rows `numbers`, in this order and numbered anew from 0."""
        rows, inputs = (select_rows(table, numbers) for table in (self.rows, self.inputs))
        outputs = select_columns(self.outputs, numbers)
        return replace(self, rows=select_columns(rows, numbers), inputs=inputs, outputs=outputs)

    def row_motion(self, s: Array, multipliers: Array, loads: Array) -> Array:
        """Motion H(s) f - G(s) lambda (T, m) in m of the residual part at the rows, at T times.

        The path coordinates are s (T,) in m, the `multipliers` lambda (T, m) in N and the `loads` f (T, i).
        """
        return apply_table(self.inputs, s, loads) - apply_table(self.rows, s, multipliers)

    def input_motion(self, s: Array, multipliers: Array, loads: Array) -> Array:
        """Motion B^T R (B f - C(s)^T lambda) (T, i) in m of the residual part at the inputs, at T times.

        The path coordinates are s (T,) in m, the `multipliers` lambda (T, m) in N and the `loads` f (T, i).
        """
        return np.asarray(loads @ self.energy - apply_table(transpose(self.inputs), s, multipliers))


class TablesOnDemand(Flexibility):
    """Tables of the residual flexibility of rows on carriers, multiplied out when one of them is first read."""

    AXES: dict[str, str] = {}  # noqa: RUF012 `carriers` are a part of the model, and are checked there
    carriers: CarrierRows
    breaks: Array  # (k + 1,) m: of the tables

    def __init__(self, carriers: CarrierRows, breaks: Array) -> None:
        assert carriers.flexibility is not None
        of_loads = {"direct": carriers.flexibility.direct, "energy": carriers.flexibility.energy}
        vars(self).update(carriers=carriers, breaks=breaks, **of_loads)

    @cached_property
    def product(self) -> Flexibility:
        """All tables, which need the carriers no longer."""
        assert self.carriers.flexibility is not None
        return self.carriers.flexibility.tables(self.carriers.polynomials(self.breaks))

    rows = property(attrgetter("product.rows"))
    inputs = property(attrgetter("product.inputs"))
    outputs = property(attrgetter("product.outputs"))

    def with_rows(self, numbers: Sequence[int]) -> TablesOnDemand:
        """Return the flexibility of the body with only the rows `numbers`, in this order and numbered anew from 0."""
        return TablesOnDemand(self.carriers.with_rows(numbers), self.breaks)


@dataclass(frozen=True)
class EnrichmentModes:
    """The first c modes phi that a model truncates, M-orthonormal, with ascending frequencies omega.

    The model has r coordinates, i inputs and o outputs.  The flexibility of these modes is part of the model's tables,
    and their values on the carriers are `CarrierRows.enrichment`.  The function `pmr.system.truncation.extend` makes
    the modes coordinates again.  So does the estimate of the model's error.
    """

    AXES = {"stiffness": "c", "damping": "c", "B": "ci", "outputs": "oc"}

    stiffness: Array  # omega^2 (c,) in (rad/s)^2
    damping: Array  # phi^T D phi = 2 zeta omega (c,) 1/s
    B: Array  # phi^T B (c, i)
    outputs: Array  # O phi (o, c)
    # (r + c, r + c), by name: `matrices` of the model with these modes as its last coordinates
    matrices: Mapping[str, Array] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Number of modes c."""
        return len(self.stiffness)


@dataclass(frozen=True)
class CarrierFlexibility:
    """Residual flexibility R between K carriers U, i inputs B and o outputs O."""

    AXES = {"rows": "KK", "inputs": "Ki", "outputs": "oK", "direct": "oi", "energy": "ii"}

    rows: Array  # U R U^T (K, K) m/N
    inputs: Array  # U R B (K, i) m/N
    outputs: Array  # O R U^T (o, K) m/N
    direct: Array  # O R B (o, i) m/N
    energy: Array  # B^T R B (i, i) m/N

    @classmethod
    def zero(cls, K: int, i: int, o: int) -> CarrierFlexibility:
        """Flexibility of zeros between K carriers, i inputs and o outputs."""
        return cls(*map(np.zeros, ((K, K), (K, i), (o, K), (o, i), (i, i))))

    def tables(self, C: RowPolynomials) -> Flexibility:
        """Tables over the path for rows with the weights C on these carriers, all at the same path coordinate."""
        outputs = transpose(C.times(self.outputs.T))
        return Flexibility(C.quadratic_form(self.rows), C.times(self.inputs), outputs, self.direct, self.energy)

    def add_modes(self, U: Array, modes: EnrichmentModes, share: Array) -> CarrierFlexibility:
        """Return the flexibility plus the sum of share_j phi_j phi_j^T over c modes phi_j.

        The values of the modes on the carriers are U (K, c).  `share` (c,) is 1 / omega^2 for truncated modes, and -1
        / omega^2 for modes that become coordinates.
        """
        scaled = share[:, None] * modes.B
        return CarrierFlexibility(
            rows=self.rows + symmetric_part(U * share @ U.T),
            inputs=self.inputs + U @ scaled,
            outputs=self.outputs + modes.outputs * share @ U.T,
            direct=self.direct + modes.outputs @ scaled,
            energy=self.energy + symmetric_part(modes.B.T @ scaled),
        )


@dataclass(frozen=True)
class CylinderResponses:
    r"""Responses x_k, k = 1 to n, to a cylinder's force, on a row c: x_1 is static, the others are by inertia.

    .. math:: x_1 = R c^T, \qquad x_{k+1} = R M x_k

    R is the residual flexibility, for K carriers U, i inputs B and o outputs O.  If an eigenmode :math:`\varphi` with
    the frequency :math:`\omega` joins R, each :math:`x_k` gains :math:`\varphi\, (c \varphi) / \omega^{2k}`; if the
    mode leaves R, :math:`x_k` loses this.
    """

    AXES = {"load": "K", "rows": "Kn", "inputs": "in", "outputs": "on", "stiffness": "nn", "inertia": "nn"}
    AXES |= {"supports": "hn", "turned": "ka"}

    load: Array  # (K,): weights of the row c on the carriers
    rows: Array  # U x (K, n): in m/N for k = 1, in s^2 m/N for k = 2, and so on
    inputs: Array  # B^T x (i, n)
    outputs: Array  # O x (o, n)
    stiffness: Array  # x^T K x (n, n)
    inertia: Array  # x^T M x (n, n)
    supports: Array  # Phi^T M x (h, n), Phi as in `pmr.system.body_matrices`; of the largest basis only
    # (k, a): combinations of the first k responses that are the last a coordinates of the model; a may be 0
    turned: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def mode_shares(self, U: Array, modes: EnrichmentModes) -> Array:
        """Shares (c, n) of c modes in each of the n responses, from the modes' values U (K, c) on the carriers."""
        powers = np.arange(1, self.rows.shape[1] + 1)
        return np.asarray((self.load @ U)[:, None] / modes.stiffness[:, None] ** powers)

    def add_modes(self, U: Array, modes: EnrichmentModes, sign: float) -> CylinderResponses:
        """Return the responses with the `modes` added to the residual flexibility (`sign` 1) or removed from it (-1).

        The values of the modes on the carriers are U (K, c).
        """
        shares = self.mode_shares(U, modes)
        return replace(
            self,
            rows=self.rows + sign * U @ shares,
            inputs=self.inputs + sign * modes.B.T @ shares,
            outputs=self.outputs + sign * modes.outputs @ shares,
            stiffness=self.stiffness + sign * shares.T @ (modes.stiffness[:, None] * shares),
            inertia=self.inertia + sign * shares.T @ shares,
        )


@dataclass(frozen=True)
class CarrierRows:
    """The m rows of a body with r coordinates on K carriers U, and the flexibility that these coordinates leave out."""

    AXES = {"values": "Kr", "enrichment": "Kc", "support_inertia": "hL"}

    values: Array  # U V (K, r): values of the coordinates on the carriers
    # weights b(x) of each row, as `pmr.system.rows.Row` has them, by the row's number as text: "0", "1", ...
    breaks: Mapping[str, Array]
    touched: Mapping[str, Indices]
    coefficients: Mapping[str, Array]
    enrichment: Array  # U phi (K, c) of the model's enrichment modes
    flexibility: CarrierFlexibility | None = None  # residual flexibility R between the carriers
    # R M R between the carriers, in s^2 m/N: response to inertia forces of the static response (`pmr.compare.estimate`)
    inertia: CarrierFlexibility | None = None
    # responses to the force of the cylinder of a boom's section (`pmr.system.attachment`)
    answers: CylinderResponses | None = None
    # by name: the model's `matrices` between N + p + n vectors: N of the largest basis, p that span the residual
    # responses to loads on carriers and inputs (p is 0 if these loads are many), and the n responses of `answers`, if
    # any
    matrices: Mapping[str, Array] = field(default_factory=dict)
    ports: Mapping[str, Array] = field(default_factory=dict)  # `ports` of the model on these vectors, (N + p + n,)
    spanned: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (p, K + i): residual responses by p vectors
    # Phi^T M R [U^T B] (h, K + i) of unit motions Phi of h rigid supports (`pmr.system.body_matrices`), of the largest
    # basis only; in s^2 for forces
    support_inertia: Array | None = None
    # by name: work (h, N + p + n) of `matrices` on the motions of h rigid supports (`pmr.system.body_matrices`)
    supports: Mapping[str, Array] = field(default_factory=dict)

    @classmethod
    def from_rows(
        cls, rows: Sequence[Row], values: Array, flexibility: CarrierFlexibility | None = None
    ) -> CarrierRows:
        """Rows on common carriers U, without enrichment modes; `values` are U V (K, r) for the basis V.

        `flexibility` is the residual flexibility on the carriers, or None if nothing is known of what the basis leaves
        out.  Row number k is stored under the text of k: "0", "1" and so on.
        """
        breaks, touched, coefficients = (
            {str(k): getattr(row, name) for k, row in enumerate(rows)} for name in ("breaks", "touched", "coefficients")
        )
        return cls(np.asarray(values), breaks, touched, coefficients, np.zeros((len(values), 0)), flexibility)

    def row(self, number: int, name: str) -> Row:
        """Return the row with the `number`, called `name`, on the r coordinates; it has no compliance or clearance."""
        k = str(number)
        return Row(name, self.breaks[k], self._sparse_values, self.touched[k], self.coefficients[k])

    @cached_property
    def _sparse_values(self) -> sp.csr_matrix:
        """The array `values` as a sparse matrix: the carriers of all rows that the method `row` returns."""
        return sp.csr_matrix(self.values)

    def polynomials(self, breaks: Array) -> RowPolynomials:
        """Weights b(x) of all rows on the `breaks` (k + 1,) in m, which must contain the breaks of each row."""
        return RowPolynomials.from_rows([self.row(k, str(k)).refine(breaks) for k in range(len(self.breaks))], breaks)

    def project(self, X: Array) -> CarrierRows:
        """Return the rows on new coordinates z (k,), from which the old ones follow as X z, with X (r, k).

        The flexibility does not change; if k < r, it lacks the motions that the new coordinates leave out.
        """
        return replace(self, values=self.values @ X)

    def with_rows(self, numbers: Sequence[int]) -> CarrierRows:
        """Return the same carriers with only the rows `numbers`, in this order and numbered anew from 0."""
        return replace(
            self,
            breaks={str(k): self.breaks[str(number)] for k, number in enumerate(numbers)},
            touched={str(k): self.touched[str(number)] for k, number in enumerate(numbers)},
            coefficients={str(k): self.coefficients[str(number)] for k, number in enumerate(numbers)},
        )

    def truncate(self, r: int, modes: EnrichmentModes) -> CarrierRows:
        """Return the rows on the first r coordinates.

        The other coordinates are the given `modes`: they join the flexibility and become the first enrichment modes.
        """
        values, beyond = self.values[:, :r], self.values[:, r:]
        return replace(
            self._add_modes(beyond, modes, 1.0), values=values, enrichment=np.hstack([beyond, self.enrichment])
        )

    def extend(self, modes: EnrichmentModes) -> CarrierRows:
        """Return the rows with the first enrichment modes, `modes`, as last coordinates, which undoes `truncate`."""
        back, enrichment = self.enrichment[:, : modes.count], self.enrichment[:, modes.count :]
        return replace(self._add_modes(back, modes, -1.0), values=np.hstack([self.values, back]), enrichment=enrichment)

    def _add_modes(self, U: Array, modes: EnrichmentModes, sign: float) -> CarrierRows:
        """Return the rows with `modes` added to (`sign` 1) or removed from (-1) flexibility, inertia and responses.

        The values of the modes on the carriers are U (K, c).
        """
        assert self.flexibility is not None
        flexibility = self.flexibility.add_modes(U, modes, sign / modes.stiffness)
        inertia = None if self.inertia is None else self.inertia.add_modes(U, modes, sign / modes.stiffness**2)
        answers = None if self.answers is None else self.answers.add_modes(U, modes, sign)
        return replace(self, flexibility=flexibility, inertia=inertia, answers=answers)

    def contradiction(self, m: int) -> str | None:
        """Description of the first fault of the arrays, which have to be those of m rows; None if they are sound."""
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
        spans_all = self.spanned.shape[1] >= len(self.values) and np.isfinite(self.spanned).all()
        if len(self.spanned) and not spans_all:
            return f"the carriers' spanned has shape {self.spanned.shape} or is not finite"
        least += len(self.spanned)
        for name, A in self.matrices.items():
            if A.shape != (len(A), len(A)) or len(A) < least or not np.isfinite(A).all():
                return f"the carriers' matrices.{name} has shape {A.shape} or is not finite"
            least = len(A)
        for name, row in self.ports.items():
            if row.shape != (len(row),) or len(row) < least or not np.isfinite(row).all():
                return f"the carriers' ports.{name} has shape {row.shape} or is not finite"
        return None


#: Prefix of arrays that may be written as triangles, and smallest size of such matrices.
TRIANGLES, LEAST = "carriers.", 8
_SIGNS = {"triangle": 1.0, "antitriangle": -1.0}


def pack_model(model: Any, prefix: str = "") -> dict[str, NDArray[Any]]:
    """Arrays of a reduced model in the form in which files have them, by `prefix` and the field's name.

    The model is a `pmr.system.reduced_model.ReducedModel`.  The arrays (any shape) are those of `pmr.files.npz`, with
    two exceptions.  If a table over the path follows from values on the carriers, as C = b (U V) and G = b R b^T do,
    only its breaks are stored.  For a symmetric matrix between carriers, or between vectors, only the lower triangle is
    stored, row by row, as ``name.triangle``; for an antisymmetric matrix, as ``name.antitriangle``.
    """
    flexibility, carriers = model.flexibility, model.carriers
    on_demand = carriers is not None and isinstance(flexibility, TablesOnDemand)
    if on_demand and flexibility.carriers.flexibility is carriers.flexibility:
        content = npz.record_arrays(replace(model, flexibility=None))
        del content["rows.coefficients"]
        content |= {f"flexibility.{name}": getattr(flexibility, name) for name in ("direct", "energy")}
        content |= {f"flexibility.{name}.breaks": model.rows.x for name in ("rows", "inputs", "outputs")}
    else:
        content = npz.record_arrays(model)
    compact = dict[str, NDArray[Any]]()
    for name, array in content.items():
        kind = _triangle_kind(array) if name.startswith(TRIANGLES) else None
        if kind is None:
            compact[prefix + name] = array
        else:
            compact[f"{prefix}{name}.{kind}"] = array[np.tril_indices(len(array))]
    return compact


def unpack_model(data: Mapping[str, NDArray[Any]], prefix: str = "") -> dict[str, NDArray[Any]]:
    """Arrays (any shape) of a model, in which stored triangles have become whole matrices again.

    `data` are all arrays of a file.  Those whose names begin with `prefix` are taken, and the names in the result begin
    with it, too, as `pmr.files.npz.record_from_arrays` reads them.  Matrices that earlier versions stored in full stay
    as they are.  Raises ValueError if a triangle has a wrong number of entries.
    """
    content = dict[str, NDArray[Any]]()
    for name, array in data.items():
        if name.startswith(prefix):
            name = name.removeprefix(prefix)
            stem, _, kind = name.rpartition(".")
            if kind in _SIGNS and name.startswith(TRIANGLES):
                content[stem] = _unpack_triangle(array, _SIGNS[kind])
            else:
                content[name] = array
    return {prefix + name: array for name, array in content.items()}


def describe_fault(carriers: CarrierRows) -> str | None:
    """Description of the carriers' first fault; None if tables can be computed from the carriers."""
    return describe_misfit(carriers, {}, TRIANGLES) or carriers.contradiction(len(carriers.breaks))


def _triangle_kind(A: Array) -> str | None:
    """``triangle`` if A (n, n) is symmetric, ``antitriangle`` if A is antisymmetric.

    None is returned for other arrays and for matrices with fewer than `LEAST` rows.
    """
    if A.ndim != 2 or A.shape[0] != A.shape[1] or len(A) < LEAST:
        return None
    return next((kind for kind, sign in _SIGNS.items() if np.array_equal(A, sign * A.T)), None)


def _unpack_triangle(triangle: Array, sign: float) -> Array:
    """Matrix (n, n) from its lower triangle, row by row: `triangle` (n (n + 1) / 2,).

    `sign` is 1 for a symmetric and -1 for an antisymmetric matrix.  Raises ValueError if `triangle` has another length.
    """
    n = int((np.sqrt(8.0 * triangle.size + 1.0) - 1.0) / 2.0 + 0.5)
    if triangle.shape != (n * (n + 1) // 2,):
        raise ValueError(f"{triangle.shape} is not the shape of a triangle of a matrix")
    square, below = np.empty((n, n)), np.tri(n, dtype=bool)
    square.T[below] = sign * triangle
    square[below] = triangle
    return square
