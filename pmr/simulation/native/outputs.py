r"""Outputs of `march`, compiled.

.. math::
    y = O z + W f - X(s) \lambda

is a sum of columns times their shares: those of O times z, and the coefficients of X and W times -lambda x^p and f.  Of
contacts with places of their own X is that of the carriers times the weights of each side.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.arrays import Outputs, State, Tables, Z
from pmr.simulation.native.compilation import called, inlined
from pmr.simulation.native.friction import Rubbing
from pmr.simulation.native.rows import dot
from pmr.simulation.native.side_arrays import Bodies, SideOutputs, Sides
from pmr.simulation.native.simd import LANES, load, spread, store

Array = NDArray[np.float64]
_WIDE = 4 * LANES


@inlined
def observe(tables: Tables, outputs: Outputs, state: State, f: Array, y: Array) -> None:
    """Outputs y (o,) of the present state under the loads f (i,)."""
    j, z, shares, count = state.interval[0], state.modes[Z], state.shares, len(y)
    if len(shares) > 0:
        _share(state, state.position[0] - tables.breaks[j], f)
    of_modes, of_rows = outputs.of_modes, outputs.of_rows[j]
    if count < LANES:
        for n in range(count):
            total = 0.0
            for q in range(len(of_modes)):
                total += of_modes[q, n] * z[q]
            for q in range(len(shares)):
                total += of_rows[q, n] * shares[q]
            y[n] = total
        return
    wide = count // _WIDE * _WIDE
    for n in range(0, wide, _WIDE):  # four sums at a time: an addition has to wait for the one before
        zero = spread(0.0)
        sums = _add_wide(of_rows, shares, n, _add_wide(of_modes, z, n, (zero, zero, zero, zero)))
        for k in range(4):
            store(y, n + k * LANES, sums[k])
    for n in range(wide, count, LANES):
        at = min(n, count - LANES)  # the last ones overlap with those before
        store(y, at, _add(of_rows, shares, at, _add(of_modes, z, at, spread(0.0))))


@called
def observe_sides(outputs: SideOutputs, bodies: Bodies, sides: Sides, state: State, f: Array, y: Array) -> None:
    """The same of bodies whose contacts have places of their own."""
    rows, z, count = bodies.rows, state.modes[Z], len(y)
    for n in range(count):
        y[n] = 0.0
    for q in range(len(z)):
        _add_column(y, outputs.of_modes[q], z[q])
    for l in range(len(f)):
        _add_column(y, outputs.of_inputs[l], f[l])
    for k in range(len(state.multipliers)):
        _add_column(y, outputs.of_staying[k], -state.multipliers[k])
    for a in range(len(sides.interval)):
        body, width = rows.body[a], rows.width[a]
        if bodies.first_flexibility[body + 1] == bodies.first_flexibility[body]:
            continue
        touched = rows.first_touched[a] + sides.interval[a] * width
        first = rows.first_coefficient[a] + sides.interval[a] * width
        for l in range(width):
            weight = dot(rows.coefficients[first + l], sides.powers[a])
            share = -state.multipliers[rows.contact[a]] * weight
            _add_column(y, outputs.of_carriers[bodies.carriers[body] + rows.touched[touched + l]], share)


@inlined
def observe_moments(
    rubbing: Rubbing, outputs: SideOutputs, bodies: Bodies, sides: Sides, state: State, y: Array
) -> None:
    """Add to these what moments of friction do; nothing without any."""
    rows = bodies.rows
    for j in range(len(rubbing.pads)):
        moment = rubbing.arms[j] * rubbing.forces[j]
        if state.multipliers[rubbing.pads[j]] < 0.0:
            moment = -moment
        _add_column(y, outputs.of_staying_slopes[j], moment)
        for at in range(rubbing.first_side[j], rubbing.first_side[j + 1]):
            a = rubbing.side[at]
            body, width = rows.body[a], rows.width[a]
            if bodies.first_flexibility[body + 1] == bodies.first_flexibility[body]:
                continue
            touched = rows.first_touched[a] + sides.interval[a] * width
            first = rows.first_coefficient[a] + sides.interval[a] * width
            for l in range(width):
                slope = 0.0
                for p in range(1, sides.powers.shape[1]):
                    slope += p * rows.coefficients[first + l, p] * sides.powers[a, p - 1]
                column = outputs.of_carriers[bodies.carriers[body] + rows.touched[touched + l]]
                _add_column(y, column, moment * slope)


@inlined
def _add_column(y: Array, column: Array, share: float) -> None:
    for n in range(len(y)):
        y[n] += column[n] * share


@inlined
def _share(state: State, x: float, f: Array) -> None:
    """-lambda_k times the powers of x, highest first, row after row, then the loads."""
    m, i, shares = len(state.multipliers), len(f), state.shares
    powers = (len(shares) - i) // m if m else 0
    for k in range(m):
        share = -state.multipliers[k]
        for p in range((k + 1) * powers - 1, k * powers - 1, -1):
            shares[p] = share
            share *= x
    for l in range(i):
        shares[m * powers + l] = f[l]


@inlined
def _add(columns: Array, shares: Array, n: int, total: object) -> object:
    """Add entries n to n + 3 of columns (q, o) times the first q shares."""
    for q in range(len(columns)):
        total = total + load(columns[q], n) * shares[q]
    return total


@inlined
def _add_wide(columns: Array, shares: Array, n: int, sums: tuple[object, ...]) -> tuple[object, ...]:
    """Four times `_add`, for n, n + 4, n + 8 and n + 12."""
    a, b, c, d = sums
    for q in range(len(columns)):
        column, share = columns[q], shares[q]
        a = a + load(column, n) * share
        b = b + load(column, n + LANES) * share
        c = c + load(column, n + 2 * LANES) * share
        d = d + load(column, n + 3 * LANES) * share
    return a, b, c, d
