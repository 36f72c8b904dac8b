r"""One step of generalized-alpha in modal coordinates, compiled, O(r m).

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
which of them hold is found together with the multipliers (`pmr.simulation.native.contact`); so are the
forces of terms that vary in time (`pmr.simulation.native.terms`).
"""

from __future__ import annotations

from typing import Any

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
    Divided,
    Scheme,
    State,
    V,
    Z,
)
from pmr.simulation.native.compilation import inlined
from pmr.simulation.native.contact import let_go, remember
from pmr.simulation.native.handles import call
from pmr.simulation.native.quasi_static import forget
from pmr.simulation.native.rows import dot, dot_held, of_body, solve
from pmr.simulation.native.simd import LANES, load, spread, store
from pmr.simulation.native.terms import AGAIN, LAST, expect, finish, gap, push, restart, revise, varies

Array = NDArray[np.float64]

FINISHED = 0


@inlined
def advance(divided: Divided, scheme: Scheme, state: State, terms: Any, quasi_static: Any, f: Array, c: Any) -> int:
    """A step under the loads f (i,) and with amplitudes c of `terms` at its end, where the rows stand already.

    Returns 0, the number from 1 of a row that depends on those before it, `pmr.simulation.native.contact.UNSETTLED`, or
    `pmr.simulation.native.terms.UNCONVERGED`.
    """
    m, i, coupled = len(state.multipliers), len(f), len(divided.damped) > 0
    if coupled:
        _couple(state.reach, divided, scheme, state.modes)
    _push_given(scheme, state)
    expect(terms, divided, state, f, c)
    push(terms, scheme, state.modes)
    failed, multiplier = _find_multipliers(state.contact, divided, scheme, state, terms, quasi_static, f)
    if failed:
        return failed
    if m > 1 or i > 1 or coupled or varies(terms) or len(state.given) > 0:
        _add_others(state.reach, divided, state, f)
    finish(terms, state.modes)
    force = f[0] if i > 0 and len(state.given) == 0 else 0.0
    _advance(scheme, state.modes, force, multiplier)
    return FINISHED


@inlined
def _find_multipliers(
    contact: Contact | None, divided: Divided, scheme: Scheme, state: State, terms: Any, quasi_static: Any, f: Array
) -> tuple[int, float]:
    """Multipliers from the rows that the free motion violates; returns what failed, or 0, and the first one, or 0."""
    if contact is not None:  # decided when compiled
        if len(contact.pushes) > 0:
            return _find_in_contact(contact, divided, scheme, state, terms, quasi_static, f)
    m, multipliers, first, found = len(state.multipliers), state.multipliers, 0.0, AGAIN
    while found == AGAIN or found == LAST:
        violation = _violate(state.pushed, state.reach, state, terms, f)
        if m == 1:  # as `solve` would do, without the way through memory
            first = violation * state.factor[0, 0]
            multipliers[0] = first
        elif m > 1:
            solve(state.reach, state.factor, multipliers)
            first = multipliers[0]
        found = FINISHED if found == LAST else revise(terms, divided, scheme, state)
    return found, first


@inlined
def _find_in_contact(
    contact: Contact, divided: Divided, scheme: Scheme, state: State, terms: Any, quasi_static: Any, f: Array
) -> tuple[int, float]:
    """The same where rows only push; as often as rows let go, each of them once at most, and as terms ask for."""
    while True:
        _violate(state.pushed, state.reach, state, terms, f)
        failed = call(contact.calls[0], (contact, state.couplings, state.factor, state.multipliers))  # settle
        if failed == FINISHED:
            failed = revise(terms, divided, scheme, state)
            if failed == AGAIN or failed == LAST:  # rows that open may change more than is foreseen
                continue
        if failed or not let_go(contact, scheme, state):
            remember(contact, scheme, state.multipliers)
            return failed, state.multipliers[0]
        restart(terms)
        forget(quasi_static, scheme, state.modes)
        if len(divided.damped) > 0:
            _couple(state.reach, divided, scheme, state.modes)
            _push_given(scheme, state)
            push(terms, scheme, state.modes)


@inlined
def _violate(pushed: Any, reach: Any, state: State, terms: Any, f: Array) -> float:
    """How far the free motion violates the rows, in place of their multipliers; returns the last one, or 0."""
    m, multipliers, violation = len(state.multipliers), state.multipliers, 0.0
    for k in range(m):
        violation = dot_held(reach, k, state.modes[ROW + k], state.modes[Z_FREE]) - gap(terms, k)
        if pushed is not None:  # decided when compiled
            violation += pushed[k]
        else:
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
def _push_given(scheme: Scheme, state: State) -> None:
    """Let inputs that are not in the rows' couplings act on the displacement that a step leads to without forces."""
    free = state.modes[Z_FREE]
    for n in range(0, len(state.given), LANES):
        store(free, n, load(free, n) + load(state.given, n) * scheme.z_gain)


@inlined
def _couple(reach: Any, divided: Divided, scheme: Scheme, modes: Array) -> None:
    """Stiffness and a damping that couples the modes: the table's STIFFNESS, DAMPING and UNIT are zero then."""
    for n in range(divided.damped.shape[1]):
        first, last = of_body(reach, n, modes[OTHERS])
        z, v = modes[Z_NEXT, first:last], modes[V_NEXT, first:last]
        forces = dot(divided.damped[0, n, first:last], z) + dot(divided.damped[1, n, first:last], v)
        modes[OTHERS, n] = -forces
        modes[Z_FREE, n] = modes[Z_NEXT, n] - scheme.z_gain * forces


@inlined
def _add_others(reach: Any, divided: Divided, state: State, f: Array) -> None:
    """Accelerations by inputs and rows after the first ones, which ride along in `_advance`."""
    if reach is None:  # decided when compiled
        _add_all(divided, state, f)
    else:
        for body in range(len(reach.bodies)):
            own = reach.bodies[body]
            _add_some(divided, state, own[0], own[1], own[4], own[5])


@inlined
def _add_some(divided: Divided, state: State, begin: int, end: int, first: int, last: int) -> None:
    """Of the modes of a body, which some contacts hold and `State.given` moves."""
    others, unit, coupled = state.modes[OTHERS], state.modes[UNIT], len(divided.damped) > 0
    for n in range(begin, end, LANES):
        value, held = load(state.given, n), spread(0.0)
        if coupled:
            value = value + load(others, n)
        for k in range(max(first, 0 if coupled else 1), last):
            row = state.weighted[k] if coupled else state.modes[ROW + k]
            held = held + load(row, n) * state.multipliers[k]
        store(others, n, value - (held if coupled else held * load(unit, n)))


@inlined
def _add_all(divided: Divided, state: State, f: Array) -> None:
    """The same where all contacts hold all modes."""
    others, unit, coupled = state.modes[OTHERS], state.modes[UNIT], len(divided.damped) > 0
    r = len(others)
    if not coupled:
        for n in range(0, r, LANES):
            store(others, n, spread(0.0))
    for n in range(0, len(state.given), LANES):
        store(others, n, load(others, n) + load(state.given, n))
    for l in range(1, 0 if len(state.given) else len(f)):
        for n in range(0, r, LANES):
            store(others, n, load(others, n) + load(divided.B[l], n) * f[l])
    first = 0 if coupled else 1
    for n in range(0, r, LANES):
        held = spread(0.0)
        for k in range(first, len(state.multipliers)):
            row = state.weighted[k] if coupled else state.modes[ROW + k]
            held = held + load(row, n) * state.multipliers[k]
        store(others, n, load(others, n) - (held if coupled else held * load(unit, n)))
