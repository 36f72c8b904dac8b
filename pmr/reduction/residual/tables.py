"""Residual flexibility as exact piecewise polynomials in s: products of the rows' polynomials with R on the path."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.constraints.rows import SharedCarriers
from pmr.fem.matrices import local_csr
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.symmetry import Orbits, images_of
from pmr.reduced.carriers import CarrierFlexibility
from pmr.reduced.flexibility import Flexibility
from pmr.reduction.residual.operator import ResidualFlexibility

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
_log = logging.getLogger(__name__)

#: Loads answered at a time for each rank: a few times as many vectors of full length are in memory.  A column costs a
#: tenth of what it costs alone, and more at a time would not make it cheaper (70,000 coordinates of a shell).
BLOCK = 64


class Measured:
    """What sparse rows (m, n_local), which touch a few coordinates, measure of tall columns."""

    def __init__(self, rows: sp.spmatrix) -> None:
        rows = sp.csr_matrix(rows)
        self._touched = np.unique(rows.indices)
        self._rows = rows[:, self._touched]

    def of(self, x: Array) -> Array:
        """This rank's part (m, k) of rows times x (n_local, k)."""
        return np.asarray(self._rows @ x[self._touched])


@dataclass(frozen=True)
class LoadFlexibility:
    """R between loads, those on K carriers first and the inputs behind them, and outputs."""

    pairs: sp.csr_matrix  # (L, L) m/N, between loads, for the pairs that were asked for
    outputs: Array  # (o, L) m/N
    carriers: int  # K

    @property
    def inputs(self) -> Array:
        """(L, i), m/N."""
        return np.asarray(self.pairs[:, self.carriers :].toarray())

    def between_any_two(self) -> CarrierFlexibility:
        """Where all pairs were asked for."""
        whole, K = self.pairs.toarray(), self.carriers
        return CarrierFlexibility(whole[:K, :K], whole[:K, K:], self.outputs[:, :K], self.outputs[:, K:], whole[K:, K:])


class Pairs:
    """Numbers for pairs of loads, block by block, where a symmetric `pattern` (L, L) has an entry."""

    def __init__(self, pattern: sp.csr_matrix) -> None:
        self._pattern = pattern
        self._found: list[tuple[Indices, Indices, Array]] = [(np.empty(0, int), np.empty(0, int), np.empty(0))]

    def beside(self, numbers: Indices) -> Indices:
        """Loads that make a pair with one of these."""
        return np.unique(self._pattern[numbers].indices)

    def put(self, rows: Indices, columns: Indices, values: Array) -> None:
        """Values (rows, columns), this rank's part."""
        block = self._pattern[rows][:, columns].tocoo()
        self._found.append((rows[block.row], columns[block.col], values[block.row, block.col]))

    def total(self, comm: Any) -> sp.csr_matrix:
        """All of them (L, L), made symmetric; collective."""
        rows, columns, values = (np.concatenate(parts) for parts in zip(*self._found, strict=True))
        found = sp.csr_matrix((comm.allreduce(values), (rows, columns)), self._pattern.shape)
        return (found + found.T) / 2.0


def meeting(shared: SharedCarriers, inputs: int) -> sp.csr_matrix:
    """Pairs (L, L) of loads on carriers that rows touch at the same place, and of inputs with all.

    All that tables at one path coordinate take: on the path of a beam each load meets a few others, however fine the
    mesh.
    """
    k = len(shared.rows[0].breaks) - 1
    at = np.concatenate([np.broadcast_to(np.arange(k)[:, None], row.touched.shape).ravel() for row in shared.rows])
    touched = np.concatenate([row.touched.ravel() for row in shared.rows])
    of_carriers = sp.csr_matrix((np.ones(len(at)), (at, touched)), (k, shared.carriers.shape[0]))
    of_all = sp.hstack([of_carriers, np.ones((k, inputs))], format="csr")
    return sp.csr_matrix(of_all.T @ of_all)


def any_two(shared: SharedCarriers, inputs: int) -> sp.csr_matrix:
    """All pairs (L, L): what rows take that travel independently."""
    count = shared.carriers.shape[0] + inputs
    return sp.csr_matrix(np.ones((count, count)))


class OnCarriers:
    """What loads on carriers, inputs and outputs measure of the answers to the loads; of pairs as `Pairs` has them."""

    def __init__(self, model: FullModel, carriers: sp.csr_matrix, pattern: sp.csr_matrix) -> None:
        self._rows, self._outputs = carrier_loads(model, carriers).T.tocsr(), Measured(local_csr(model.outputs).T)
        self._comm, self._carriers, self._pairs = model.comm, carriers.shape[0], Pairs(pattern)
        self._found = np.empty((model.outputs.getSize()[1], pattern.shape[0]))

    def take(self, numbers: Indices, answers: Array) -> None:
        """This rank's rows (n_local, k) of the answers to the loads with these numbers."""
        others = self._pairs.beside(numbers)
        self._pairs.put(others, numbers, Measured(self._rows[others]).of(answers))
        self._found[:, numbers] = self._outputs.of(answers)

    def result(self) -> LoadFlexibility:
        """Of all of them, once they are there; collective."""
        outputs = np.asarray(self._comm.allreduce(self._found))
        return LoadFlexibility(self._pairs.total(self._comm), outputs, self._carriers)


class Consumer(Protocol):
    """Who sees the answers to all loads, by the numbers of these and in an order of its own."""

    @property
    def order(self) -> Indices:
        """Numbers of the loads."""

    def take(self, numbers: Indices, answers: Array) -> None:
        """This rank's rows (n_local, k) of R times the loads with these numbers."""


def load_flexibility(
    residual: ResidualFlexibility,
    carriers: sp.csr_matrix,
    pattern: sp.csr_matrix,
    consumer: Consumer | None = None,
) -> LoadFlexibility:
    """R on carriers (K, n) and on the inputs, whose answers a `consumer` may use; collective.

    Each takes a static solve, but for those that are mirror images of others.

    R is kept for the pairs of loads of a `pattern` (L, L), that of `meeting` or `any_two`.
    """
    model = residual.model
    loads, found = carrier_loads(model, carriers), OnCarriers(model, carriers, pattern)
    order = np.arange(loads.shape[1]) if consumer is None else consumer.order
    images = images_of(carriers, [P for P in model.mirrors if residual.keeps(P)])
    orbits = Orbits(order, images, model.M)
    _log.info(
        "%d static solves answer loads on %d carriers and %d inputs",
        len(orbits.own),
        carriers.shape[0],
        loads.shape[1] - carriers.shape[0],
    )
    many = min(BLOCK, 2 * BLOCK // (1 + len(images))) * model.comm.size
    for k in range(0, len(orbits.own), many):
        own = orbits.own[k : k + many]
        for answers in orbits.answers(own, residual.apply(loads[:, own].toarray(order="F"))):
            found.take(answers.numbers, answers.columns)
            if consumer is not None:
                consumer.take(answers.numbers, answers.columns)
    orbits.drop()
    return found.result()


def tables(flexibility: LoadFlexibility, shared: SharedCarriers) -> Flexibility:
    """Tables of rows on common carriers and breaks, all of them at the same path coordinate."""
    C, breaks, K = stacked(shared), shared.rows[0].breaks, flexibility.carriers
    inputs = flexibility.inputs
    return Flexibility(
        rows=PPoly(_squared(C, flexibility.pairs[:K, :K]), breaks),
        inputs=PPoly(C.times(inputs[:K]), breaks),
        outputs=PPoly(C.times(flexibility.outputs[:, :K].T).swapaxes(2, 3), breaks),
        direct=flexibility.outputs[:, K:],
        energy=inputs[K:],
    )


def carrier_loads(model: FullModel, carriers: sp.csr_matrix) -> sp.csc_matrix:
    """Unit loads on the carriers, then the inputs: this rank's rows."""
    share = slice(*model.M.getOwnershipRange())
    return sp.hstack([carriers[:, share].T, local_csr(model.inputs)], format="csc")


@dataclass(frozen=True)
class Polynomials:
    """Coefficients of m rows on k intervals, one sparse row for each interval, row and power, in this order."""

    entries: sp.csr_matrix
    shape: tuple[int, int, int]

    def times(self, X: Array) -> Array:
        """Coefficients (powers, k, m, c) of C(s) X."""
        return np.moveaxis((self.entries @ X).reshape(*self.shape, X.shape[1]), 2, 0)

    def on(self, interval: int) -> tuple[Indices, Array]:
        """Numbers (d,) of the carriers that the rows touch on one interval, and coefficients there, (m powers, d)."""
        size = self.shape[1] * self.shape[2]
        ends = self.entries.indptr[interval * size : (interval + 1) * size + 1]
        which = slice(ends[0], ends[-1])
        touched, column = np.unique(self.entries.indices[which], return_inverse=True)
        dense = np.zeros((size, len(touched)))
        np.add.at(dense, (np.repeat(np.arange(size), np.diff(ends)), column), self.entries.data[which])
        return touched, dense

    def derivative(self) -> Polynomials:
        """Those of C'(s)."""
        k, m, powers = self.shape
        if powers == 1:
            return Polynomials(self.entries * 0.0, self.shape)
        exponents = np.tile(np.arange(powers - 1.0, -1.0, -1.0), k * m)
        rising = np.flatnonzero(exponents)
        return Polynomials(sp.csr_matrix(sp.diags(exponents[rising]) @ self.entries[rising]), (k, m, powers - 1))


def stacked(shared: SharedCarriers) -> Polynomials:
    """Coefficients of rows on common carriers and breaks."""
    rows = shared.rows
    powers = max(len(row.coefficients) for row in rows)
    k, m = len(rows[0].breaks) - 1, len(rows)
    parts = []
    for a, row in enumerate(rows):
        lacking = powers - len(row.coefficients)
        p, j, d = np.indices(row.coefficients.shape)
        parts.append(
            (
                row.coefficients.ravel(),
                ((j * m + a) * powers + p + lacking).ravel(),
                row.touched[j, d].ravel(),
            )
        )
    values, at, columns = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    return Polynomials(
        sp.csr_matrix((values, (at, columns)), (k * m * powers, shared.carriers.shape[0])), (k, m, powers)
    )


def _squared(C: Polynomials, R: sp.csr_matrix) -> Array:
    """Coefficients (2 powers - 1, k, m, m) of C(s) R C(s)^T."""
    result = paired(C, R, C)
    return (result + result.swapaxes(2, 3)) / 2.0


def paired(C: Polynomials, R: sp.csr_matrix, E: Polynomials) -> Array:
    """Coefficients (powers + powers' - 1, k, m, m') of C(s) R E(s)^T.

    On an interval rows touch a few carriers only, so of R a small block counts, however long the path is.
    """
    (k, m, powers), (_, other, others) = C.shape, E.shape
    result = np.zeros((powers + others - 1, k, m, other))
    sides = [(*C.on(j), *E.on(j)) for j in range(k)]
    sizes = [len(at) * len(beside) for at, _, beside, _ in sides]
    rows = np.concatenate([np.repeat(at, len(beside)) for at, _, beside, _ in sides])
    columns = np.concatenate([np.tile(beside, len(at)) for at, _, beside, _ in sides])
    blocks = np.split(np.asarray(R[rows, columns]).ravel(), np.cumsum(sizes)[:-1])  # all at once: SciPy is slow at one
    for j, ((at, left, beside, right), block) in enumerate(zip(sides, blocks, strict=True)):
        product = (left @ block.reshape(len(at), len(beside)) @ right.T).reshape(m, powers, other, others)
        for p in range(powers):
            for q in range(others):
                result[p + q, j] += product[:, p, :, q]
    return result
