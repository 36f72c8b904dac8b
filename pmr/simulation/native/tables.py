"""The tables of a body on one path as the arrays that the compiled loop reads."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.constraints.polynomials import common_breaks, product, rebased, side_by_side, total
from pmr.reduced.model import ReducedModel
from pmr.simulation.native.arrays import Outputs, Scheme, Tables
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.simd import CACHE_LINE, padded

Array = NDArray[np.float64]


def tables(form: SystemForm, body: ReducedModel, schemes: Sequence[Scheme]) -> list[Tables]:
    """The rows of a body in its modes, `form.on_tables`, on common breaks; their couplings for each length of step."""
    m, breaks, left = len(body.row_names), table_breaks(body), body.flexibility
    rows = PPoly(padded(rebased(body.rows, breaks).c), breaks)
    of_inputs = PPoly(np.zeros((1, len(breaks) - 1, m, len(form.modes.B))), breaks)
    give = PPoly(np.zeros((1, len(breaks) - 1, m, m)), breaks)
    if left is not None:
        give, of_inputs = rebased(left.rows, breaks), rebased(left.inputs, breaks)
    give.c[-1, :, np.arange(m), np.arange(m)] += body.row_compliance[:, None]
    in_order, found = padded(rows.c.transpose(1, 2, 0, 3)), list[Tables]()
    for scheme in schemes:
        weighted, B = PPoly(form.over_S(rows.c, scheme), breaks), form.over_S(form.modes.B, scheme)
        compliance = total(PPoly(scheme.z_gain * product(weighted, rows).c, breaks), give)
        inputs = total(PPoly(scheme.z_gain * rows.c @ B.T, breaks), of_inputs)
        couplings = side_by_side(compliance, inputs).c
        constant = _constant_rows(rows.c, couplings)
        found.append(Tables(breaks, in_order, padded(couplings.transpose(1, 2, 0, 3)), constant))
    return found


def _constant_rows(C: Array, couplings: Array) -> int:
    """How many of the first rows never move, and share nothing that moves with those before them or the inputs."""
    m = C.shape[2]
    for k in range(m):
        own = np.delete(couplings[:, :, k], np.arange(k + 1, m), axis=-1)
        if any(np.any(c[:-1]) or np.any(c[-1] != c[-1, :1]) for c in (C[:, :, k], own)):
            return k
    return m


def outputs(body: ReducedModel, chosen: Sequence[int]) -> Outputs:
    """Constants of the `chosen` outputs (numbers) of such a body."""
    breaks, numbers = table_breaks(body), list(chosen)
    o = len(numbers)
    of_rows = np.zeros((len(breaks) - 1, 0, o))
    if body.flexibility is not None:
        X = rebased(body.flexibility.outputs, breaks).c[:, :, numbers].transpose(1, 3, 0, 2)
        W = np.repeat(body.flexibility.direct[numbers].T[None], len(X), axis=0)
        of_rows = np.concatenate([X.reshape(len(X), -1, o), W], axis=1)
    line = CACHE_LINE // 8
    multiple = line if o >= line else 1  # a few are taken one by one, which wants their entries close together
    return Outputs(padded(body.outputs[numbers].T, multiple), padded(of_rows, multiple))


def shares(body: ReducedModel | None) -> int:
    """How many `State.shares` such outputs take."""
    if body is None or body.flexibility is None:
        return 0
    return len(body.row_names) * len(body.flexibility.outputs.c) + len(body.input_names)


def table_breaks(body: ReducedModel) -> Array:
    """Breaks (k + 1,) in m between which all tables of a body are polynomials."""
    extra = [body.flexibility.rows, body.flexibility.inputs, body.flexibility.outputs] if body.flexibility else []
    return common_breaks([body.rows, *extra], body.domain)
