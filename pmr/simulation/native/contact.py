r"""Rows that only push, compiled: which of them hold is found together with the multipliers.

.. math::
    w = A \lambda - b, \qquad \lambda \ge 0, \quad w \ge 0, \quad \lambda^T w = 0

for the rows that push, w = 0 for all others.  A = dq C S^{-1} C^T + G + 1/k is the matrix of
`pmr.simulation.native.rows`, b how far the rows would come out beyond their clearances without multipliers, and w the
gap that is left.  A is symmetric and positive definite, so there is exactly one solution (Cottle, Pang, Stone: The
Linear Complementarity Problem, 1992, section 3.3).

Rows that are closed are solved for, the others are given lambda = 0; rows that come out wrong, with a pull or a
negative gap, change sides.  All of them do so at once as long as that leaves fewer wrong ones, or has failed to for
`CHANCES` times at most; after that only the first of them, until there are fewer.  That is block principal pivoting
with Murty's least-index rule behind it, which ends from any state (proof in docs/pads.md), so each step begins with
the rows that were closed in the one before.  Murty: Note on a Bard-type scheme for solving the complementarity problem,
Opsearch 11, 1974; Kostreva: Block pivot methods for solving the complementarity problem, Linear Algebra and its
Applications 21, 1978; Judice, Pires: A block principal pivoting algorithm for large-scale strictly monotone linear
complementarity problems, Computers and Operations Research 21, 1994.
"""

from __future__ import annotations

from typing import Any

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
    Memory,
    Scheme,
    State,
)
from pmr.simulation.native.compilation import compiled, inlined
from pmr.simulation.native.rows import factorise, held, solve
from pmr.simulation.native.simd import LANES, load, store

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Times that all wrong rows may change sides without leaving fewer wrong ones.
CHANCES = 3
#: Solves after which a step is given up: it takes one to three as a rule.
LIMIT = 1000
#: Returned instead of the number of a row where none of them settled anything.
UNSETTLED = -2
#: What of a pull or of a negative gap is round-off, over the largest force or the displacements that make up the gap.
ROUND_OFF = 1e-12
#: `Contact.factored` where the factor is that of another matrix.
STALE = -1


def contact(clearance: Array, memory: Memory) -> Contact | None:
    """What `settle` works with, from the rows' clearances (m,) m, NaN where they hold both ways; None if all do.

    Closed are the latter alone.
    """
    return None if np.isnan(clearance).all() else _contact(clearance, memory)


def without(memory: Memory) -> Contact:
    """The same where all rows hold both ways: without entries."""
    return _contact(np.zeros(0), memory)


def _contact(clearance: Array, memory: Memory) -> Contact:
    pushes, m = ~np.isnan(clearance), len(clearance)
    return Contact(
        memory=memory,
        pushes=pushes,
        clearance=np.where(pushes, clearance, 0.0),
        closed=~pushes,
        wrong=np.zeros(m, np.bool_),
        factored=np.full(1, STALE),
        numbers=np.zeros(m, np.int64),
        excess=np.zeros(m),
        entries=np.zeros(m),
        force=np.zeros(m),
        share=np.zeros(m),
        impulse=np.zeros(m),
        calls=np.zeros(1, np.int64),
    )


@compiled
def settle(contact: Contact, matrix: Array, factor: Array, multipliers: Array) -> int:
    """Multipliers (m,) instead of the motion beyond which the rows hold, with the lower half of A (m, w >= m).

    `factor` (m, m) holds that of the closed rows afterwards.  Returns 0, the number from 1 of a closed row that depends
    on those before it, or UNSETTLED.
    """
    closed, m = contact.closed, len(multipliers)
    for k in range(m):
        contact.excess[k] = multipliers[k] - contact.clearance[k]
    fewest, chances = m + 1, CHANCES
    for _ in range(LIMIT):
        failed = _solve_closed(contact, matrix, factor, multipliers)
        if failed:
            return failed
        wrong = _count_wrong(contact, matrix, multipliers)
        if wrong == 0:
            return 0
        if wrong < fewest:
            fewest, chances = wrong, CHANCES
        else:
            chances -= 1
        changes = wrong if chances >= 0 else 1
        for k in range(m):
            if changes > 0 and contact.wrong[k]:
                closed[k] = not closed[k]
                changes -= 1
        contact.factored[0] = STALE
    return UNSETTLED


@inlined
def let_go(contact: Contact, scheme: Scheme, state: State) -> bool:
    """Take back, for rows that have just opened, what their force of the step before adds to this one.

    Returns whether there are any; then the multipliers have to be found anew.
    """
    found = False
    for k in range(len(state.multipliers)):
        if contact.closed[k] or (contact.force[k] == 0.0 and contact.share[k] == 0.0):
            continue
        first, last = held(contact.reach, k, state.modes[ROW + k])
        _take_back(contact, scheme, state.modes, k, first, last)
        contact.force[k] = contact.share[k] = 0.0
        found = True
    return found


@inlined
def _take_back(contact: Contact, scheme: Scheme, modes: Array, k: int, first: int, last: int) -> None:
    memory, row, force, share = contact.memory, modes[ROW + k], contact.force[k], contact.share[k]
    of_z = memory.z_from_force * force + memory.z_from_share * share
    of_v = memory.v_from_force * force + memory.v_from_share * share
    of_a = memory.a_from_force * force + memory.a_from_share * share
    for n in range(first, last, LANES):
        c = load(row, n)
        store(modes[Z_NEXT], n, load(modes[Z_NEXT], n) + c * of_z)
        store(modes[V_NEXT], n, load(modes[V_NEXT], n) + c * of_v)
        store(modes[A_NEXT], n, load(modes[A_NEXT], n) + c * of_a)
        held = load(modes[STIFFNESS], n) * of_z + load(modes[DAMPING], n) * of_v
        store(modes[Z_FREE], n, load(modes[Z_FREE], n) + c * of_z - c * held * scheme.z_gain)


@inlined
def remember(contact: Contact, scheme: Scheme, multipliers: Array) -> None:
    """What the step leaves for the next one, and the impulse that it gave."""
    memory, force, share = contact.memory, contact.force, contact.share
    for k in range(len(multipliers)):
        ahead = memory.v_from_force * force[k] + memory.v_from_share * share[k]
        contact.impulse[k] += scheme.v_gain * multipliers[k] + ahead
        left = memory.a_from_force * force[k] + memory.a_from_share * share[k]
        share[k] = memory.gain * multipliers[k] + left
        force[k] = multipliers[k]


@inlined
def begin_impulses(contact: Contact | None) -> None:
    """Count them from here on."""
    if contact is not None:
        for k in range(len(contact.impulse)):
            contact.impulse[k] = 0.0


@inlined
def _solve_closed(contact: Contact, matrix: Array, factor: Array, multipliers: Array) -> int:
    """Multipliers with w = 0 at the closed rows and zero at the others; 0, or a dependent row from 1."""
    numbers, entries = contact.numbers, contact.entries
    if contact.factored[0] == STALE:
        count, begin = 0, 0
        for k in range(len(multipliers)):
            if contact.closed[k]:
                numbers[count] = k
                begin = _first_beside(contact.reach, numbers, k, begin, count)
                for l in range(begin, count + 1):
                    entries[l] = matrix[k, numbers[l]]
                if not factorise(contact.reach, entries, factor, count, begin):
                    return k + 1
                count += 1
        contact.factored[0] = count
    count = contact.factored[0]
    for n in range(count):
        entries[n] = contact.excess[numbers[n]]
    solve(contact.reach, factor, entries[:count])
    for k in range(len(multipliers)):
        multipliers[k] = 0.0
    for n in range(count):
        multipliers[numbers[n]] = entries[n]
    return 0


@inlined
def _first_beside(reach: Any, numbers: Indices, k: int, begin: int, count: int) -> int:
    """Which of the first `count` ascending numbers of contacts is the first on the bodies of contact k.

    It is sought from `begin` on, where it was for the one before.
    """
    if reach is None:  # decided when compiled
        return 0
    while begin > 0 and numbers[begin - 1] >= reach.beside[k, 0]:
        begin -= 1
    while begin < count and numbers[begin] < reach.beside[k, 0]:
        begin += 1
    return max(begin, 0)


@inlined
def _is_beside(reach: Any, k: int, l: int) -> bool:
    """Whether contact l may be on the bodies of contact k, or one before those."""
    if reach is None:
        return True
    return bool(l < reach.beside[k, 1])


@inlined
def _count_wrong(contact: Contact, matrix: Array, multipliers: Array) -> int:
    """Number of rows that pull, or would have to push, each of which is marked."""
    largest, wrong = 0.0, 0
    for k in range(len(multipliers)):
        largest = max(largest, abs(multipliers[k]))
    begin, count = 0, contact.factored[0]
    for k in range(len(multipliers)):
        contact.wrong[k] = False
        if contact.pushes[k]:
            if contact.closed[k]:
                contact.wrong[k] = multipliers[k] < -ROUND_OFF * largest
            else:
                gap, size = -contact.excess[k], abs(contact.excess[k])
                begin = _first_beside(contact.reach, contact.numbers, k, begin, count)
                for n in range(begin, count):
                    l = contact.numbers[n]
                    if not _is_beside(contact.reach, k, l):
                        break
                    part = matrix[max(k, l), min(k, l)] * multipliers[l]
                    gap += part
                    size += abs(part)
                contact.wrong[k] = gap < -ROUND_OFF * size
            wrong += contact.wrong[k]
    return wrong
