"""Residual flexibility as exact piecewise polynomials in s: products of the rows' polynomials with R on the path."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.constraints.rows import SharedCarriers
from pmr.fem.matrices import local_csr
from pmr.fullmodel.model import FullModel
from pmr.reduce.residual.operator import ResidualFlexibility
from pmr.reduced.carriers import CarrierFlexibility
from pmr.reduced.flexibility import Flexibility

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

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


class OnCarriers:
    """What carriers, inputs and outputs measure of the answers to loads on carriers and inputs."""

    def __init__(self, model: FullModel, carriers: sp.csr_matrix) -> None:
        loads, self._comm, self._carriers = carrier_loads(model, carriers), model.comm, carriers.shape[0]
        self._seen = Measured(sp.hstack([loads, local_csr(model.outputs)], format="csr").T)
        self._found = np.empty((loads.shape[1] + model.outputs.getSize()[1], loads.shape[1]))

    def take(self, numbers: Indices, answers: Array) -> None:
        """This rank's rows (n_local, k) of the answers to the loads with these numbers."""
        self._found[:, numbers] = self._seen.of(answers)

    def result(self) -> CarrierFlexibility:
        """Of all of them, once they are there; collective."""
        whole, K = np.asarray(self._comm.allreduce(self._found)), self._carriers
        own, outputs = whole[: whole.shape[1]], whole[whole.shape[1] :]
        own = (own + own.T) / 2.0
        return CarrierFlexibility(own[:K, :K], own[:K, K:], outputs[:, :K], outputs[:, K:], own[K:, K:])


class Consumer(Protocol):
    """Who sees the answers to all loads, by the numbers of these and in an order of its own."""

    @property
    def order(self) -> Indices:
        """Numbers of the loads."""
        ...

    def take(self, numbers: Indices, answers: Array) -> None:
        """This rank's rows (n_local, k) of R times the loads with these numbers."""
        ...


def carrier_flexibility(
    model: FullModel, residual: ResidualFlexibility, carriers: sp.csr_matrix, consumer: Consumer | None = None
) -> CarrierFlexibility:
    """R on carriers (K, n) and on the inputs, one static solve each, whose answers a `consumer` may use; collective."""
    loads, many, found = carrier_loads(model, carriers), BLOCK * model.comm.size, OnCarriers(model, carriers)
    order = np.arange(loads.shape[1]) if consumer is None else consumer.order
    for k in range(0, len(order), many):
        numbers = order[k : k + many]
        x = residual.apply(loads[:, numbers].toarray(order="F"))
        found.take(numbers, x)
        if consumer is not None:
            consumer.take(numbers, x)
    return found.result()


def tables(flexibility: CarrierFlexibility, shared: SharedCarriers) -> Flexibility:
    """Tables of rows on common carriers and breaks, all of them at the same path coordinate."""
    C, breaks = stacked(shared), shared.rows[0].breaks
    return Flexibility(
        rows=PPoly(_squared(C, flexibility.rows), breaks),
        inputs=PPoly(C.times(flexibility.inputs), breaks),
        outputs=PPoly(C.times(flexibility.outputs.T).swapaxes(2, 3), breaks),
        direct=flexibility.direct,
        energy=flexibility.energy,
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


def _squared(C: Polynomials, R: Array) -> Array:
    """Coefficients (2 powers - 1, k, m, m) of C(s) R C(s)^T."""
    result = paired(C, R, C)
    return (result + result.swapaxes(2, 3)) / 2.0


def paired(C: Polynomials, R: Array, E: Polynomials) -> Array:
    """Coefficients (powers + powers' - 1, k, m, m') of C(s) R E(s)^T.

    On an interval rows touch a few carriers only, so of R a small block counts, however long the path is.
    """
    (k, m, powers), (_, other, others) = C.shape, E.shape
    result = np.zeros((powers + others - 1, k, m, other))
    for j in range(k):
        (at, left), (beside, right) = C.on(j), E.on(j)
        product = (left @ R[np.ix_(at, beside)] @ right.T).reshape(m, powers, other, others)
        for p in range(powers):
            for q in range(others):
                result[p + q, j] += product[:, p, :, q]
    return result
