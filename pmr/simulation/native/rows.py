r"""The rows of a body on one path from its tables, compiled: all that depends on the path coordinate s alone.

.. math::
    C(s), \qquad G(s) + dq\, C S^{-1} C^T = L\, \mathrm{diag}(d)\, L^T, \qquad H(s) + dq\, C S^{-1} B

are polynomials between the breaks; S and dq are explained in `pmr.simulation.native.step`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.arrays import ROW, Contact, Divided, State, Tables
from pmr.simulation.native.compilation import inlined
from pmr.simulation.native.simd import LANES, load, spread, store, total

Array = NDArray[np.float64]

#: A pivot of the rows' Schur complement below this share of its diagonal entry: the row depends on those before it.
SINGULAR = 1e-12


@inlined
def move_rows(tables: Tables, divided: Divided, state: State, s: float) -> int:
    """Evaluate rows and factor at s; number of the first row that depends on others, counted from 1, or 0.

    Nothing is done while s stays where it is, and rows that never move are done once.
    """
    before = state.position[0]
    if s == before:
        return 0
    first = 0 if np.isnan(before) else tables.constant_rows
    j = find_interval(tables.breaks, s, state.interval[0])
    x = s - tables.breaks[j]
    state.interval[0] = j
    state.position[0] = s
    for k in range(first, len(state.factor)):
        _evaluate(tables.rows[j, k], x, state.modes[ROW + k])
        _evaluate(tables.couplings[j, k], x, state.couplings[k])
        for n in range(divided.damped.shape[1]):
            state.weighted[k, n] = dot(divided.damped[2, n], state.modes[ROW + k])
        if not add_to_factor(state.contact, state, k):
            state.position[0] = np.nan
            return k + 1
    return 0


@inlined
def find_interval(breaks: Array, s: float, j: int) -> int:
    """Number of the interval that holds s, sought from j on."""
    while j > 0 and s < breaks[j]:
        j -= 1
    while j < len(breaks) - 2 and s >= breaks[j + 1]:
        j += 1
    return j


@inlined
def dot(a: Array, b: Array) -> float:
    """Inner product of two rows of `State.modes`."""
    return _dot(a, b, 0, len(a))


@inlined
def _dot(a: Array, b: Array, first: int, last: int) -> float:
    """That of some modes; in two sums, for each addition has to wait for the one before."""
    odd, even = spread(0.0), spread(0.0)
    if (last - first) % (2 * LANES):
        last -= LANES
        odd = load(a, last) * load(b, last)
    for n in range(first, last, 2 * LANES):
        even = even + load(a, n) * load(b, n)
        odd = odd + load(a, n + LANES) * load(b, n + LANES)
    return total(even + odd)


@inlined
def dot_held(reach: Any, k: int, row: Array, x: Array) -> float:
    """Inner product of row k of the contacts and x (r',), over the modes that the contact holds."""
    if reach is None:  # decided when compiled
        return dot(row, x)
    return _dot(row, x, reach.moves[k, 0], reach.moves[k, 1])


@inlined
def held(reach: Any, k: int, row: Array) -> tuple[int, int]:
    """The first and behind the last mode that contact k holds with its row (r',)."""
    if reach is None:
        return 0, len(row)
    return reach.moves[k, 0], reach.moves[k, 1]


@inlined
def of_body(reach: Any, n: int, row: Array) -> tuple[int, int]:
    """The first and behind the last mode of the body that mode n is of."""
    if reach is None:
        return 0, len(row)
    body = reach.of_mode[n]
    return reach.bodies[body, 0], reach.bodies[body, 1]


@inlined
def solve(reach: Any, factor: Array, x: Array) -> None:
    """Forward and backward substitution in place."""
    m = len(x)
    for k in range(m):
        value = x[k]
        for n in range(_begin(reach, k), k):
            value -= factor[k, n] * x[n]
        x[k] = value
    for k in range(m):
        x[k] *= factor[k, k]
    for k in range(m - 1, 0, -1):  # by rows, as they stand in memory: nothing waits for a sum
        value = x[k]
        for n in range(_begin(reach, k), k):
            x[n] -= factor[k, n] * value


@inlined
def _begin(reach: Any, k: int) -> int:
    """Where row k of the factor begins."""
    if reach is None:
        return 0
    return max(int(reach.begins[k]), 0)  # said to the compiler, that would count negative numbers from the end


@inlined
def _evaluate(c: Array, x: float, values: Array) -> None:
    """Polynomials (w,) at x from their coefficients (p, w), highest power first; cubics, those of beams, in one go."""
    if len(c) == 4:
        c0, c1, c2, c3 = c[0], c[1], c[2], c[3]
        for n in range(0, len(values), LANES):
            store(values, n, ((load(c0, n) * x + load(c1, n)) * x + load(c2, n)) * x + load(c3, n))
        return
    for n in range(0, len(values), LANES):
        value = load(c[0], n)
        for p in range(1, len(c)):
            value = value * x + load(c[p], n)
        store(values, n, value)


@inlined
def add_to_factor(contact: Contact | None, state: State, k: int) -> bool:
    """Row k joins the factor, where it is known to hold; False if it depends on those before it."""
    if contact is not None:  # decided when compiled
        if len(contact.pushes) > 0:
            contact.factored[0] = -1  # which rows hold follows later, in `pmr.simulation.native.contact`
            return True
    return factorise(state.reach, state.couplings[k], state.factor, k, _beside(state.reach, k))


@inlined
def _beside(reach: Any, k: int) -> int:
    """The first contact that shares anything with contact k."""
    if reach is None:
        return 0
    return max(min(int(reach.beside[k, 0]), k), 0)


@inlined
def factorise(reach: Any, entries: Array, factor: Array, k: int, begin: int) -> bool:
    """Row k of the factor L diag(d) L^T from the matrix's entries (k + 1,); False if it depends on those before it.

    Where the matrix begins with zeros so does the factor: contacts of a chain are coupled to their neighbours alone,
    its matrix is block tridiagonal, and the factor takes as long as there are links.  The entries before `begin` are
    known to be zero.
    """
    while begin < k and entries[begin] == 0.0:
        factor[k, begin] = 0.0
        begin += 1
    _begin_at(reach, factor, k, begin)
    for l in range(begin, k):
        entry = entries[l]
        for n in range(begin, l):
            entry -= factor[k, n] * factor[l, n]
        factor[k, l] = entry  # so far L d
    pivot = entries[k]
    for l in range(begin, k):
        entry = factor[k, l] * factor[l, l]
        pivot -= entry * factor[k, l]
        factor[k, l] = entry
    factor[k, k] = 1.0 / pivot
    return pivot > SINGULAR * entries[k]


@inlined
def _begin_at(reach: Any, factor: Array, k: int, begin: int) -> None:
    """Note where a row begins; those it meets are zero from there on, which a chain's are that is in order."""
    if reach is not None:
        reach.begins[k] = begin
        if k > 0 and begin < reach.begins[k - 1]:
            for l in range(begin, k):
                for n in range(begin, reach.begins[l]):
                    factor[l, n] = 0.0
