"""Inertia and damping of the residual flexibility as exact piecewise polynomials in s: R M R and R D R on the path."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.constraints.rows import SharedCarriers
from pmr.fem.compat import PETSc
from pmr.fem.distributed import times
from pmr.fullmodel.model import FullModel
from pmr.reduce.residual.tables import Measured, carrier_loads, paired, stacked
from pmr.reduced.flexibility import Flexibility
from pmr.reduced.inertia import Inertia

Array = NDArray[np.float64]


def with_inertia(
    flexibility: Flexibility, model: FullModel, answers: list[Array], shared: SharedCarriers
) -> Flexibility:
    """The tables with those of the residual part's inertia and damping, on the same breaks; collective.

    `answers` are those that `pmr.reduce.residual.tables.carrier_flexibility` got on the same carriers: no more solves.
    They mean something for a basis of eigenmodes only: any other one couples with the residual part by inertia.
    """
    breaks = flexibility.rows.x
    of_mass = _squared(model.M, answers)
    of_damping = _damped(model, answers, of_mass, shared)
    C, p = stacked(shared), shared.carriers.shape[0]
    C1 = C.derivative()
    C2 = C1.derivative()

    def table(coefficients: Array) -> PPoly:
        return PPoly(coefficients, breaks)

    inertia = Inertia(
        A0=table(_symmetric(paired(C, of_mass[:p, :p], C))),
        A1=table(paired(C, of_mass[:p, :p], C1)),
        A2=table(paired(C, of_mass[:p, :p], C2)),
        E0=table(C.times(of_mass[:p, p:])),
        D0=table(_symmetric(paired(C, of_damping[:p, :p], C))),
        D1=table(paired(C, of_damping[:p, :p], C1)),
        F0=table(C.times(of_damping[:p, p:])),
    )
    return replace(flexibility, inertia=inertia)


def _damped(model: FullModel, answers: list[Array], of_mass: Array, shared: SharedCarriers) -> Array:
    """R D R; of Rayleigh damping alpha R M R + beta R, since R K R = R."""
    if model.rayleigh is None:
        return _squared(model.D, answers)
    loads = Measured(carrier_loads(model, shared.carriers).T)
    R = np.asarray(model.comm.allreduce(np.hstack([loads.of(x) for x in answers])))
    return model.rayleigh.of(of_mass, (R + R.T) / 2.0)


def _squared(A: PETSc.Mat, answers: list[Array]) -> Array:
    """X^T A X of the columns X in all blocks, the same on every rank: R A R on the path's loads and the inputs."""
    ends = np.cumsum([0, *(x.shape[1] for x in answers)])
    result = np.zeros((ends[-1], ends[-1]))
    for j, y in enumerate(answers):
        Ay = times(A, y)
        for i, x in enumerate(answers[: j + 1]):
            result[ends[i] : ends[i + 1], ends[j] : ends[j + 1]] = x.T @ Ay
    upper = np.triu(np.asarray(A.comm.tompi4py().allreduce(result)))
    return np.asarray(upper + np.triu(upper, 1).T)


def _symmetric(c: Array) -> Array:
    return (c + c.swapaxes(2, 3)) / 2.0
