"""Inertia and damping of the residual flexibility as exact piecewise polynomials in s: R M R and R D R on the path."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.constraints.rows import SharedCarriers
from pmr.fem.distributed import times
from pmr.fullmodel.model import FullModel
from pmr.reduced.carriers import CarrierFlexibility
from pmr.reduced.flexibility import Flexibility, Inertia
from pmr.reduced.soundness import symmetric
from pmr.reduction.residual.operator import ResidualFlexibility
from pmr.reduction.residual.tables import LoadFlexibility, OnCarriers, Pairs, paired, stacked

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Share of the path by which breaks of different rows may be apart and still be one.
SLACK = 1e-6


@dataclass(frozen=True)
class ResidualProducts:
    """R M R in s^2 m/N and R D R in s m/N (L, L) between loads on carriers and inputs that meet."""

    mass: sp.csr_matrix
    damping: sp.csr_matrix


class PathProducts:
    """X^T A X of the answers X = R g to the loads on carriers and the inputs, for A = M, and D unless it is Rayleigh's.

    Tables need it for pairs that rows touch at the same place, and for the inputs.  So answers come in the order of the
    path, and those to carriers that are left behind are forgotten: of the reference boom's 546 some 120 are in memory.
    """

    def __init__(self, model: FullModel, shared: SharedCarriers, pattern: sp.csr_matrix) -> None:
        inputs = np.tile([-np.inf, np.inf], (len(model.input_names), 1))
        self._spans = np.concatenate([_spans(shared), inputs])
        self.order = np.argsort(self._spans[:, 0], kind="stable")
        self._operators = [model.M] if model.rayleigh is not None else [model.M, model.D]
        self._found = [Pairs(pattern) for _ in self._operators]
        self._awaited = np.ones(len(self.order), bool)
        self._held: list[tuple[Indices, Array]] = []

    def take(self, numbers: Indices, answers: Array) -> None:
        """The products with `answers` (n_local, k) to the loads with these numbers."""
        self._awaited[numbers] = False
        self._held.append((numbers, answers))
        for A, found in zip(self._operators, self._found, strict=True):
            product = times(A, answers)
            for others, x in self._held:
                values = x.T @ product
                found.put(others, numbers, values)
                if x is not answers:
                    found.put(numbers, others, values.T)
        reached = np.min(self._spans[self._awaited, 0], initial=np.inf)
        needed = [(others, x, self._spans[others, 1] > reached) for others, x in self._held]
        self._held = [
            (others, x) if still.all() else (others[still], np.asfortranarray(x[:, still]))
            for others, x, still in needed
            if still.any()
        ]

    def result(self, model: FullModel, flexibility: LoadFlexibility) -> ResidualProducts:
        """Of Rayleigh damping R D R = alpha R M R + beta R, since R K R = R; collective."""
        found = [pairs.total(model.comm) for pairs in self._found]
        if model.rayleigh is None:
            return ResidualProducts(*found)
        return ResidualProducts(found[0], model.rayleigh.of(found[0], flexibility.pairs))


class InertiaOnCarriers:
    """R M R of loads on carriers and inputs, one static solve more for each; any two of them may meet."""

    def __init__(self, residual: ResidualFlexibility, carriers: sp.csr_matrix, pattern: sp.csr_matrix) -> None:
        self._residual, self._found = residual, OnCarriers(residual.model, carriers, pattern)
        self.order = np.arange(pattern.shape[0])

    def take(self, numbers: Indices, answers: Array) -> None:
        """What `answers` (n_local, k) to the loads with these numbers move by their inertia."""
        self._found.take(numbers, self._residual.apply(times(self._residual.model.M, answers)))

    def result(self) -> CarrierFlexibility:
        """In s^2 m/N; collective."""
        return self._found.result().between_any_two()


def _spans(shared: SharedCarriers) -> Array:
    """Stretch of the path (K, 2), m, on which rows touch each carrier, and a little more."""
    spans = np.tile([np.inf, -np.inf], (shared.carriers.shape[0], 1))
    for row in shared.rows:
        slack = SLACK * (row.breaks[-1] - row.breaks[0])
        np.minimum.at(spans[:, 0], row.touched, row.breaks[:-1, None] - slack)
        np.maximum.at(spans[:, 1], row.touched, row.breaks[1:, None] + slack)
    return spans


def with_inertia(flexibility: Flexibility, products: ResidualProducts, shared: SharedCarriers) -> Flexibility:
    """The tables with those of the residual part's inertia and damping, on the same breaks.

    They mean something for a basis of eigenmodes only: any other one couples with the residual part by inertia.
    """
    breaks, of_mass, of_damping = flexibility.rows.x, products.mass, products.damping
    C, p = stacked(shared), shared.carriers.shape[0]
    C1 = C.derivative()
    C2 = C1.derivative()

    def table(coefficients: Array) -> PPoly:
        return PPoly(coefficients, breaks)

    inertia = Inertia(
        A0=table(symmetric(paired(C, of_mass[:p, :p], C))),
        A1=table(paired(C, of_mass[:p, :p], C1)),
        A2=table(paired(C, of_mass[:p, :p], C2)),
        E0=table(C.times(of_mass[:p, p:].toarray())),
        D0=table(symmetric(paired(C, of_damping[:p, :p], C))),
        D1=table(paired(C, of_damping[:p, :p], C1)),
        F0=table(C.times(of_damping[:p, p:].toarray())),
    )
    return replace(flexibility, inertia=inertia)
