r"""The contacts of a system of bodies, compiled: all that depends on their places x alone.

.. math::
    C_{\rho} = \sum_{a \in \rho} \pm b_a(x_a)\, U V, \qquad
    G_{\rho\sigma} = \sum_{a \in \rho,\, c \in \sigma \text{ on one body}} \pm b_a(x_a)\, (U R U^T)\, b_c(x_c)^T, \qquad
    H_{\rho} = \sum_{a \in \rho} \pm b_a(x_a)\, (U R B)

over the sides a of a contact; then the matrix of the multipliers as in `pmr.simulate.native.rows`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.simulate.native.arrays import ROW, UNIT, Scheme, State
from pmr.simulate.native.compilation import compiled_and_inlined, inlined
from pmr.simulate.native.multibody_arrays import Bodies, Polynomials, Sides
from pmr.simulate.native.rows import add_to_factor, dot
from pmr.simulate.native.simd import LANES, load, spread, store

Array = NDArray[np.float64]


@compiled_and_inlined
def move_sides(bodies: Bodies, scheme: Scheme, state: State, sides: Sides, x: Array) -> int:
    """Evaluate rows and factor at the places x (q,); number of the first contact that depends on others, or 0."""
    moved = False
    for a in range(len(x)):
        moved = moved or x[a] != sides.x[a]
    if not moved:
        return 0
    _weigh(bodies.rows, sides, x)
    m, r = len(state.multipliers), state.modes.shape[1]
    for k in range(m):
        for n in range(0, r, LANES):
            store(state.modes[ROW + k], n, spread(0.0))
        for l in range(m):
            sides.flexibility[k, l] = 0.0
        for l in range(sides.inputs.shape[1]):
            sides.inputs[k, l] = 0.0
    for a in range(len(x)):
        _add_side(bodies, state, sides, a)
    for k in range(m):
        _couple_contact(bodies, scheme, state, sides, k)
        if not add_to_factor(state.contact, state, k):
            sides.x[0] = np.nan
            return k + 1
    return 0


@inlined
def _weigh(rows: Polynomials, sides: Sides, x: Array) -> None:
    """b(x) of all sides, without their signs."""
    for a in range(len(x)):
        first, j = rows.first_break[a], sides.interval[a]
        while j > 0 and x[a] < rows.breaks[first + j]:
            j -= 1
        while j < rows.intervals[a] - 1 and x[a] >= rows.breaks[first + j + 1]:
            j += 1
        sides.interval[a], sides.x[a] = j, x[a]
        at, powers, width = x[a] - rows.breaks[first + j], rows.powers[a], rows.width[a]
        for l in range(width):
            entry = rows.first_coefficient[a] + (j * width + l) * powers
            value = 0.0
            for p in range(powers):
                value = value * at + rows.coefficients[entry + p]
            sides.weights[a, l] = value
            sides.numbers[a, l] = rows.touched[rows.first_touched[a] + j * width + l]


@inlined
def _add_side(bodies: Bodies, state: State, sides: Sides, a: int) -> None:
    """What a side measures of its body: modes, inputs, and the forces of all sides before it and its own."""
    k, body, width = bodies.contact[a], bodies.body[a], bodies.rows.width[a]
    row, first = state.modes[ROW + k], bodies.carriers[body]
    for l in range(width):
        sides.weights[a, l] *= bodies.sign[a]
        weight, at = sides.weights[a, l], first + sides.numbers[a, l]
        for n in range(bodies.modes[body], bodies.modes[body + 1], LANES):
            store(row, n, load(row, n) + load(bodies.values[at], n) * weight)
        for n in range(sides.inputs.shape[1]):
            sides.inputs[k, n] += weight * bodies.inputs[at, n]
    for c in range(a + 1):
        if bodies.body[c] == body:
            value = _between(bodies, sides, a, c)
            sides.flexibility[k, bodies.contact[c]] += value
            if c != a:
                sides.flexibility[bodies.contact[c], k] += value


@inlined
def _between(bodies: Bodies, sides: Sides, a: int, c: int) -> float:
    """b_a U R U^T b_c^T of two sides on one body."""
    body, total = bodies.body[a], 0.0
    size = bodies.carriers[body + 1] - bodies.carriers[body]
    for l in range(bodies.rows.width[a]):
        line, part = bodies.first_flexibility[body] + sides.numbers[a, l] * size, 0.0
        for n in range(bodies.rows.width[c]):
            part += bodies.flexibility[line + sides.numbers[c, n]] * sides.weights[c, n]
        total += sides.weights[a, l] * part
    return total


@inlined
def _couple_contact(bodies: Bodies, scheme: Scheme, state: State, sides: Sides, k: int) -> None:
    """Row k of the contacts' matrix, up to its diagonal, and what inputs move in it."""
    m, row, unit, weighted = len(state.multipliers), state.modes[ROW + k], state.modes[UNIT], state.weighted[k]
    if len(bodies.damped) > 0:
        for n in range(len(row)):
            weighted[n] = dot(bodies.damped[2, n], row)
    else:
        for n in range(0, len(row), LANES):
            store(weighted, n, load(unit, n) * load(row, n))
    for l in range(k + 1):
        state.couplings[k, l] = sides.flexibility[k, l] + scheme.z_gain * dot(weighted, state.modes[ROW + l])
    state.couplings[k, k] += bodies.compliance[k]
    for l in range(bodies.B.shape[0]):
        state.couplings[k, m + l] = sides.inputs[k, l] + scheme.z_gain * dot(bodies.B[l], row)
