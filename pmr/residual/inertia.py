"""Inertia and damping of the residual flexibility as exact piecewise polynomials in s: R M R and R D R on the path."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.carried import Path, path_of
from pmr.dolfinx_compat import PETSc
from pmr.flexibility import Flexibility
from pmr.inertia import Inertia
from pmr.operators import FullModel
from pmr.parallel import times
from pmr.residual.operator import ResidualFlexibility
from pmr.residual.tables import BLOCK, paired, path_loads, stacked
from pmr.sliding import Row

Array = NDArray[np.float64]


def with_inertia(
    flexibility: Flexibility, model: FullModel, residual: ResidualFlexibility, rows: Sequence[Row]
) -> Flexibility:
    """The tables with those of the residual part's inertia and damping, on the same breaks; collective.

    Two static solves for each coordinate that the rows touch and each input, mass and damping in between.  They mean
    something for a basis of eigenmodes only: any other one couples with the residual part by inertia.
    """
    breaks = flexibility.rows.x
    rows = [row.refined(breaks) for row in rows]
    path = path_of(rows, model.size)
    of_mass, of_damping = _responses(model, residual, path)
    C, p = stacked(path.rows, path.size), path.size
    C1 = C.derivative()
    C2 = C1.derivative()

    def table(coefficients: Array) -> PPoly:
        return PPoly(coefficients, breaks)

    inertia = Inertia(
        A0=table(_symmetric(paired(C, of_mass[:p, :p], C))),
        A1=table(paired(C, of_mass[:p, :p], C1)),
        A2=table(paired(C, of_mass[:p, :p], C2)),
        A11=table(_symmetric(paired(C1, of_mass[:p, :p], C1))),
        E0=table(C.times(of_mass[:p, p:])),
        D0=table(_symmetric(paired(C, of_damping[:p, :p], C))),
        D1=table(paired(C, of_damping[:p, :p], C1)),
        F0=table(C.times(of_damping[:p, p:])),
        energy=of_mass[p:, p:],
    )
    return replace(flexibility, inertia=inertia)


def _responses(model: FullModel, residual: ResidualFlexibility, path: Path) -> tuple[Array, Array]:
    """R M R and R D R between the path's loads and the inputs, (p + i, p + i) each, the same on every rank."""
    loads = path_loads(model, path)
    damped = model.D.norm(PETSc.NormType.FROBENIUS) > 0.0
    of_mass, of_damping = [], []
    for k in range(0, loads.shape[1], BLOCK):
        x = residual.apply(loads[:, k : k + BLOCK].toarray())
        of_mass.append(loads.T @ residual.apply(times(model.M, x)))
        if damped:
            of_damping.append(loads.T @ residual.apply(times(model.D, x)))
    mass = np.asarray(model.comm.allreduce(np.hstack(of_mass)))
    damping = np.asarray(model.comm.allreduce(np.hstack(of_damping))) if damped else np.zeros_like(mass)
    return (mass + mass.T) / 2.0, (damping + damping.T) / 2.0


def _symmetric(c: Array) -> Array:
    return (c + c.swapaxes(2, 3)) / 2.0
