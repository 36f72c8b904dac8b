r"""The compiled loop of `inertial`: a step of generalized-alpha with the inertia of the residual part kept, O(r m^2).

.. math::
    \ddot p + D \dot p + \Omega^2 p + C^T \lambda &= B f, \qquad G z = C p + H f, \\
    G (\lambda - z) &= A_0 \ddot z + (2 \dot s A_1 + D_0) \dot z + (\ddot s A_1 + \dot s^2 A_2 + \dot s D_1) z
        - E_0 \ddot f - F_0 \dot f

z and its rates follow from G z = C p + H f, differentiated once and twice along the path, so each of them is an affine
function of the acceleration: z = Z (p'', 1) with Z (m, r + 1), and so on.  Hence lambda = L (p'', 1), and

.. math::
    (1 + L_1 S^{-1} C^T)\, \lambda = L_1 S^{-1} (B f - \Omega^2 p^* - D \dot p^*) + L_0, \qquad
    S = 1 + D\, dv + \Omega^2 dq

with predictions p*, p'* and what an acceleration adds to them within the step, dq and dv.
docs/moving_residual_flexibility.md, section 11.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.compilation import compiled, inlined
from pmr.simulation.native.rows import SINGULAR, find_interval

Array = NDArray[np.float64]


class Scheme(NamedTuple):
    """Generalized-alpha of Arnold and Bruels, Multibody System Dynamics 18, 2007, equations 5 to 7."""

    step: float
    alpha_m: float
    alpha_f: float
    gamma: float
    beta: float
    gain: float  # what a unit of acceleration adds to a, and to the velocity and the displacement of its step
    dv: float
    dq: float


class System(NamedTuple):
    """Constants; r modes, m rows, i inputs, k intervals of the path.

    Tables stand side by side for each row, w = r + 6 m + 3 i entries: C, G with the pads' compliance, A0, A1, A2, D0,
    D1, H, E0, F0.
    """

    breaks: Array  # (k + 1,)
    tables: Array  # (k, p, m w), highest power first
    omega2: Array  # (r,)
    damping: Array  # (r,)
    inverse: Array  # (r,): 1 / S
    B: Array  # (i, r)
    round_off: Array  # (m,): what of a row's flexibility is no more than that


#: Order of the tables.
TABLES = ("C", "G", "A0", "A1", "A2", "D0", "D1", "H", "E0", "F0")


class Course(NamedTuple):
    """Path and loads at T steps, with their first and second rates."""

    s: Array  # (3, T)
    f: Array  # (3, T, i)


class Record(NamedTuple):
    """Where results go."""

    p: Array  # (T, r)
    v: Array  # (T, r)
    z: Array  # (T, m)
    multipliers: Array  # (T, m)


class State(NamedTuple):
    """What the next step begins with; room for one step."""

    motion: Array  # (4, r): p, p', p'' and the acceleration-like a
    flat: Array  # (3, m w): tables at s and their first and second derivatives
    values: Array  # (3, m, w): the same memory
    rates: Array  # (2, m, r): C' ds, and C' dds + C'' ds^2
    gains: Array  # (3, m, m): what multiplies z, z' and z'' in the multipliers
    Z: Array  # (4, m, r + 1): z, z', z'' and lambda as functions of (p'', 1)
    small: Array  # (m, m + 1)


@inlined
def _evaluate(table: Array, x: float, flat: Array) -> None:
    """All tables with their first and second derivatives at x from the interval's beginning; Horner."""
    values, first, second = flat[0], flat[1], flat[2]
    for n in range(len(values)):
        values[n], first[n], second[n] = table[0, n], 0.0, 0.0
    for p in range(1, len(table)):
        for n in range(len(values)):
            second[n] = second[n] * x + 2.0 * first[n]
            first[n] = first[n] * x + values[n]
            values[n] = values[n] * x + table[p, n]


@inlined
def _factorise(A: Array, at: int, least: Array) -> int:
    """Cholesky factor of A[:, at : at + m] in the lower triangle, 1 / pivots on the diagonal; 0, or a row from 1."""
    m = len(A)
    for k in range(m):
        diagonal = pivot = A[k, at + k]
        for l in range(k):
            entry = A[k, at + l]
            for n in range(l):
                entry -= A[k, at + n] * A[l, at + n]
            A[k, at + l] = entry * A[l, at + l]
            pivot -= A[k, at + l] * A[k, at + l]
        if not (pivot > SINGULAR * diagonal and pivot > least[k]):
            return k + 1
        A[k, at + k] = 1.0 / np.sqrt(pivot)
    return 0


@inlined
def _solve(A: Array, at: int, X: Array) -> None:
    """Forward and backward substitution of all columns of X (m, c), in place."""
    m, columns = X.shape
    for k in range(m):
        for n in range(k):
            for c in range(columns):
                X[k, c] -= A[k, at + n] * X[n, c]
        for c in range(columns):
            X[k, c] *= A[k, at + k]
    for k in range(m - 1, -1, -1):
        for n in range(k + 1, m):
            for c in range(columns):
                X[k, c] -= A[n, at + k] * X[n, c]
        for c in range(columns):
            X[k, c] *= A[k, at + k]


@inlined
def _along_path(state: State, ds: float, dds: float) -> None:
    """Rates of the rows, and what multiplies z, z' and z'' in the multipliers."""
    now, first, second, rates, gains = state.values[0], state.values[1], state.values[2], state.rates, state.gains
    m, r = rates.shape[1:]
    for k in range(m):
        for n in range(r):
            rates[0, k, n] = ds * first[k, n]
            rates[1, k, n] = dds * first[k, n] + ds * ds * second[k, n]
        for n in range(m):
            at = r + m + n
            A0, A1, A2, D0, D1 = now[k, at], now[k, at + m], now[k, at + 2 * m], now[k, at + 3 * m], now[k, at + 4 * m]
            gains[0, k, n] = dds * A1 + ds * ds * A2 + ds * D1
            gains[1, k, n] = 2.0 * ds * A1 + D0
            gains[2, k, n] = A0


@inlined
def _differentiate(state: State, scheme: Scheme, ds: float, dds: float, f: Array, df: Array, ddf: Array) -> None:
    """C p + H f, its first and its second rate along the path as functions of (p'', 1); -F0 f' - E0 f'' in the last."""
    now, first, second, rates, Z = state.values[0], state.values[1], state.values[2], state.rates, state.Z
    p, v = state.motion[0], state.motion[1]
    m, r = rates.shape[1:]
    i = len(f)
    for k in range(m):
        rest0, rest1, rest2, loads = 0.0, 0.0, 0.0, 0.0
        for n in range(r):
            c0, c1, c2 = now[k, n], rates[0, k, n], rates[1, k, n]
            Z[0, k, n] = scheme.dq * c0
            Z[1, k, n] = scheme.dv * c0 + scheme.dq * c1
            Z[2, k, n] = c0 + 2.0 * scheme.dv * c1 + scheme.dq * c2
            Z[3, k, n] = 0.0
            rest0 += c0 * p[n]
            rest1 += c0 * v[n] + c1 * p[n]
            rest2 += 2.0 * c1 * v[n] + c2 * p[n]
        for n in range(i):
            at = r + 6 * m + n
            h0, h1, h2 = now[k, at], ds * first[k, at], dds * first[k, at] + ds * ds * second[k, at]
            rest0 += h0 * f[n]
            rest1 += h0 * df[n] + h1 * f[n]
            rest2 += h0 * ddf[n] + 2.0 * h1 * df[n] + h2 * f[n]
            loads += now[k, at + i] * ddf[n] + now[k, at + 2 * i] * df[n]
        Z[0, k, r], Z[1, k, r], Z[2, k, r], Z[3, k, r] = rest0, rest1, rest2, -loads


@inlined
def _find_affine(state: State, ds: float, dds: float) -> None:
    """z, z', z'' from the rates of G z = C p + H f, and lambda, all as functions of (p'', 1)."""
    G, G1, G2, gains, Z = state.values[0], state.values[1], state.values[2], state.gains, state.Z
    m, r = state.rates.shape[1:]
    _solve(G, r, Z[0])
    for k in range(m):
        for n in range(m):
            g1, g2, gain = ds * G1[k, r + n], dds * G1[k, r + n] + ds * ds * G2[k, r + n], gains[0, k, n]
            for c in range(r + 1):
                Z[1, k, c] -= g1 * Z[0, n, c]
                Z[2, k, c] -= g2 * Z[0, n, c]
                Z[3, k, c] += gain * Z[0, n, c]
    _solve(G, r, Z[1])
    for k in range(m):
        for n in range(m):
            g1, gain = 2.0 * ds * G1[k, r + n], gains[1, k, n]
            for c in range(r + 1):
                Z[2, k, c] -= g1 * Z[1, n, c]
                Z[3, k, c] += gain * Z[1, n, c]
    _solve(G, r, Z[2])
    for k in range(m):
        for n in range(m):
            for c in range(r + 1):
                Z[3, k, c] += gains[2, k, n] * Z[2, n, c]
    _solve(G, r, Z[3])
    for k in range(m):
        for c in range(r + 1):
            Z[3, k, c] += Z[0, k, c]


@inlined
def _eliminate(A: Array) -> None:
    """Solution of A[:, :m] x = A[:, m] in the last column, by elimination with partial pivoting."""
    m = len(A)
    for k in range(m):
        pivot = k
        for n in range(k + 1, m):
            if abs(A[n, k]) > abs(A[pivot, k]):
                pivot = n
        if pivot != k:
            for c in range(m + 1):
                A[k, c], A[pivot, c] = A[pivot, c], A[k, c]
        A[k, m] /= A[k, k]
        for c in range(k + 1, m):
            A[k, c] /= A[k, k]
        for n in range(m):
            if n != k:
                for c in range(k + 1, m + 1):
                    A[n, c] -= A[n, k] * A[k, c]


@inlined
def _accelerate(system: System, state: State, f: Array) -> None:
    """Accelerations, and multipliers in the last column of state.small."""
    C, L, inverse, small = state.values[0], state.Z[3], system.inverse, state.small
    p, v, acceleration = state.motion[0], state.motion[1], state.motion[2]
    m, r = state.rates.shape[1:]
    for n in range(r):
        acceleration[n] = (-system.omega2[n] * p[n] - system.damping[n] * v[n]) * inverse[n]
    for l in range(len(f)):
        for n in range(r):
            acceleration[n] += system.B[l, n] * f[l] * inverse[n]
    for k in range(m):
        for l in range(m):
            entry = 0.0
            for n in range(r):
                entry += L[k, n] * C[l, n] * inverse[n]
            small[k, l] = entry
        small[k, k] += 1.0
        entry = L[k, r]
        for n in range(r):
            entry += L[k, n] * acceleration[n]
        small[k, m] = entry
    _eliminate(small)
    for k in range(m):
        for n in range(r):
            acceleration[n] -= C[k, n] * inverse[n] * small[k, m]


@inlined
def _predict(scheme: Scheme, motion: Array) -> None:
    h, beta, gamma = scheme.step, scheme.beta, scheme.gamma
    for n in range(motion.shape[1]):
        a = motion[3, n]
        following = (scheme.alpha_f * motion[2, n] - scheme.alpha_m * a) / (1.0 - scheme.alpha_m)
        motion[0, n] += h * motion[1, n] + h * h * ((0.5 - beta) * a + beta * following)
        motion[1, n] += h * ((1.0 - gamma) * a + gamma * following)
        motion[3, n] = following


@inlined
def _correct_and_record(scheme: Scheme, state: State, record: Record, step: int) -> None:
    motion, Z = state.motion, state.Z
    m, r = state.rates.shape[1:]
    for k in range(m):
        z = Z[0, k, r]
        for n in range(r):
            z += Z[0, k, n] * motion[2, n]
        record.z[step, k], record.multipliers[step, k] = z, state.small[k, m]
    for n in range(r):
        acceleration = motion[2, n]
        motion[0, n] += scheme.dq * acceleration
        motion[1, n] += scheme.dv * acceleration
        motion[3, n] += scheme.gain * acceleration
        record.p[step, n], record.v[step, n] = motion[0, n], motion[1, n]


@compiled
def run(
    system: System, scheme: Scheme, state: State, course: Course, record: Record, first: int, last: int
) -> tuple[int, int]:
    """Steps `first` to `last` (exclusive); the step that was reached, and 0 or the number from 1 of a dependent row.

    A step of no length from a state without acceleration finds the accelerations there.
    """
    j, r = 0, state.rates.shape[2]
    for step in range(first, last):
        s, ds, dds = course.s[0, step], course.s[1, step], course.s[2, step]
        f, df, ddf = course.f[0, step], course.f[1, step], course.f[2, step]
        _predict(scheme, state.motion)
        j = find_interval(system.breaks, s, j)
        _evaluate(system.tables[j], s - system.breaks[j], state.flat)
        failed = _factorise(state.values[0], r, system.round_off)
        if failed:
            return step, failed
        _along_path(state, ds, dds)
        _differentiate(state, scheme, ds, dds, f, df, ddf)
        _find_affine(state, ds, dds)
        _accelerate(system, state, f)
        _correct_and_record(scheme, state, record, step)
    return last, 0
