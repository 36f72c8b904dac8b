r"""Residual flexibility R that a basis leaves out: applied as an operator, never formed, and tabulated over the path.

The tables are exact piecewise polynomials in s: products of the rows' polynomials with R between carriers.

With rigid-body modes Z (Z^T M Z = I) and the rest of the basis W, combined so that W^T M W = I and W^T K W =
diag(theta),

.. math::
    R = P\, K^+ P^T, \qquad P = I - Z (M Z)^T - W (K W\, \mathrm{diag}(\theta)^{-1})^T

P^T removes from a load what the basis responds to and makes it self-equilibrated, so K^+ may be a solve with the
rigid-body modes held at any statically determinate set of coordinates; P removes the basis from the response.  For
eigenmodes R is the sum of phi phi^T / omega^2 over the modes left out; for any other basis it is K^-1 - V (V^T K V)^-1
V^T.  The basis and the responses of R are K-orthogonal in any case, and M-orthogonal too for eigenmodes.

On soft supports, K w = theta M w for a low mode w is small compared with the terms that it is the sum of, and is little
but round-off.  For a shell with theta = 2e-5 rad^2/s^2 for its lowest mode, and 2e3 for the first mode that bends,
three digits remained; its error was 0.7, 2.0 or 3.5 %, depending on which BLAS kernel the processor used.  If K w is
theta M w up to round-off, M w replaces K w / theta, since M w has all its digits.

Projecting on both sides avoids the cancellation of a difference: with 6 and 20 modes of a cantilever on 50 elements R
is off by 2e-10 and 6e-10 (scaled to a unit diagonal), K^-1 less the modal part by 1e-5 and 1e-4.  Projecting again
gains nothing.  MacNeal: A hybrid method of component mode synthesis, Computers & Structures 1, 1971, pp. 581-601; Craig
and Kurdila: Fundamentals of Structural Dynamics, 2nd ed., 2006, section 17.6 (inertia relief).
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import scipy.linalg
import scipy.sparse as sp

from pmr.errors import InputError, environment
from pmr.fem.compat import MPI, PETSc
from pmr.fem.distributed import free_objects, inner, local_csr, sparse, subtract, times
from pmr.files.arrays import Array, Indices
from pmr.fullmodel.model import FullModel
from pmr.reduction.free_body import FreeBody
from pmr.system.carriers import CarrierFlexibility, Flexibility
from pmr.system.polynomials import transpose
from pmr.system.rows import RowPolynomials, SharedCarriers

_log = logging.getLogger(__name__)


#: K w counts as theta M w of an eigenmode w if they differ by at most this many times the round-off in the terms of K
#: w.
ROUND_OFF = 100.0


class ResidualFlexibility:
    """Residual flexibility R of a model on its fixed rows, for a basis V (n_local, r), this rank's part; collective.

    V has to contain the rigid-body modes that loads or rows excite.
    """

    def __init__(self, body: FreeBody, V: Array) -> None:
        self.model = model = body.model
        self._body, self._comm = body, model.comm
        Z, MZ = body.Z, body.MZ
        self.rigid = body.are_rigid(V)  # (r,): which columns of the basis are motions of a rigid body
        W = V[:, ~self.rigid]
        W = W - Z @ inner(MZ, W, self._comm)
        W, dual = _diagonalise(model, W)
        self._basis = np.asfortranarray(np.hstack([Z, W]))
        self._dual = np.asfortranarray(np.hstack([MZ, dual]))

    def apply(self, g: Array) -> Array:
        """Product R g (n_local, k) in m, this rank's part, for loads g (n_local, k) in N; collective.

        The array g may be overwritten.
        """
        g = np.asfortranarray(g)
        subtract(g, self._dual, inner(self._basis, g, self._comm))
        x = np.asfortranarray(self._body.solve(g))
        subtract(x, self._basis, inner(self._dual, x, self._comm))
        return x

    def powers(self, c: Array, count: int) -> Array:
        """The `count` vectors R c, R M R c, ... (n_local, count), this rank's part, of one load c (n_local,).

        Collective.
        """
        columns = [self.apply(np.array(c)[:, None])]
        while len(columns) < count:
            columns.append(self.apply(times(self.model.M, columns[-1])))
        return np.asfortranarray(np.hstack(columns))


def terms(A: PETSc.Mat, X: Array) -> Array:
    """Product |A| |X| (n_local, k) of absolute values, which bounds the terms of A X and so its round-off; collective.

    X (n_local, k) and the result are this rank's parts.
    """
    sizes = sparse(abs(local_csr(A)), A, columns=A.getLocalSize()[1])
    sums = times(sizes, np.abs(X))
    free_objects(sizes)
    return sums


def _diagonalise(model: FullModel, W: Array) -> Array:
    """Combinations W of the given columns W, and K W over the diagonal of W^T K W, (2, n_local, k).

    The combinations satisfy W^T M W = I, and their W^T K W is diagonal.  For a column that is an eigenvector up to
    round-off, the second result is M W, which is more accurate.  Collective.
    """
    if W.shape[1] == 0:
        return np.array([W, W])
    comm = model.comm
    theta, Q = scipy.linalg.eigh(inner(W, times(model.K, W), comm), inner(W, times(model.M, W), comm))
    W = np.ascontiguousarray(W @ Q)
    KW, MW, of_K = times(model.K, W), times(model.M, W), terms(model.K, W)
    differs, size = (np.diagonal(inner(x, x, comm)) for x in (KW - theta * MW, of_K))
    return np.array([W, np.where(differs <= (ROUND_OFF * np.finfo(float).eps) ** 2 * size, MW, KW / theta)])


Pattern: TypeAlias = sp.csr_matrix | None

#: Number of loads solved for at a time on each rank: a few times as many vectors of full length are in memory.  A load
#: then costs a tenth of what it costs alone, and larger blocks would not make it cheaper (70,000 coordinates of a
#: shell).
BLOCK = 64
#: Bytes of memory above which a warning is logged.
NOTICED = 2**30


class SparseProduct:
    """Products of sparse rows (m, n_local), which touch a few coordinates only, with dense columns."""

    def __init__(self, rows: sp.spmatrix) -> None:
        rows = sp.csr_matrix(rows)
        self._touched = np.unique(rows.indices)
        self._rows = rows[:, self._touched]

    def multiply(self, x: Array) -> Array:
        """Product (m, k) of the rows with x (n_local, k); this rank's contribution to the sum over ranks."""
        return np.asarray(self._rows @ x[self._touched])


@dataclass(frozen=True)
class LoadFlexibility:
    """Residual flexibility R between L unit loads and o outputs; loads on K carriers come first, inputs follow."""

    pairs: sp.csr_matrix | Array  # (L, L) m/N between loads: sparse for the pairs of a pattern, dense for all
    outputs: Array  # (o, L) m/N
    carriers: int  # number K of loads on carriers

    @property
    def inputs(self) -> Array:
        """R (L, i) in m/N between all loads and the inputs."""
        return _dense(self.pairs[:, self.carriers :])

    def carrier_flexibility(self) -> CarrierFlexibility:
        """R between carriers, inputs and outputs as dense matrices.

        Only to be called if all pairs of loads have been computed.
        """
        dense, K = _dense(self.pairs), self.carriers
        return CarrierFlexibility(dense[:K, :K], dense[:K, K:], self.outputs[:, :K], self.outputs[:, K:], dense[K:, K:])


class PatternPairs:
    """Values for those pairs of loads at which a symmetric `pattern` (L, L) has an entry, stored block by block."""

    def __init__(self, pattern: sp.csr_matrix) -> None:
        self._pattern = pattern
        self._blocks: list[tuple[Indices, Indices, Array]] = [(np.empty(0, int), np.empty(0, int), np.empty(0))]

    def partners(self, numbers: Indices) -> Indices:
        """Numbers of the loads that form a pair with at least one of the loads with these `numbers`."""
        return np.unique(self._pattern[numbers].indices)

    def store(self, rows: Indices, columns: Indices, values: Array) -> None:
        """Store this rank's contribution `values` (rows, columns) for pairs of loads numbered `rows` and `columns`."""
        block = self._pattern[rows][:, columns].tocoo()
        self._blocks.append((rows[block.row], columns[block.col], values[block.row, block.col]))

    def total(self, comm: MPI.Comm) -> sp.csr_matrix:
        """Values (L, L) summed over the ranks and made symmetric; collective."""
        rows, columns, values = (np.concatenate(parts) for parts in zip(*self._blocks, strict=True))
        summed = sp.csr_matrix((comm.allreduce(values), (rows, columns)), self._pattern.shape)
        return (summed + summed.T) / 2.0


class AllPairs:
    """Values for all pairs of `count` loads."""

    def __init__(self, count: int) -> None:
        self._values, self._all = np.zeros((count, count)), np.arange(count)

    def partners(self, numbers: Indices) -> Indices:
        """Numbers of all loads."""
        return self._all

    def store(self, rows: Indices, columns: Indices, values: Array) -> None:
        """Store this rank's contribution `values` (L, columns) for loads numbered `columns`; `rows` are all loads."""
        self._values[:, columns] = values

    def total(self, comm: MPI.Comm) -> Array:
        """Values (L, L) summed over the ranks and made symmetric, in place; collective."""
        comm.Allreduce(MPI.IN_PLACE, self._values)
        self._values += self._values.T.copy()
        self._values /= 2.0
        return self._values


def _dense(A: sp.csr_matrix | Array) -> Array:
    """Matrix as a dense array."""
    return A if isinstance(A, np.ndarray) else np.asarray(A.toarray())


def load_pairs(shared_carriers: SharedCarriers, inputs: int) -> sp.csr_matrix:
    """Pattern (L, L) of those pairs of loads which tables at one path coordinate need.

    They are pairs of carriers that rows touch on the same interval, and pairs of an input with any load.  On the path
    of a beam each load pairs with a few others, however fine the mesh.
    """
    if not shared_carriers.rows:
        return sp.csr_matrix(np.ones((inputs, inputs)))
    k = len(shared_carriers.rows[0].breaks) - 1
    at = np.concatenate(
        [np.broadcast_to(np.arange(k)[:, None], row.touched.shape).ravel() for row in shared_carriers.rows]
    )
    touched = np.concatenate([row.touched.ravel() for row in shared_carriers.rows])
    of_carriers = sp.csr_matrix((np.ones(len(at)), (at, touched)), (k, shared_carriers.carriers.shape[0]))
    of_all = sp.hstack([of_carriers, np.ones((k, inputs))], format="csr")
    return sp.csr_matrix(of_all.T @ of_all)


class LoadValues:
    """Values on carriers, inputs and outputs of the responses to loads, for pairs of a pattern (None: all pairs)."""

    def __init__(self, model: FullModel, carriers: sp.csr_matrix, pattern: Pattern) -> None:
        self._rows, self._outputs = carrier_loads(model, carriers).T.tocsr(), SparseProduct(local_csr(model.outputs).T)
        self._comm, self._carriers, loads = model.comm, carriers.shape[0], self._rows.shape[0]
        self._all_rows = SparseProduct(self._rows)
        self._pairs = AllPairs(loads) if pattern is None else PatternPairs(pattern)
        self._output_values = np.empty((model.outputs.getSize()[1], loads))

    def store(self, numbers: Indices, answers: Array) -> None:
        """Store the values of the responses `answers` (n_local, k), this rank's part, to loads with these `numbers`."""
        partners = self._pairs.partners(numbers)
        is_all = len(partners) == self._rows.shape[0]
        rows = self._all_rows if is_all else SparseProduct(self._rows[partners])
        self._pairs.store(partners, numbers, rows.multiply(answers))
        self._output_values[:, numbers] = self._outputs.multiply(answers)

    def result(self) -> LoadFlexibility:
        """Flexibility of all loads, after the responses to all loads have been stored; collective."""
        outputs = np.asarray(self._comm.allreduce(self._output_values))
        return LoadFlexibility(self._pairs.total(self._comm), outputs, self._carriers)


def check_memory(model: FullModel, carriers: int, powers: int) -> None:
    """Raise an InputError if the tables of `powers` matrices (carriers, carriers) don't fit in memory; collective.

    The number of carriers grows with the ratio of the path's length to the length of the shortest pad.  If the tables
    need more than `NOTICED` bytes, a warning is logged.
    """
    needed = 8 * carriers**2 * (powers + 2)  # bytes; making one symmetric takes two more
    free = model.comm.bcast(environment.available_memory() if model.comm.rank == 0 else None)
    message = f"pads have {carriers:,} stations along their paths, which takes about {needed / 1e9:.1f} GB of memory"
    if free is not None and needed > free:
        allowed = f"{message}, {free / 1e9:.1f} GB are free; longer pads, or a shorter path, are allowed"
        raise InputError("scene", "pads.length", None, allowed)
    if needed > NOTICED and model.comm.rank == 0:
        _log.warning("%s; longer pads take less", message)


def load_powers(
    residual: ResidualFlexibility, carriers: sp.csr_matrix, pattern: Pattern, count: int
) -> list[LoadFlexibility]:
    """The first `count` of R, R M R, ... between carriers (K, n), inputs and outputs; collective.

    R is in m/N, R M R in s^2 m/N, and so on.  For each load, each of these takes one static solve.  The values are
    stored for the pairs of loads in a `pattern` (L,
    L), as `load_pairs` returns it, or for all pairs (None).
    """
    model = residual.model
    if pattern is None:
        check_memory(model, carriers.shape[0], count)
    loads, tables = carrier_loads(model, carriers), [LoadValues(model, carriers, pattern) for _ in range(count)]
    _log.info(
        "%d static solves answer loads on %d carriers and %d inputs",
        count * loads.shape[1],
        carriers.shape[0],
        loads.shape[1] - carriers.shape[0],
    )
    many = BLOCK * model.comm.size
    for k in range(0, loads.shape[1], many):
        numbers = np.arange(k, min(k + many, loads.shape[1]))
        columns = loads[:, numbers].toarray(order="F")
        for power, table in enumerate(tables):
            columns = residual.apply(times(model.M, columns) if power else columns)
            table.store(numbers, columns)
    return [table.result() for table in tables]


def tables(flexibility: LoadFlexibility, shared_carriers: SharedCarriers, domain: tuple[float, float]) -> Flexibility:
    """Residual flexibility of rows on common carriers as tables in s: G = C R C^T, H = C R B and X = O R C^T.

    All rows have the same breaks and the same path coordinate s, on `domain` in m.  The constants W = O R B and
    B^T R B are part of the result.
    """
    breaks = shared_carriers.rows[0].breaks if shared_carriers.rows else np.array(domain)
    C, K = RowPolynomials.from_rows(shared_carriers.rows, breaks), flexibility.carriers
    inputs = flexibility.inputs
    return Flexibility(
        rows=C.quadratic_form(flexibility.pairs[:K, :K]),
        inputs=C.times(inputs[:K]),
        outputs=transpose(C.times(flexibility.outputs[:, :K].T)),
        direct=flexibility.outputs[:, K:],
        energy=inputs[K:],
    )


def carrier_loads(model: FullModel, carriers: sp.csr_matrix) -> sp.csc_matrix:
    """Unit loads (n_local, L) on the carriers, then on the inputs, this rank's part."""
    return sp.hstack([carriers[:, model.share].T, local_csr(model.inputs)], format="csc")
