r"""The contacts of bodies from their sides, compiled: all that depends on their places x alone.

.. math::
    C_{\rho} = \sum_{a \in \rho} \pm b_a(x_a)\, U V, \qquad
    G_{\rho\sigma} = \sum_{a \in \rho,\, c \in \sigma \text{ on one body}} \pm b_a(x_a)\, (U R U^T)\, b_c(x_c)^T, \qquad
    H_{\rho} = \sum_{a \in \rho} \pm b_a(x_a)\, (U R B)

over the sides a of a contact, G with what contacts give way by themselves (`pmr.system.compliance`); then the matrix of
the multipliers as in `pmr.simulation.native.rows`.  What sides that stay contribute is a constant.  Of the others each
row is a polynomial between two breaks, and so is every product with it: its coefficients are found on the way into an
interval, and from then on a pair of sides takes p (p + 1) multiplications with the p powers of a place, 20 for cubics,
instead of d (d + 1) with the d carriers that a side touches, 72 for a pad.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.arrays import ROW, UNIT, Divided, Modes, Scheme, State
from pmr.simulation.native.compilation import addressed, called, inlined
from pmr.simulation.native.rows import add_to_factor, dot, of_body
from pmr.simulation.native.side_arrays import Bodies, Polynomials, Sides
from pmr.simulation.native.simd import LANES, entry, load, spread, store, total, totals

Array = NDArray[np.float64]


@addressed
def move_sides(bodies: Bodies, divided: Divided, scheme: Scheme, state: State, sides: Sides, s: Array) -> int:
    """Evaluate rows and factor at s (P,) m of the paths; number of the first contact that depends on others, or 0."""
    moved = np.isnan(state.position[0])
    for k in range(len(s)):
        moved = moved or s[k] != sides.s[k]
        sides.s[k] = s[k]
    if not moved:
        return 0
    state.position[0], sides.moved[0] = 0.0, True
    q = len(sides.interval)
    for a in range(q):
        _locate(bodies.rows, sides, a)
    for a in range(q):
        if sides.entered[a]:
            _enter(bodies, sides, a)
    for k in range(len(state.multipliers)):
        _stay(bodies, state, sides, k)
    for a in range(q):
        _add_side(bodies, state, sides, a)
    for k in range(len(state.multipliers)):
        _couple_contact(bodies, divided, scheme, state, sides, k)
        if not add_to_factor(state.contact, state, k):
            state.position[0] = np.nan
            return k + 1
    return 0


@inlined
def _locate(rows: Polynomials, sides: Sides, a: int) -> None:
    """The interval of a side, and the powers of its place in it."""
    first, j = rows.first_break[a], max(sides.interval[a], 0)
    x = rows.at[a] + rows.rate[a] * sides.s[rows.path[a]]
    x = min(max(x, rows.breaks[first]), rows.breaks[first + rows.intervals[a]])  # beyond is round-off
    while j > 0 and x < rows.breaks[first + j]:
        j -= 1
    while j < rows.intervals[a] - 1 and x >= rows.breaks[first + j + 1]:
        j += 1
    sides.entered[a] = j != sides.interval[a]
    sides.interval[a] = j
    power = 1.0
    for p in range(sides.powers.shape[1]):
        sides.powers[a, p] = power
        power *= x - rows.breaks[first + j]


@called
def _enter(bodies: Bodies, sides: Sides, a: int) -> None:
    """Coefficients of all products of a side in the interval that it has entered."""
    rows, body, width = bodies.rows, bodies.rows.body[a], bodies.rows.width[a]
    first = rows.first_coefficient[a] + sides.interval[a] * width
    touched = rows.first_touched[a] + sides.interval[a] * width
    flexible, k = bodies.first_flexibility[body + 1] > bodies.first_flexibility[body], rows.contact[a]
    for p in range(sides.powers.shape[1]):
        for n in range(bodies.modes[body], bodies.modes[body + 1], LANES):
            value = spread(0.0)
            for l in range(width):
                at = bodies.carriers[body] + rows.touched[touched + l]
                value = value + load(bodies.values[at], n) * rows.coefficients[first + l, p]
            store(sides.of_modes[a, p], n, value)
        if not flexible:
            continue
        for n in range(bodies.beside[k, 0], bodies.beside[k, 1], LANES):
            value = spread(0.0)
            for l in range(width):
                at = bodies.carriers[body] + rows.touched[touched + l]
                value = value + load(bodies.staying_answers[at], n) * rows.coefficients[first + l, p]
            store(sides.of_staying[a, p], n, value)
        for n in range(bodies.own_inputs[body, 0] // LANES * LANES, bodies.own_inputs[body, 1], LANES):
            value = spread(0.0)
            for l in range(width):
                at = bodies.carriers[body] + rows.touched[touched + l]
                value = value + load(bodies.inputs[at], n) * rows.coefficients[first + l, p]
            store(sides.of_inputs[a, p], n, value)
    if not flexible:
        return
    for c in range(rows.beside[a, 0], rows.beside[a, 1]):
        if rows.body[c] == body and (c <= a or not sides.entered[c]):
            _multiply(bodies, sides, max(a, c), min(a, c))


@inlined
def _multiply(bodies: Bodies, sides: Sides, a: int, c: int) -> None:
    """Coefficients of b_a U R U^T b_c^T of two sides on one body."""
    rows, body, powers = bodies.rows, bodies.rows.body[a], sides.powers.shape[1]
    at_a, at_c = sides.interval[a] * rows.width[a], sides.interval[c] * rows.width[c]
    size = bodies.carriers[body + 1] - bodies.carriers[body]
    for n in range(rows.width[c]):
        line = bodies.first_flexibility[body] + rows.touched[rows.first_touched[c] + at_c + n] * size
        for p in range(0, powers, LANES):
            value = spread(0.0)
            for l in range(rows.width[a]):
                given = bodies.flexibility[line + rows.touched[rows.first_touched[a] + at_a + l]]
                value = value + load(rows.coefficients[rows.first_coefficient[a] + at_a + l], p) * given
            store(sides.room[n], p, value)
    for p in range(powers):
        for other in range(0, powers, LANES):
            value = spread(0.0)
            for n in range(rows.width[c]):
                value = value + load(rows.coefficients[rows.first_coefficient[c] + at_c + n], other) * sides.room[n, p]
            store(sides.of_others[a, c, p], other, value)


@inlined
def _stay(bodies: Bodies, state: State, sides: Sides, k: int) -> None:
    """What the sides of a contact that stay contribute."""
    for n in range(bodies.moves[k, 0], bodies.moves[k, 1], LANES):
        store(state.modes[ROW + k], n, load(bodies.staying[k], n))
    for n in range(bodies.beside[k, 0], bodies.beside[k, 1], LANES):
        store(sides.half[k], n, load(bodies.staying_half[k], n))
    for l in range(len(bodies.lengthening_path)):
        s = sides.s[bodies.lengthening_path[l]]
        for n in range(bodies.beside[k, 0], bodies.beside[k, 1], LANES):
            store(sides.half[k], n, load(sides.half[k], n) + load(bodies.lengthening[l, k], n) * s)
    for n in range(bodies.moved_by[k, 0], bodies.moved_by[k, 1], LANES):
        store(sides.inputs[k], n, load(bodies.staying_inputs[k], n))


@inlined
def _add_side(bodies: Bodies, state: State, sides: Sides, a: int) -> None:
    """What a side contributes to its contact: modes, inputs, and what forces at it and at all before it do."""
    rows, powers = bodies.rows, sides.powers.shape[1]
    k, body = rows.contact[a], rows.body[a]
    for n in range(bodies.modes[body], bodies.modes[body + 1], LANES):
        value = load(state.modes[ROW + k], n)
        for p in range(powers):
            value = value + load(sides.of_modes[a, p], n) * sides.powers[a, p]
        store(state.modes[ROW + k], n, value)
    if bodies.first_flexibility[body + 1] == bodies.first_flexibility[body]:
        return
    for n in range(bodies.own_inputs[body, 0] // LANES * LANES, bodies.own_inputs[body, 1], LANES):
        value = load(sides.inputs[k], n)
        for p in range(powers):
            value = value + load(sides.of_inputs[a, p], n) * sides.powers[a, p]
        store(sides.inputs[k], n, value)
    for n in range(bodies.beside[k, 0], bodies.beside[k, 1], LANES):
        value = load(sides.half[k], n)
        for p in range(powers):
            value = value + load(sides.of_staying[a, p], n) * sides.powers[a, p]
        store(sides.half[k], n, value)
    for c in range(rows.beside[a, 0], a):
        if rows.body[c] == body:
            sides.half[k, rows.contact[c]] += _between(sides, a, c)
    sides.half[k, k] += _between(sides, a, a) / 2.0


@inlined
def _between(sides: Sides, a: int, c: int) -> float:
    """b_a U R U^T b_c^T of two sides on one body."""
    sum_ = 0.0
    for other in range(0, sides.powers.shape[1], LANES):
        value = spread(0.0)
        for p in range(sides.powers.shape[1]):
            value = value + load(sides.of_others[a, c, p], other) * sides.powers[a, p]
        sum_ += total(value * load(sides.powers[c], other))
    return sum_


@inlined
def _couple_contact(bodies: Bodies, divided: Divided, scheme: Scheme, state: State, sides: Sides, k: int) -> None:
    """Row k of the contacts' matrix, up to its diagonal."""
    row, unit, weighted = state.modes[ROW + k], state.modes[UNIT], state.weighted[k]
    begin, end = bodies.moves[k, 0], bodies.moves[k, 1]
    if len(divided.damped) > 0:
        for n in range(begin, end):
            first, last = of_body(state.reach, n, row)
            weighted[n] = dot(divided.damped[2, n, first:last], row[first:last])
    else:
        for n in range(begin, end, LANES):
            store(weighted, n, load(unit, n) * load(row, n))
    for first in range(bodies.beside[k, 0], k + 1, LANES):  # four at once, those behind the row itself without use
        _couple_four(bodies, state, sides, k, first, scheme.z_gain)
    for l in range(bodies.beside[k, 0], k + 1):
        state.couplings[k, l] += sides.half[l, k]


@inlined
def _couple_four(bodies: Bodies, state: State, sides: Sides, k: int, first: int, gain: float) -> None:
    """Four entries of row k, but for half of the flexibility; rows beyond the last one count as that."""
    m, row, moves = len(state.multipliers), state.weighted[k], bodies.moves
    second, third, fourth = min(first + 1, m - 1), min(first + 2, m - 1), min(first + 3, m - 1)
    begin = min(moves[first, 0], moves[second, 0], moves[third, 0], moves[fourth, 0])
    end = max(moves[first, 1], moves[second, 1], moves[third, 1], moves[fourth, 1])
    a, b, c, d = spread(0.0), spread(0.0), spread(0.0), spread(0.0)
    for n in range(max(moves[k, 0], begin), min(moves[k, 1], end), LANES):
        weighted = load(row, n)
        a = a + weighted * load(state.modes[ROW + first], n)
        b = b + weighted * load(state.modes[ROW + second], n)
        c = c + weighted * load(state.modes[ROW + third], n)
        d = d + weighted * load(state.modes[ROW + fourth], n)
    store(state.couplings[k], first, load(sides.half[k], first) + totals(a, b, c, d) * gain)


@inlined
def give(modes: Modes, bodies: Bodies, divided: Divided, state: State, sides: Sides, f: Array) -> None:
    """What loads do: B f, accelerations S^-1 B f of the modes, and H f."""
    press(modes, bodies, state, sides, f)
    if len(divided.damped) > 0:
        for n in range(len(sides.push)):
            first, last = of_body(state.reach, n, sides.push)
            state.given[n] = dot(divided.damped[2, n, first:last], sides.push[first:last])
    else:
        for n in range(0, len(sides.push), LANES):
            store(state.given, n, load(state.modes[UNIT], n) * load(sides.push, n))


@called
def press(modes: Modes, bodies: Bodies, state: State, sides: Sides, f: Array) -> None:
    """Loads, each on its own body, and how far they move the contacts by themselves."""
    r = modes.B.shape[1]
    for l in range(len(f)):
        sides.loads[l] = f[l]
    for body in range(len(bodies.own_inputs)):
        first, last = bodies.own_inputs[body, 0], bodies.own_inputs[body, 1]
        for n in range(bodies.modes[body], bodies.modes[body + 1], LANES):
            push = spread(0.0)
            for l in range(first, last):
                push = push + load(modes.B, l * r + n) * entry(sides.loads, l)
            store(sides.push, n, push)
    for k in range(len(state.multipliers)):
        pushed = spread(0.0)
        for n in range(bodies.moved_by[k, 0], bodies.moved_by[k, 1], LANES):
            pushed = pushed + load(sides.inputs[k], n) * load(sides.loads, n)
        state.pushed[k] = total(pushed)
