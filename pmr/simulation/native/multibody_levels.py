r"""Steps of several lengths in one simulation of a system: how a step in parts begins, and what a part misses.

Where contacts only push, a step is made in 1, 2, 4, ... equal parts, as few as keep the forces to the tolerance
(`pmr.simulation.contact_step`).  A part of length h errs in the modes, in their leading term, by

.. math:: e = \frac{h^2}{12} (\ddot z_{n+1} - \ddot z_n) - \frac{5 h^2}{12} \sum_\rho C_\rho^T \Delta\lambda_\rho

with the sum over contacts that have opened or closed in it, at a time that nobody knows: half their impulse.  In the
forces of those that are closed this makes :math:`A^{-1} C e`.  The first term is that of the trapezoidal rule
(Zienkiewicz, Xie: A simple error estimator and adaptive time stepping procedure for dynamic analysis, Earthquake
Engineering and Structural Dynamics 20, 1991).  A step that misses too much is taken back and made in more parts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.arrays import (
    A_NEXT,
    DAMPING,
    INPUT,
    ROW,
    STIFFNESS,
    UNIT,
    V_NEXT,
    Z_FREE,
    Z_NEXT,
    Contact,
    Memory,
    Scheme,
    State,
    V,
    Z,
)
from pmr.simulation.native.compilation import inlined
from pmr.simulation.native.multibody_arrays import Bodies, Sides
from pmr.simulation.native.multibody_form import MultibodyForm
from pmr.simulation.native.multibody_rows import move_sides
from pmr.simulation.native.rows import dot, solve
from pmr.simulation.native.scheme import GeneralizedAlpha
from pmr.simulation.native.simd import LANES, load, store
from pmr.simulation.native.system import aligned, divided

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Levels(NamedTuple):
    """Constants of steps of L lengths."""

    parts: Indices  # (L,): of how many such a step is made
    schemes: Array  # (L, 9): `Scheme`
    memories: Array  # (L, 7): `Memory`
    modes: Array  # (L, 4, r'): STIFFNESS, DAMPING, UNIT and INPUT
    B: Array  # (L, i, r')
    damped: Array  # (L, 3, r', r') or (L, 0, 0, 0)


class Control(NamedTuple):
    """Which level a step is made on, and what it began with."""

    level: Indices  # (1,): of the next step
    active: Indices  # (1,): that whose constants `State` and `Bodies` hold; -1 where a step was taken back
    came: Indices  # (1,): that on which the step before ended
    bounds: Array  # (3,): tolerance, omega of the contacts in rad/s, largest force so far in N
    acceleration: Array  # (2, r'): before and after the last part
    began: Array  # (7, r'): Z_NEXT to V of `State.modes`
    began_forces: Array  # (3, m): multipliers, and `force` and `share` of `Contact`
    began_closed: NDArray[np.bool_]  # (m,)
    began_energy: Array  # (2,)
    closed: NDArray[np.bool_]  # (m,): before the last part
    force: Array  # (m,): likewise


class Multibody(NamedTuple):
    """A simulation of a system: what it is made of, and where it stands."""

    bodies: Bodies
    levels: Levels
    state: State
    sides: Sides
    control: Control


def levels(form: MultibodyForm, methods: list[GeneralizedAlpha], parts: tuple[int, ...]) -> Levels:
    """Of a step in so many parts each, by the `methods` of the parts."""
    omega2, D, schemes = form.along("K"), form.damping, [method.scheme() for method in methods]
    r, (i, L) = len(omega2), (form.B.shape[1], len(parts))
    modes, B, damped = np.zeros((L, 4, r)), np.zeros((L, i, r)), []
    for k, scheme in enumerate(schemes):
        B[k] = divided(form.B.T, omega2, D, scheme)
        modes[k, INPUT] = B[k, 0] if i else 0.0
        if form.classically_damped:
            modes[k, UNIT] = divided(np.ones(r), omega2, D, scheme)
            modes[k, STIFFNESS], modes[k, DAMPING] = modes[k, UNIT] * omega2, modes[k, UNIT] * np.diagonal(D)
        else:
            damped.append(np.stack([divided(A, omega2, D, scheme).T for A in (np.diag(omega2), D, np.eye(r))]))
    return Levels(
        parts=np.array(parts, np.int64),
        schemes=np.array(schemes),
        memories=np.array([method.memory() for method in methods]),
        modes=aligned(modes),
        B=aligned(B),
        damped=aligned(np.array(damped) if damped else np.zeros((L, 0, 0, 0))),
    )


def control(state: State, tolerance: float, omega: float) -> Control:
    """Before the first step, which begins on the first level."""
    m, r = len(state.multipliers), state.modes.shape[1]
    return Control(
        level=np.zeros(1, np.int64),
        active=np.full(1, -1),
        came=np.full(1, -1),
        bounds=np.array([tolerance, omega, 0.0]),
        acceleration=aligned(np.zeros((2, r))),
        began=aligned(np.zeros((V + 1 - Z_NEXT, r))),
        began_forces=np.zeros((3, m)),
        began_closed=np.zeros(m, np.bool_),
        began_energy=np.zeros(2),
        closed=np.zeros(m, np.bool_),
        force=np.zeros(m),
    )


@inlined
def scheme_of(levels: Levels, level: int) -> Scheme:
    """Factors of a part on a level."""
    c = levels.schemes[level]
    return Scheme(c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], c[8])


@inlined
def contact_of(contact: Contact | None, levels: Levels, level: int) -> Contact | None:
    """With what a force leaves on a level for the next part."""
    if contact is None:
        return contact  # with `None` all that is called with it would be compiled once more, for a contact or none
    c = levels.memories[level]
    return Contact(
        Memory(c[0], c[1], c[2], c[3], c[4], c[5], c[6]),
        contact.pushes,
        contact.clearance,
        contact.closed,
        contact.wrong,
        contact.factored,
        contact.numbers,
        contact.excess,
        contact.entries,
        contact.force,
        contact.share,
        contact.impulse,
    )


@inlined
def mark(contact: Contact | None, march: Multibody) -> None:
    """Note where a step begins."""
    state, sides, control = march.state, march.sides, march.control
    if contact is not None:
        control.came[0] = control.active[0]
        for row in range(Z_NEXT, V + 1):
            for n in range(0, state.modes.shape[1], LANES):
                store(control.began[row - Z_NEXT], n, load(state.modes[row], n))
        for k in range(len(state.multipliers)):
            control.began_forces[0, k], control.began_closed[k] = state.multipliers[k], contact.closed[k]
            control.began_forces[1, k], control.began_forces[2, k] = contact.force[k], contact.share[k]
        control.began_energy[0], control.began_energy[1] = sides.energy[0], sides.energy[1]


@inlined
def take_back(contact: Contact | None, march: Multibody) -> None:
    """Return to where the step began."""
    state, sides, control = march.state, march.sides, march.control
    if contact is not None:
        for row in range(Z_NEXT, V + 1):
            for n in range(0, state.modes.shape[1], LANES):
                store(state.modes[row], n, load(control.began[row - Z_NEXT], n))
        for k in range(len(state.multipliers)):
            state.multipliers[k], contact.closed[k] = control.began_forces[0, k], control.began_closed[k]
            contact.force[k], contact.share[k] = control.began_forces[1, k], control.began_forces[2, k]
        sides.energy[0], sides.energy[1] = control.began_energy[0], control.began_energy[1]
    control.active[0] = -1


@inlined
def begin(march: Multibody, level: int, s: Array, f: Array) -> int:
    """Constants of a level at s (P,) under f (i,), and the prediction of its first part; as `move_sides` returns.

    The prediction stays where a step that was taken back is made on the level of the one before after all.
    """
    bodies, levels, state, sides, control = march
    modes = state.modes
    for k in range(4):
        for n in range(0, modes.shape[1], LANES):
            store(modes[k], n, load(levels.modes[level, k], n))
    for l in range(len(bodies.B)):
        for n in range(0, modes.shape[1], LANES):
            store(bodies.B[l], n, load(levels.B[level, l], n))
    for k in range(len(bodies.damped)):
        for l in range(modes.shape[1]):
            for n in range(0, modes.shape[1], LANES):
                store(bodies.damped[k, l], n, load(levels.damped[level, k, l], n))
    control.active[0], state.position[0] = level, np.nan
    scheme, c = scheme_of(levels, level), levels.memories[level]
    failed = move_sides(bodies, scheme, state, sides, s)
    if failed:
        return failed
    accelerate(bodies, state, f, control.acceleration[0])
    if level == control.came[0]:
        return 0
    for n in range(0, modes.shape[1], LANES):
        given = load(control.acceleration[0], n)
        z = load(modes[Z], n) + load(modes[V], n) * scheme.z_from_v + given * (c[5] + c[6])
        v = load(modes[V], n) + given * (c[3] + c[4])
        store(modes[Z_NEXT], n, z)
        store(modes[V_NEXT], n, v)
        store(modes[A_NEXT], n, given * (c[1] + c[2]))
        store(modes[Z_FREE], n, z - (load(modes[STIFFNESS], n) * z + load(modes[DAMPING], n) * v) * scheme.z_gain)
    _leave(state.contact, state.multipliers)
    return 0


@inlined
def _leave(contact: Contact | None, multipliers: Array) -> None:
    """What the forces leave for the first part of a step that is begun anew."""
    if contact is not None:
        for k in range(len(multipliers)):
            contact.force[k] = contact.share[k] = multipliers[k]


@inlined
def accelerate(bodies: Bodies, state: State, f: Array, a: Array) -> None:
    """Accelerations (r',) of the modes in the present state under loads f (i,)."""
    z, v, diagonal = state.modes[Z], state.modes[V], len(bodies.damping) == 1
    for n in range(0, len(a), LANES):
        value = load(bodies.stiffness, n) * load(z, n)
        if diagonal:
            value = value + load(bodies.damping[0], n) * load(v, n)
        for k in range(len(state.multipliers)):
            value = value + load(state.modes[ROW + k], n) * state.multipliers[k]
        for l in range(len(f)):
            value = value - load(bodies.plain_inputs[l], n) * f[l]
        store(a, n, value * -1.0)
    if not diagonal:
        for n in range(len(a)):
            a[n] -= dot(bodies.damping[n], v)


@inlined
def note(contact: Contact | None, state: State, control: Control) -> None:
    """Which contacts are closed, and with what force, before a part."""
    if contact is not None:
        for k in range(len(state.multipliers)):
            control.closed[k], control.force[k] = contact.closed[k], state.multipliers[k]


@inlined
def missed(contact: Contact | None, march: Multibody, scheme: Scheme, f: Array) -> float:
    """What the last part misses of the closed contacts' forces at most, over what it may miss."""
    if contact is None:
        return 0.0
    bodies, state, control = march.bodies, march.state, march.control
    old, new, h = control.acceleration[0], control.acceleration[1], scheme.z_from_v
    accelerate(bodies, state, f, new)
    for n in range(0, len(old), LANES):
        store(old, n, (load(new, n) - load(old, n)) * (h * h / 12.0))
    largest, most = control.bounds[2], 0.0
    for k in range(len(state.multipliers)):
        largest = max(largest, state.multipliers[k])
        if contact.closed[k] != control.closed[k]:
            impulse = (state.multipliers[k] - control.force[k]) * (5.0 * h * h / 12.0)
            for n in range(0, len(old), LANES):
                store(old, n, load(old, n) - load(state.modes[ROW + k], n) * impulse)
    count = contact.factored[0]
    for n in range(count):
        contact.entries[n] = dot(state.modes[ROW + contact.numbers[n]], old)
    solve(state.factor, contact.entries[:count])
    for n in range(count):
        most = max(most, abs(contact.entries[n]))
    for n in range(0, len(old), LANES):
        store(old, n, load(new, n))
    control.bounds[2] = largest
    allowed = control.bounds[0] * largest * min(1.0, h * control.bounds[1])
    return most / allowed if most > 0.0 else 0.0
