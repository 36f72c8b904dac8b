"""A body and a time step as the arrays that the compiled loop of `march` reads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PPoly

from pmr.constraints.polynomials import common_breaks, product, rebased, side_by_side, total
from pmr.reduced.model import ReducedModel
from pmr.simulation.modal import ModalForm
from pmr.simulation.native.arrays import DAMPING, INPUT, ROW, STIFFNESS, UNIT, Memory, Outputs, Scheme, State, System
from pmr.simulation.native.contact import contact
from pmr.simulation.native.simd import LANES

Array = NDArray[np.float64]

#: Bytes; a register that crosses the border of two takes two accesses.
CACHE_LINE = 64


def system(form: ModalForm, scheme: Scheme) -> System:
    """Constants of a body in modal form, its tables on common breaks."""
    body = form.body
    m, breaks = len(body.row_names), table_breaks(body)
    rows, B = rebased(body.rows, breaks), over_S(form, scheme, body.B.T)
    weighted = PPoly(over_S(form, scheme, rows.c), breaks)
    compliance = PPoly(scheme.z_gain * product(weighted, rows).c, breaks)
    inputs = PPoly(scheme.z_gain * rows.c @ B.T, breaks)
    if body.flexibility:
        compliance = total(compliance, rebased(body.flexibility.rows, breaks))
        inputs = total(inputs, rebased(body.flexibility.inputs, breaks))
    compliance.c[-1, :, np.arange(m), np.arange(m)] += body.row_compliance[:, None]
    C, couplings = rows.c, side_by_side(compliance, inputs).c
    damped = np.zeros((0, 0, 0))
    if not form.classically_damped:
        damped = np.stack([over_S(form, scheme, A).T for A in (body.K, body.D, np.eye(body.size))])
    return System(
        breaks=breaks,
        rows=_padded(C.transpose(1, 2, 0, 3)),
        couplings=_padded(couplings.transpose(1, 2, 0, 3)),
        B=_padded(B),
        damped=_padded(damped),
        constant_rows=_constant_rows(C, couplings),
    )


def over_S(form: ModalForm, scheme: Scheme, X: Array) -> Array:
    """X S^-1, for X (..., r) and the symmetric S = 1 + D dv + Omega^2 dq."""
    return divided(X, form.omega2, form.body.D, scheme)


def divided(X: Array, omega2: Array, D: Array, scheme: Scheme) -> Array:
    """X S^-1 with omega^2 (r,) and D (r, r), which may be diagonal."""
    diagonal = 1.0 + omega2 * scheme.z_gain
    if np.count_nonzero(D - np.diag(np.diagonal(D))) == 0:
        return np.asarray(X / (diagonal + np.diagonal(D) * scheme.v_gain))
    return np.asarray(X @ np.linalg.inv(np.diag(diagonal) + D * scheme.v_gain))


def _constant_rows(C: Array, couplings: Array) -> int:
    """How many of the first rows never move, and share nothing that moves with those before them or the inputs."""
    m = C.shape[2]
    for k in range(m):
        own = np.delete(couplings[:, :, k], np.arange(k + 1, m), axis=-1)
        if any(np.any(c[:-1]) or np.any(c[-1] != c[-1, :1]) for c in (C[:, :, k], own)):
            return k
    return m


def outputs(body: ReducedModel, chosen: NDArray[np.int64]) -> Outputs:
    """Constants of the `chosen` outputs (numbers) of a body in modal form."""
    breaks, o = table_breaks(body), len(chosen)
    of_rows = np.zeros((len(breaks) - 1, 0, o))
    if body.flexibility is not None:
        X = rebased(body.flexibility.outputs, breaks).c[:, :, chosen].transpose(1, 3, 0, 2)
        W = np.repeat(body.flexibility.direct[chosen].T[None], len(X), axis=0)
        of_rows = np.concatenate([X.reshape(len(X), -1, o), W], axis=1)
    line = CACHE_LINE // 8
    multiple = line if o >= line else 1  # a few are taken one by one, which wants their entries close together
    return Outputs(_padded(body.outputs[chosen].T, multiple), _padded(of_rows, multiple))


def table_breaks(body: ReducedModel) -> Array:
    """Breaks (k + 1,) in m between which all tables of a body are polynomials."""
    extra = [body.flexibility.rows, body.flexibility.inputs, body.flexibility.outputs] if body.flexibility else []
    return common_breaks([body.rows, *extra], body.domain)


def state(form: ModalForm, scheme: Scheme, memory: Memory) -> State:
    """At rest; the rows are evaluated in the first step."""
    body, coupled = form.body, not form.classically_damped
    r, m, i = body.size, len(body.row_names), len(body.input_names)
    modes = np.zeros((ROW + max(m, 1), r))
    if i > 0:
        modes[INPUT] = over_S(form, scheme, body.B[:, 0])
    if not coupled:
        modes[UNIT] = over_S(form, scheme, np.ones(r))
        modes[STIFFNESS], modes[DAMPING] = modes[UNIT] * form.omega2, modes[UNIT] * np.diagonal(body.D)
    return State(
        modes=_padded(modes),
        multipliers=np.zeros(m),
        position=np.full(1, np.nan),
        interval=np.zeros(1, np.int64),
        couplings=_padded(np.zeros((m, m + i))),
        factor=np.zeros((m, m)),
        weighted=_padded(np.zeros((m if coupled else 0, r))),
        shares=np.zeros(0 if body.flexibility is None else m * len(body.flexibility.outputs.c) + i),
        contact=contact(body.row_clearance, memory),
    )


def _padded(array: Array, multiple: int = LANES) -> Array:
    """With zeros at the end of the last axis, up to a whole number of vector registers or cache lines."""
    wide = np.zeros((*array.shape[:-1], array.shape[-1] + -array.shape[-1] % multiple))
    wide[..., : array.shape[-1]] = array
    return aligned(wide)


def aligned(array: Array) -> Array:
    """Contiguous and writable, for others would be other types to the compiled loop, and from a cache line's start."""
    memory = np.empty(array.size + CACHE_LINE // 8)
    first = -memory.ctypes.data % CACHE_LINE // 8
    copy = memory[first : first + array.size].reshape(array.shape)
    copy[...] = array
    return copy
