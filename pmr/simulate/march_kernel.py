r"""The compiled loop of `march`: one step of generalized-alpha in modal coordinates, O(r m).

.. math::
    \ddot z + D \dot z + \Omega^2 z + C(s)^T \lambda = B f, \qquad C(s) z + H(s) f - G(s) \lambda = 0

at t_{n+1}, with z and its rate from the acceleration-like variable a of Arnold, Bruels: Convergence of the
generalized-alpha scheme for constrained mechanical systems, Multibody System Dynamics 18, 2007, equations 5 to 7.
With S = 1 + D dv + Omega^2 dq, where dv and dq say what an acceleration adds to rate and position within the step, only

.. math::
    (dq\, C S^{-1} C^T + G)\, \lambda = C (z^* + dq\, S^{-1} r) + H f

is left to be solved, m x m, and its factor is kept while s stays where it is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: A pivot of the rows' Schur complement below this share of its diagonal entry: the row depends on those before it.
SINGULAR = 1e-12
FINISHED = 0

# Inlined, for a call would copy the arrays' headers; without Numba's runtime, so that nothing can be allocated; NaN and
# infinity stay visible, while sums may be reordered.
_options = {"fastmath": {"reassoc", "contract", "nsz", "arcp"}, "error_model": "numpy", "nogil": True, "_nrt": False}
_inlined = njit(inline="always", **_options)
_compiled = njit(cache=True, **_options)


class Scheme(NamedTuple):
    """Generalized-alpha with one step size, as factors of what a step adds up."""

    step: float
    a_from_acceleration: float  # the next a, predicted: alpha_f / (1 - alpha_m) times the acceleration ...
    a_from_a: float  # ... and -alpha_m / (1 - alpha_m) times a
    z_from_a: float  # (1/2 - beta) h^2
    z_from_next: float  # beta h^2
    v_from_a: float  # (1 - gamma) h
    v_from_next: float  # gamma h
    a_gain: float  # (1 - alpha_f) / (1 - alpha_m)
    v_gain: float  # dv
    z_gain: float  # dq


class System(NamedTuple):
    """Constants of a body with r modes, m rows and i inputs; k intervals of the path."""

    breaks: Array  # (k + 1,) m
    rows: Array  # (k, m, p, r): C, highest power first
    compliance: Array  # (k, m, m, p'): G and the pads
    inputs: Array  # (k, m, i, p''): H
    B: Array  # (i, r)
    omega2: Array  # (r,)
    damping: Array  # (r,): the diagonal of D
    inverse: Array  # (r,): 1 / S, where D is diagonal
    coupling: Array  # (r, r): D, or (0, 0) where it is diagonal
    full_inverse: Array  # (r, r): 1 / S, or (0, 0)


class Outputs(NamedTuple):
    """Constants of o outputs; r modes, m rows, i inputs, k intervals."""

    of_modes: Array  # (r, o)
    of_inputs: Array  # (i, o): W
    of_rows: Array  # (k, m, p, o): X, highest power first


class State(NamedTuple):
    """What changes; r modes, m rows."""

    z: Array  # (r,)
    v: Array  # (r,)
    a: Array  # (r,): acceleration-like
    acceleration: Array  # (r,)
    multipliers: Array  # (m,)
    position: Array  # (1,): s at which the rows stand
    interval: NDArray[np.int64]  # (1,)
    C: Array  # (m, r)
    weighted: Array  # (m, r): C / S
    factor: Array  # (m, m): Cholesky factor of the Schur complement
    scratch: Array  # (r,)


@_inlined
def find_interval(breaks: Array, s: float, j: int) -> int:
    """Number of the interval that holds s, sought from j on."""
    while j > 0 and s < breaks[j]:
        j -= 1
    while j < len(breaks) - 2 and s >= breaks[j + 1]:
        j += 1
    return j


@_inlined
def _polynomial(coefficients: Array, x: float) -> float:
    """Horner."""
    value = 0.0
    for p in range(len(coefficients)):
        value = value * x + coefficients[p]
    return value


@_inlined
def move_rows(system: System, scheme: Scheme, state: State, s: float) -> int:
    """Evaluate rows and factor at s; number of the first row that depends on others, counted from 1, or 0."""
    if s == state.position[0]:
        return FINISHED
    C, weighted, factor = state.C, state.weighted, state.factor
    m, r = C.shape
    j = find_interval(system.breaks, s, state.interval[0])
    state.interval[0] = j
    x = s - system.breaks[j]
    for k in range(m):
        for n in range(r):
            C[k, n] = system.rows[j, k, 0, n]
        for p in range(1, system.rows.shape[2]):
            for n in range(r):
                C[k, n] = C[k, n] * x + system.rows[j, k, p, n]
        _weigh(system, C[k], weighted[k])
    for k in range(m):
        for l in range(k + 1):
            entry = 0.0
            for n in range(r):
                entry += weighted[k, n] * C[l, n]
            factor[k, l] = scheme.z_gain * entry + _polynomial(system.compliance[j, k, l], x)
    failed = _factorise(factor)
    state.position[0] = np.nan if failed else s
    return failed


@_inlined
def _weigh(system: System, row: Array, weighted: Array) -> None:
    """Row / S."""
    if system.coupling.shape[0] == 0:
        for n in range(len(row)):
            weighted[n] = row[n] * system.inverse[n]
    else:
        for n in range(len(row)):
            total = 0.0
            for k in range(len(row)):
                total += system.full_inverse[n, k] * row[k]
            weighted[n] = total


@_inlined
def _factorise(A: Array) -> int:
    """Cholesky factor in the lower triangle, in place; 0, or the number of the first dependent row from 1."""
    m = len(A)
    for k in range(m):
        diagonal = A[k, k]
        for l in range(k):
            entry = A[k, l]
            for n in range(l):
                entry -= A[k, n] * A[l, n]
            A[k, l] = entry / A[l, l]
        pivot = diagonal
        for n in range(k):
            pivot -= A[k, n] * A[k, n]
        if not pivot > SINGULAR * diagonal:
            return k + 1
        A[k, k] = np.sqrt(pivot)
    return FINISHED


@_inlined
def _solve(factor: Array, x: Array) -> None:
    """Forward and backward substitution in place."""
    m = len(x)
    for k in range(m):
        for n in range(k):
            x[k] -= factor[k, n] * x[n]
        x[k] /= factor[k, k]
    for k in range(m - 1, -1, -1):
        for n in range(k + 1, m):
            x[k] -= factor[n, k] * x[n]
        x[k] /= factor[k, k]


@_inlined
def step(system: System, scheme: Scheme, state: State, s: float, f: Array) -> int:
    """Advance by one step to the path coordinate s and the loads f (i,) at its end; 0, or a dependent row from 1."""
    failed = move_rows(system, scheme, state, s)
    if failed:
        return failed
    z, v, a, acceleration, scratch = state.z, state.v, state.a, state.acceleration, state.scratch
    r, i = len(z), len(f)
    for n in range(r):
        scratch[n] = 0.0
    for l in range(i):
        for n in range(r):
            scratch[n] += system.B[l, n] * f[l]
    for n in range(r):
        following = scheme.a_from_acceleration * acceleration[n] + scheme.a_from_a * a[n]
        z[n] += scheme.step * v[n] + scheme.z_from_a * a[n] + scheme.z_from_next * following
        v[n] += scheme.v_from_a * a[n] + scheme.v_from_next * following
        a[n] = following
        acceleration[n] = (scratch[n] - system.omega2[n] * z[n] - system.damping[n] * v[n]) * system.inverse[n]
    if system.coupling.shape[0] > 0:
        _coupled_acceleration(system, state)
    _find_multipliers(system, scheme, state, f)
    for k in range(len(state.multipliers)):
        for n in range(r):
            acceleration[n] -= state.weighted[k, n] * state.multipliers[k]
    for n in range(r):
        z[n] += scheme.z_gain * acceleration[n]
        v[n] += scheme.v_gain * acceleration[n]
        a[n] += scheme.a_gain * acceleration[n]
    return FINISHED


@_inlined
def _coupled_acceleration(system: System, state: State) -> None:
    """The free acceleration under a damping that couples the modes; `scratch` holds B f."""
    r = len(state.z)
    for n in range(r):
        damped = 0.0
        for k in range(r):
            damped += system.coupling[n, k] * state.v[k]
        state.scratch[n] -= system.omega2[n] * state.z[n] + damped
    for n in range(r):
        total = 0.0
        for k in range(r):
            total += system.full_inverse[n, k] * state.scratch[k]
        state.acceleration[n] = total


@_inlined
def _find_multipliers(system: System, scheme: Scheme, state: State, f: Array) -> None:
    """Multipliers from the rows that the free acceleration violates."""
    m, r = state.C.shape
    j = state.interval[0]
    x = state.position[0] - system.breaks[j]
    for k in range(m):
        violation = 0.0
        for n in range(r):
            violation += state.C[k, n] * (state.z[n] + scheme.z_gain * state.acceleration[n])
        for l in range(len(f)):
            violation += _polynomial(system.inputs[j, k, l], x) * f[l]
        state.multipliers[k] = violation
    _solve(state.factor, state.multipliers)


@_compiled
def run(
    system: System, scheme: Scheme, state: State, s: Array, f: Array, z: Array, v: Array, multipliers: Array
) -> tuple[int, int]:
    """Steps to s (T,) under f (T, i), all of them kept in z, v (T, r) and multipliers (T, m).

    Returns the number of steps taken and 0, or the number from 1 of the row that stopped the march.
    """
    for n in range(len(s)):
        failed = step(system, scheme, state, s[n], f[n])
        if failed:
            return n, failed
        for k in range(z.shape[1]):
            z[n, k] = state.z[k]
            v[n, k] = state.v[k]
        for k in range(multipliers.shape[1]):
            multipliers[n, k] = state.multipliers[k]
    return len(s), FINISHED


@_inlined
def _observe(system: System, outputs: Outputs, state: State, f: Array, y: Array) -> None:
    """Outputs y (o,) of the present state under the loads f (i,)."""
    count = len(y)
    for n in range(count):
        y[n] = 0.0
    for k in range(len(state.z)):
        for n in range(count):
            y[n] += outputs.of_modes[k, n] * state.z[k]
    for l in range(outputs.of_inputs.shape[0]):
        for n in range(count):
            y[n] += outputs.of_inputs[l, n] * f[l]
    if outputs.of_rows.shape[2] > 0:
        j = state.interval[0]
        x = state.position[0] - system.breaks[j]
        for k in range(len(state.multipliers)):
            power = -state.multipliers[k]
            for p in range(outputs.of_rows.shape[2] - 1, -1, -1):
                for n in range(count):
                    y[n] += outputs.of_rows[j, k, p, n] * power
                power *= x


@_compiled
def step_and_observe(
    system: System, scheme: Scheme, outputs: Outputs, state: State, s: float, f: Array, y: Array
) -> int:
    """One step to s under f (i,), and its outputs y (o,); 0, or the number from 1 of a dependent row."""
    failed = step(system, scheme, state, s, f)
    if failed == 0:
        _observe(system, outputs, state, f, y)
    return failed


@_compiled
def run_observed(
    system: System,
    scheme: Scheme,
    outputs: Outputs,
    state: State,
    s: Array,
    f: Array,
    every: int,
    y: Array,
    multipliers: Array,
) -> tuple[int, int]:
    """Steps to s (T,) under f (T, i); outputs y (T // every, o) and multipliers (T // every, m) of each `every`-th."""
    for n in range(len(s)):
        failed = step(system, scheme, state, s[n], f[n])
        if failed:
            return n, failed
        if (n + 1) % every == 0:
            at = (n + 1) // every - 1
            _observe(system, outputs, state, f[n], y[at])
            for k in range(multipliers.shape[1]):
                multipliers[at, k] = state.multipliers[k]
    return len(s), FINISHED
