r"""Terms that vary in time (`pmr.system.terms`) in a step, compiled: forces on its right-hand side, iterated.

.. math::
    w = -\sum_k c_k(t_{n+1}) \, (V_k \dot z + G_k z), \qquad
    \ddot z = S^{-1} (B f + w - \Omega^2 z^* - D v^* - C^T \lambda)

at the end of the step as all other forces, so that the scheme stays what it is.  S, the rows' factor and their tables
stay those of the constant matrices: w begins with what a cubic through the four steps before makes of it, and
multipliers and w are found anew until w no longer changes.  Each time its error is multiplied by at most the largest
ratio of

.. math:: dq\, x^T G x + dv\, x^T V x \quad \text{to} \quad x^T (1 + dv D + dq K) x, \qquad dq \approx h^2 / 4

over motions x that the contacts allow: less than the share of the buckling load with any step, and some 1e-4 where a
period takes some hundred steps.  So one to three times are the rule.  Where the ratio is not small, as under a tension
that makes most of the stiffness, w is extrapolated (`pmr.simulation.native.extrapolation`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native import extrapolation, friction
from pmr.simulation.native.arrays import (
    DAMPING,
    OTHERS,
    ROW,
    STIFFNESS,
    UNIT,
    V_NEXT,
    Z_FREE,
    Z_NEXT,
    Divided,
    Scheme,
    State,
    V,
    Z,
)
from pmr.simulation.native.compilation import addressed, compiled, inlined
from pmr.simulation.native.handles import call
from pmr.simulation.native.rows import dot, of_body
from pmr.simulation.native.side_arrays import Bodies, Sides
from pmr.simulation.native.simd import LANES, entry, load, spread, store
from pmr.simulation.native.term_arrays import Terms

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Change of w that counts as none, and the one that is accepted after the last time, over the largest w so far.
CONVERGED, ACCEPTED = 1e-11, 1e-8
#: Times that w is found in a step at most; returned where that is not enough.
LIMIT, UNCONVERGED = 100, -3
#: A change so many times the largest w, or the first one of the step, diverges.
DIVERGED = 1e6
SETTLED, AGAIN, LAST = 0, -4, -5
#: Entries of `Terms.numbers`: largest |w|^2 so far, times that w was found in this step, |w|^2 of the first one, work
#: since the start in J, |change|^2 of w before, by what it is multiplied from one time to the next at most, and
#: the times since this was last found.
LARGEST, TIMES, FIRST, WORK, CHANGE, SHRINKS, TRUSTED = range(7)
#: Entries of `Terms.calls`.
BEGIN, EXPECT, REVISE, ACCOUNT, TURN = range(5)
#: A change that is foreseen to be so much smaller than what counts as none isn't looked at, but for one in so many.
FORESEEN, MOST_TRUSTED = 0.1, 16


@compiled
def begin(terms: Terms, state: State, c: Array) -> int:
    """Forces w of the present state with amplitudes c (J,), where a simulation or steps of another length begin."""
    _combine(terms, c)
    friction.begin(terms.rubbing)
    _find_forces(terms, state)
    friction.take(terms.rubbing)
    friction.finish(terms.rubbing, state.multipliers)
    for n in range(0, len(terms.force), LANES):
        w = load(terms.new_force, n)
        store(terms.force, n, w)
        for k in range(len(terms.old_force)):
            store(terms.old_force[k], n, w)
        store(terms.old_z, n, load(state.modes[Z], n))
    return 0


@inlined
def begin_terms(terms: Terms, state: State, c: Array) -> None:
    """The same where there are any."""
    if len(terms.force) > 0:
        call(terms.calls[BEGIN], (terms, state, c))


@inlined
def expect(terms: Any, divided: Divided, state: State, f: Array, c: Any) -> None:
    """Begin a step under loads f (i,) and with amplitudes c (J,) at its end: w as the steps before go on."""
    if terms is not None:  # decided when compiled
        if len(terms.force) > 0:
            call(terms.calls[EXPECT], (terms, divided, state, f, c))


@addressed
def expected(terms: Terms, divided: Divided, state: State, f: Array, c: Array) -> int:
    """The same where there are any; 0."""
    _combine(terms, c)
    terms.numbers[TIMES] = 0.0
    extrapolation.restart(terms.history)
    for n in range(0, len(terms.force), LANES):
        ends = load(terms.old_force[0], n) * 4.0 - load(terms.old_force[3], n)  # of a cubic
        store(terms.force, n, ends + (load(terms.old_force[2], n) * 4.0 - load(terms.old_force[1], n) * 6.0))
    for n in range(0, len(terms.given), LANES):
        value = spread(0.0)
        for l in range(len(f)):
            value = value + load(divided.B[l], n) * f[l]
        store(terms.given, n, value)
    _divide(state.reach, terms, divided, state.modes)
    return 0


@inlined
def varies(terms: Any) -> bool:
    """Whether there are any."""
    if terms is None:
        return False
    return len(terms.force) > 0


@inlined
def turn(terms: Terms, bodies: Bodies, sides: Sides) -> None:
    """Take friction to where the contacts' sides stand."""
    if len(terms.rubbing.pads) > 0:
        call(terms.calls[TURN], (terms.rubbing, bodies, sides))


@inlined
def gap(terms: Any, k: int) -> float:
    """What contact k gives way to friction, m."""
    if terms is None:
        return 0.0
    return float(friction.gap(terms.rubbing, k))


@inlined
def push(terms: Any, scheme: Scheme, modes: Array) -> None:
    """Let w act on the displacement that a step leads to without multipliers and loads."""
    if terms is not None:
        for n in range(0, len(terms.force), LANES):
            store(modes[Z_FREE], n, load(modes[Z_FREE], n) + load(terms.divided, n) * scheme.z_gain)


@inlined
def revise(terms: Any, divided: Divided, scheme: Scheme, state: State) -> int:
    """Find w anew from the multipliers: SETTLED, AGAIN or for the LAST time where these have to follow, UNCONVERGED."""
    if terms is not None:
        if len(terms.force) > 0:
            return call(terms.calls[REVISE], (terms, divided, scheme, state))
    return SETTLED


@addressed
def revised(terms: Terms, divided: Divided, scheme: Scheme, state: State) -> int:
    """The same where there are any."""
    _reach(state.reach, terms, divided, scheme, state)
    _find_forces(terms, state)
    change, size = 0.0, 0.0
    for n in range(len(terms.force)):
        change += (terms.new_force[n] - terms.force[n]) ** 2
        size += terms.new_force[n] ** 2
    numbers = terms.numbers
    largest = max(numbers[LARGEST], size, friction.largest_square(terms.rubbing))
    numbers[TIMES] += 1.0
    if numbers[TIMES] == 1.0:
        numbers[FIRST] = size
    last, usual = numbers[TIMES] >= LIMIT, max(numbers[LARGEST], numbers[FIRST])
    if usual > 0.0 and change > DIVERGED**2 * usual:
        return UNCONVERGED
    bound = ACCEPTED if last else CONVERGED
    giving = friction.gives_way(terms.rubbing, bound)
    if numbers[TIMES] == 2.0 and numbers[CHANGE] > 0.0:
        numbers[SHRINKS] = max(numbers[SHRINKS] / 2.0, change / numbers[CHANGE])
        numbers[TRUSTED] = 0.0
    numbers[CHANGE] = change
    if (change <= bound**2 * largest and not giving) or change != change:  # what is not a number is said elsewhere
        numbers[LARGEST] = largest
        return SETTLED
    if last:
        return UNCONVERGED
    _extrapolate(terms, largest)
    _take(state.reach, terms, divided, scheme, state.modes)
    numbers[TRUSTED] += 1.0
    known = not giving and 0.0 < numbers[SHRINKS] and numbers[TRUSTED] < MOST_TRUSTED
    if known and change * numbers[SHRINKS] <= (FORESEEN * CONVERGED) ** 2 * largest:
        numbers[LARGEST] = largest
        return LAST
    return AGAIN


@inlined
def finish(terms: Any, modes: Array) -> None:
    """Let w act as further inputs and rows do, before a step ends."""
    if terms is not None:
        for n in range(0, len(terms.force), LANES):
            store(modes[OTHERS], n, load(modes[OTHERS], n) + load(terms.divided, n))


@inlined
def account(terms: Any, state: State) -> None:
    """Add the work of w in the step that has ended, and keep what the next one asks for."""
    if terms is not None:
        if len(terms.force) > 0:
            call(terms.calls[ACCOUNT], (terms, state))


@addressed
def accounted(terms: Terms, state: State) -> int:
    """The same where there are any; 0."""
    modes, work = state.modes, friction.finish(terms.rubbing, state.multipliers)
    for n in range(len(terms.force)):
        work += (terms.force[n] + terms.old_force[0, n]) / 2.0 * (modes[Z, n] - terms.old_z[n])
    terms.numbers[WORK] += work
    for n in range(0, len(terms.force), LANES):
        for k in range(len(terms.old_force) - 1, 0, -1):
            store(terms.old_force[k], n, load(terms.old_force[k - 1], n))
        store(terms.old_force[0], n, load(terms.force, n))
        store(terms.old_z, n, load(modes[Z], n))
    return 0


@inlined
def add(terms: Any, a: Array) -> None:
    """Add w to accelerations (r',)."""
    if terms is not None:
        for n in range(0, len(terms.force), LANES):
            store(a, n, load(a, n) + load(terms.force, n))


@inlined
def _combine(terms: Terms, c: Array) -> None:
    """Their sum with amplitudes c (J,), where these are others than before; none where friction alone acts."""
    same = True
    for k in range(len(c)):
        same = same and c[k] == terms.c[k]
        terms.c[k] = c[k]
    if same:
        return
    for n in range(0, len(terms.now), LANES):
        store(terms.now, n, spread(0.0))
    for k in range(len(c)):
        if c[k] != 0.0:
            for e in range(terms.first_part[k], terms.first_part[k + 1]):
                at = entry(terms.to, e)
                store(terms.now, at, load(terms.now, at) + load(terms.parts, LANES * e) * c[k])


@inlined
def _find_forces(terms: Terms, state: State) -> None:
    """W of the present displacements, their rates and multipliers, as `Terms.new_force`."""
    z, v = state.modes[Z], state.modes[V]
    for k in range(len(terms.of_rows)):
        first, middle, last = terms.of_rows[k, 0], terms.of_rows[k, 1], terms.of_rows[k, 2]
        of_z, of_v = spread(0.0), spread(0.0)
        for u in range(first, middle):
            of_z = of_z - load(terms.now, LANES * u) * entry(z, entry(terms.column, u))
        for u in range(middle, last):
            of_v = of_v - load(terms.now, LANES * u) * entry(v, entry(terms.column, u))
        store(terms.new_force, LANES * k, of_z + of_v)
    friction.rub(terms.rubbing, state, terms.new_force)


@inlined
def _divide(reach: Any, terms: Terms, divided: Divided, modes: Array) -> None:
    """S^-1 w."""
    if len(divided.damped) > 0:
        for n in range(len(terms.force)):
            first, last = of_body(reach, n, terms.force)
            terms.divided[n] = dot(divided.damped[2, n, first:last], terms.force[first:last])
    else:
        for n in range(0, len(terms.force), LANES):
            store(terms.divided, n, load(modes[UNIT], n) * load(terms.force, n))


@inlined
def _reach(reach: Any, terms: Terms, divided: Divided, scheme: Scheme, state: State) -> None:
    """Z and z' at the end of the step with the present multipliers and w."""
    if reach is None:  # decided when compiled
        _reach_some(terms, divided, scheme, state, 0, len(terms.force), 0, len(state.multipliers))
    else:
        for body in range(len(reach.bodies)):
            own = reach.bodies[body]
            _reach_some(terms, divided, scheme, state, own[0], own[1], own[4], own[5])


@inlined
def _reach_some(
    terms: Terms, divided: Divided, scheme: Scheme, state: State, begin: int, end: int, first: int, last: int
) -> None:
    """The same of some modes, which some contacts hold."""
    modes, coupled, given = state.modes, len(divided.damped) > 0, len(terms.given) == 0
    for n in range(begin, end, LANES):
        z, v = load(modes[Z_NEXT], n), load(modes[V_NEXT], n)
        a = load(state.given if given else terms.given, n) + load(terms.divided, n)
        if coupled:
            a = a + load(modes[OTHERS], n)
        else:
            a = a - load(modes[STIFFNESS], n) * z - load(modes[DAMPING], n) * v
        held = spread(0.0)
        for k in range(max(first, 0), last):
            row = state.weighted[k] if coupled else modes[ROW + k]
            held = held + load(row, n) * state.multipliers[k]
        a = a - (held if coupled else held * load(modes[UNIT], n))
        store(modes[Z], n, z + a * scheme.z_gain)
        store(modes[V], n, v + a * scheme.v_gain)


@inlined
def _extrapolate(terms: Terms, largest: float) -> None:
    """Replace the new w and what friction does to gaps by the next iterates."""
    history, r = terms.history, len(terms.force)
    for n in range(r):
        history.x[n], history.residual[n] = terms.force[n], terms.new_force[n] - terms.force[n]
    friction.note(terms.rubbing, history, r, np.sqrt(largest))
    extrapolation.extrapolate(history)
    for n in range(r):
        terms.new_force[n] = history.x[n]
    friction.follow(terms.rubbing, history, r)


@inlined
def restart(terms: Any) -> None:
    """Begin the iteration anew, where rows that have let go change what a step leads to."""
    if terms is not None:
        if len(terms.force) > 0:
            extrapolation.restart(terms.history)


@inlined
def _take(reach: Any, terms: Terms, divided: Divided, scheme: Scheme, modes: Array) -> None:
    """The new w instead of the old one."""
    for n in range(0, len(terms.force), LANES):
        store(modes[Z_FREE], n, load(modes[Z_FREE], n) - load(terms.divided, n) * scheme.z_gain)
        store(terms.force, n, load(terms.new_force, n))
    friction.take(terms.rubbing)
    _divide(reach, terms, divided, modes)
    push(terms, scheme, modes)
