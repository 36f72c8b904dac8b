r"""The compiled loop of `march`: one step of generalized-alpha in modal coordinates, O(r m).

.. math::
    \ddot z + D \dot z + \Omega^2 z + C(s)^T \lambda = B f, \qquad C(s) z + H(s) f - G(s) \lambda = 0

at t_{n+1}, with z and its rate from the acceleration-like variable a of Arnold, Bruels: Convergence of the
generalized-alpha scheme for constrained mechanical systems, Multibody System Dynamics 18, 2007, equations 5 to 7:
all three are a prediction z^*, v^*, a^* from the step before, plus what the acceleration of this one adds,

.. math::
    z = z^* + dq\, \ddot z, \qquad \dot z = v^* + dv\, \ddot z, \qquad
    \ddot z = S^{-1} (B f - \Omega^2 z^* - D v^* - C^T \lambda), \qquad S = 1 + D\, dv + \Omega^2 dq

so that only the multipliers are left to be solved for, m x m,

.. math::
    (dq\, C S^{-1} C^T + G)\, \lambda = C (z^* + dq\, S^{-1} (B f - \Omega^2 z^* - D v^*)) + H f

and a step ends with the prediction of the next.  The factor is kept while s stays where it is.  Where rows only push,
which of them hold is found together with the multipliers (`pmr.simulation.native.contact`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.arrays import (
    A_NEXT,
    DAMPING,
    INPUT,
    OTHERS,
    ROW,
    STIFFNESS,
    UNIT,
    V_NEXT,
    Z_FREE,
    Z_NEXT,
    Contact,
    Outputs,
    Scheme,
    State,
    System,
    V,
    Z,
)
from pmr.simulation.native.compilation import compiled, compiled_and_inlined, inlined
from pmr.simulation.native.contact import let_go, remember, settle
from pmr.simulation.native.outputs import observe
from pmr.simulation.native.rows import dot, move_rows, solve
from pmr.simulation.native.simd import LANES, load, spread, store

Array = NDArray[np.float64]

FINISHED = 0


@inlined
def step(system: System, scheme: Scheme, state: State, s: float, f: Array) -> int:
    """Advance by one step to the path coordinate s and the loads f (i,) at its end.

    Returns 0, the number from 1 of a dependent row, or `contact_rows.UNSETTLED`.
    """
    failed = move_rows(system, state, s)
    return failed if failed else advance(system, scheme, state, f)


@inlined
def advance(system: System, scheme: Scheme, state: State, f: Array) -> int:
    """The rest of a step, with the rows where they stand at its end."""
    m, i, coupled = len(state.multipliers), len(f), len(system.damped) > 0
    if coupled:
        _couple(system, scheme, state.modes)
    failed, multiplier = _find_multipliers(state.contact, system, scheme, state, f)
    if failed:
        return failed
    if m > 1 or i > 1 or coupled:
        _add_others(system, state, f)
    force = f[0] if i > 0 else 0.0
    _advance(scheme, state.modes, force, multiplier)
    return FINISHED


@inlined
def _find_multipliers(
    contact: Contact | None, system: System, scheme: Scheme, state: State, f: Array
) -> tuple[int, float]:
    """Multipliers from the rows that the free motion violates; returns what failed, or 0, and the first one, or 0."""
    if contact is not None:  # decided when compiled
        return _find_in_contact(contact, system, scheme, state, f)
    violation = _violate(state, f)
    m, multipliers = len(state.multipliers), state.multipliers
    if m == 1:  # as `solve` would do, without the way through memory
        first = violation * state.factor[0, 0]
        multipliers[0] = first
        return FINISHED, first
    solve(state.factor, multipliers)
    return FINISHED, multipliers[0] if m else 0.0


@inlined
def _find_in_contact(contact: Contact, system: System, scheme: Scheme, state: State, f: Array) -> tuple[int, float]:
    """The same where rows only push; as often as rows let go, each of them once at most."""
    while True:
        _violate(state, f)
        failed = settle(contact, state.couplings, state.factor, state.multipliers)
        if failed or not let_go(contact, scheme, state):
            remember(contact, scheme, state.multipliers)
            return failed, state.multipliers[0]
        if len(system.damped) > 0:
            _couple(system, scheme, state.modes)


@inlined
def _violate(state: State, f: Array) -> float:
    """How far the free motion violates the rows, in place of their multipliers; returns the last one, or 0."""
    m, multipliers, violation = len(state.multipliers), state.multipliers, 0.0
    for k in range(m):
        violation = dot(state.modes[ROW + k], state.modes[Z_FREE])
        for l in range(len(f)):
            violation += state.couplings[k, m + l] * f[l]
        multipliers[k] = violation
    return violation


@inlined
def _advance(scheme: Scheme, modes: Array, force: float, multiplier: float) -> None:
    """The step's acceleration, its end, and the prediction of the next, mode by mode."""
    stiffness, damping, unit, row = modes[STIFFNESS], modes[DAMPING], modes[UNIT], modes[ROW]
    for n in range(0, modes.shape[1], LANES):
        z, v, a = load(modes[Z_NEXT], n), load(modes[V_NEXT], n), load(modes[A_NEXT], n)
        forces = load(modes[INPUT], n) * force + load(modes[OTHERS], n) - load(unit, n) * load(row, n) * multiplier
        acceleration = forces - load(stiffness, n) * z - load(damping, n) * v
        store(modes[Z], n, z + acceleration * scheme.z_gain)
        store(modes[V], n, v + acceleration * scheme.v_gain)
        z = z + v * scheme.z_from_v + a * scheme.z_from_a + acceleration * scheme.z_from_acceleration
        v = v + a * scheme.v_from_a + acceleration * scheme.v_from_acceleration
        a = a * scheme.a_from_a + acceleration * scheme.a_from_acceleration
        store(modes[Z_NEXT], n, z)
        store(modes[V_NEXT], n, v)
        store(modes[A_NEXT], n, a)
        store(modes[Z_FREE], n, z - (load(stiffness, n) * z + load(damping, n) * v) * scheme.z_gain)


@inlined
def _couple(system: System, scheme: Scheme, modes: Array) -> None:
    """Stiffness and a damping that couples the modes: the table's STIFFNESS, DAMPING and UNIT are zero then."""
    for n in range(system.damped.shape[1]):
        forces = dot(system.damped[0, n], modes[Z_NEXT]) + dot(system.damped[1, n], modes[V_NEXT])
        modes[OTHERS, n] = -forces
        modes[Z_FREE, n] = modes[Z_NEXT, n] - scheme.z_gain * forces


@inlined
def _add_others(system: System, state: State, f: Array) -> None:
    """Accelerations by inputs and rows after the first ones, which ride along in `_advance`."""
    others, unit, coupled = state.modes[OTHERS], state.modes[UNIT], len(system.damped) > 0
    r = len(others)
    if not coupled:
        for n in range(0, r, LANES):
            store(others, n, spread(0.0))
    for l in range(1, len(f)):
        for n in range(0, r, LANES):
            store(others, n, load(others, n) + load(system.B[l], n) * f[l])
    for k in range(0 if coupled else 1, len(state.multipliers)):
        multiplier = state.multipliers[k]
        if coupled:
            for n in range(0, r, LANES):
                store(others, n, load(others, n) - load(state.weighted[k], n) * multiplier)
        else:
            for n in range(0, r, LANES):
                store(others, n, load(others, n) - load(unit, n) * load(state.modes[ROW + k], n) * multiplier)


@compiled
def run(
    system: System, scheme: Scheme, state: State, s: Array, f: Array, z: Array, v: Array, multipliers: Array
) -> tuple[int, int]:
    """Steps to s (T,) under f (T, i), all of them recorded in z, v (T, r) and multipliers (T, m).

    Returns the number of steps taken and 0, or the number from 1 of the row that stopped the march.
    """
    for n in range(len(s)):
        failed = step(system, scheme, state, s[n], f[n])
        if failed:
            return n, failed
        for k in range(z.shape[1]):
            z[n, k] = state.modes[Z, k]
            v[n, k] = state.modes[V, k]
        for k in range(multipliers.shape[1]):
            multipliers[n, k] = state.multipliers[k]
    return len(s), FINISHED


@compiled_and_inlined
def step_and_observe(
    system: System, scheme: Scheme, outputs: Outputs, state: State, s: float, f: Array, y: Array
) -> int:
    """One step to s under f (i,), and its outputs y (o,); 0, or the number from 1 of a dependent row."""
    failed = step(system, scheme, state, s, f)
    if failed == 0:
        observe(system, outputs, state, f, y)
    return failed


@compiled
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
    row, until = 0, every
    for n in range(len(s)):
        failed = step(system, scheme, state, s[n], f[n])
        if failed:
            return n, failed
        until -= 1
        if until == 0:
            observe(system, outputs, state, f[n], y[row])
            for k in range(multipliers.shape[1]):
                multipliers[row, k] = state.multipliers[k]
            row, until = row + 1, every
    return len(s), FINISHED
