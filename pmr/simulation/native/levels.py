r"""Steps of several lengths in one simulation: how a step in parts begins, and what a part misses.

Where contacts only push, a step is made in 1, 2, 4, ... equal parts, as few as keep the forces to the tolerance
(`pmr.simulation.contact_step`).  A part of length h errs in the modes, in their leading term, by

.. math:: e = \frac{h^2}{12} (\ddot z_{n+1} - \ddot z_n) - \frac{5 h^2}{12} \sum_\rho C_\rho^T \Delta\lambda_\rho

with the sum over contacts that have opened or closed in it, at a time that nobody knows: half their impulse.  In the
forces of those that are closed this makes :math:`A^{-1} C e`.  The first term is that of the trapezoidal rule
(Zienkiewicz, Xie: A simple error estimator and adaptive time stepping procedure for dynamic analysis, Earthquake
Engineering and Structural Dynamics 20, 1991).  A step that misses too much is taken back and made in more parts.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.arrays import (
    A_NEXT,
    DAMPING,
    ROW,
    STIFFNESS,
    V_NEXT,
    Z_FREE,
    Z_NEXT,
    Contact,
    Modes,
    Scheme,
    State,
    V,
    Z,
)
from pmr.simulation.native.compilation import addressed, called, inlined
from pmr.simulation.native.rows import dot, dot_held, held, of_body, solve
from pmr.simulation.native.simd import LANES, load, store
from pmr.simulation.native.terms import add

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


#: Entries of `Levels.calls`.
STEP, BEGIN, MISSED = range(3)


class Levels(NamedTuple):
    """Constants of steps of L lengths; those that only `loops` refer to are kept alive here."""

    parts: Indices  # (L,): of how many such a step is made
    loops: Indices  # (L, words): the `Loop` of each (`pmr.simulation.native.handles`), with constants of its own
    modes: Array  # (L, 4, r'): STIFFNESS, DAMPING, UNIT and INPUT
    B: Array  # (L, i, r'): `Divided`
    damped: Array  # (L, 3, r', r') or (L, 0, 0, 0)
    couplings: Array  # (L, k, m, p', w): `Tables`; (L, 0, 0, 0, 0) without
    calls: Indices  # (3,): addresses by STEP, BEGIN and MISSED (`pmr.simulation.native.linking`)


class Control(NamedTuple):
    """Which level a step is made on, and what it began with."""

    level: Indices  # (1,): of the next step
    active: Indices  # (1,): that whose constants `State` holds; -1 where a step was taken back
    came: Indices  # (1,): that on which the step before ended
    bounds: Array  # (3,): tolerance, omega of the contacts in rad/s, largest force so far in N
    acceleration: Array  # (2, r'): before and after the last part
    began: Array  # (7, r'): Z_NEXT to V of `State.modes`
    began_forces: Array  # (3, m): multipliers, and `force` and `share` of `Contact`
    began_closed: NDArray[np.bool_]  # (m,)
    began_energy: Array  # (3,): `Sides.energy`, and the work of terms
    closed: NDArray[np.bool_]  # (m,): before the last part
    force: Array  # (m,): likewise


@called
def mark(contact: Contact, state: State, control: Control) -> None:
    """Note where a step begins."""
    if control.active[0] >= 0:  # where it was taken back already, this is known
        control.came[0] = control.active[0]
    for row in range(Z_NEXT, V + 1):
        for n in range(0, state.modes.shape[1], LANES):
            store(control.began[row - Z_NEXT], n, load(state.modes[row], n))
    for k in range(len(state.multipliers)):
        control.began_forces[0, k], control.began_closed[k] = state.multipliers[k], contact.closed[k]
        control.began_forces[1, k], control.began_forces[2, k] = contact.force[k], contact.share[k]


@called
def take_back(contact: Contact, state: State, control: Control) -> None:
    """Return to where the step began."""
    for row in range(Z_NEXT, V + 1):
        for n in range(0, state.modes.shape[1], LANES):
            store(state.modes[row], n, load(control.began[row - Z_NEXT], n))
    for k in range(len(state.multipliers)):
        state.multipliers[k], contact.closed[k] = control.began_forces[0, k], control.began_closed[k]
        contact.force[k], contact.share[k] = control.began_forces[1, k], control.began_forces[2, k]
    control.active[0] = -1


@inlined
def turn_to(levels: Levels, level: int, state: State, control: Control) -> None:
    """The modes' constants of a level; the rows have to be moved anew."""
    for k in range(4):
        for n in range(0, state.modes.shape[1], LANES):
            store(state.modes[k], n, load(levels.modes[level, k], n))
    control.active[0], state.position[0] = level, np.nan


@called
def predict(
    modes: Modes, scheme: Scheme, level: int, terms: Any, contact: Contact, state: State, control: Control, f: Array
) -> None:
    """The prediction of the first part on a level, under loads f (i,), and what the forces leave for it.

    The prediction stays where a step that was taken back is made on the level of the one before after all.
    """
    of_modes, c = state.modes, contact.memory
    accelerate(modes, terms, state, f, control.acceleration[0])
    if level == control.came[0]:
        return
    for n in range(0, of_modes.shape[1], LANES):
        given = load(control.acceleration[0], n)
        z = load(of_modes[Z], n) + load(of_modes[V], n) * scheme.z_from_v + given * (c.z_from_force + c.z_from_share)
        v = load(of_modes[V], n) + given * (c.v_from_force + c.v_from_share)
        store(of_modes[Z_NEXT], n, z)
        store(of_modes[V_NEXT], n, v)
        store(of_modes[A_NEXT], n, given * (c.a_from_force + c.a_from_share))
        held = load(of_modes[STIFFNESS], n) * z + load(of_modes[DAMPING], n) * v
        store(of_modes[Z_FREE], n, z - held * scheme.z_gain)
    for k in range(len(state.multipliers)):
        contact.force[k] = contact.share[k] = state.multipliers[k]


@called
def accelerate(modes: Modes, terms: Any, state: State, f: Array, a: Array) -> None:
    """Accelerations (r',) of the modes in the present state under loads f (i,)."""
    v, diagonal = state.modes[V], len(modes.damping) == 1
    _accelerate_free(state.reach, modes, state, f, a)
    for k in range(len(state.multipliers)):
        multiplier = state.multipliers[k]
        if multiplier != 0.0:  # open contacts have none
            first, last = held(state.reach, k, a)
            for n in range(first, last, LANES):
                store(a, n, load(a, n) - load(state.modes[ROW + k], n) * multiplier)
    if not diagonal:
        for n in range(len(a)):
            first, last = of_body(state.reach, n, a)
            a[n] -= dot(modes.damping[n, first:last], v[first:last])
    add(terms, a)


@inlined
def _accelerate_free(reach: Any, modes: Modes, state: State, f: Array, a: Array) -> None:
    """The same without contacts, terms and damping that couples modes; each load acts on its own body."""
    if reach is None:  # decided when compiled
        _accelerate_some(modes, state, f, a, 0, len(a), 0, len(f))
    else:
        for body in range(len(reach.bodies)):
            own = reach.bodies[body]
            _accelerate_some(modes, state, f, a, own[0], own[1], own[2], own[3])


@inlined
def _accelerate_some(
    modes: Modes, state: State, f: Array, a: Array, begin: int, end: int, first: int, last: int
) -> None:
    """Of some modes under some of the loads."""
    z, v, diagonal = state.modes[Z], state.modes[V], len(modes.damping) == 1
    for n in range(begin, end, LANES):
        value = load(modes.stiffness, n) * load(z, n)
        if diagonal:
            value = value + load(modes.damping[0], n) * load(v, n)
        for l in range(max(first, 0), last):
            value = value - load(modes.B[l], n) * f[l]
        store(a, n, value * -1.0)


@inlined
def note(contact: Contact, state: State, control: Control) -> None:
    """Which contacts are closed, and with what force, before a part."""
    for k in range(len(state.multipliers)):
        control.closed[k], control.force[k] = contact.closed[k], state.multipliers[k]


@addressed
def missed(
    modes: Modes, terms: Any, contact: Contact, state: State, control: Control, scheme: Scheme, f: Array
) -> float:
    """What the last part misses of the closed contacts' forces at most, over what it may miss."""
    old, new, h = control.acceleration[0], control.acceleration[1], scheme.z_from_v
    accelerate(modes, terms, state, f, new)
    for n in range(0, len(old), LANES):
        store(old, n, (load(new, n) - load(old, n)) * (h * h / 12.0))
    largest, most = control.bounds[2], 0.0
    for k in range(len(state.multipliers)):
        largest = max(largest, state.multipliers[k])
        if contact.closed[k] != control.closed[k]:
            impulse = (state.multipliers[k] - control.force[k]) * (5.0 * h * h / 12.0)
            first, last = held(state.reach, k, old)
            for n in range(first, last, LANES):
                store(old, n, load(old, n) - load(state.modes[ROW + k], n) * impulse)
    count = contact.factored[0]
    for n in range(count):
        k = contact.numbers[n]
        contact.entries[n] = dot_held(state.reach, k, state.modes[ROW + k], old)
    solve(state.reach, state.factor, contact.entries[:count])
    for n in range(count):
        most = max(most, abs(contact.entries[n]))
    for n in range(0, len(old), LANES):
        store(old, n, load(new, n))
    control.bounds[2] = largest
    allowed = control.bounds[0] * largest * min(1.0, h * control.bounds[1])
    return most / allowed if most > 0.0 else 0.0
