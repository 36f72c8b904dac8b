r"""The balance of energy of bodies on their contacts' sides, compiled: a term for each step.

What is stored and the work that loads and travelling contacts do,

.. math::
    E &= \tfrac12 |\dot z|^2 + \tfrac12 z^T \Omega^2 z + \tfrac12 \lambda^T (G + 1/k) \lambda - \lambda^T H f
    + \tfrac12 f^T B^T R B f, \\
    \Delta W &= \bar f^T \Delta (B^T z + B^T R B f - H^T \lambda)
    + \bar \lambda^T (\Delta C\, \bar z + \Delta H\, \bar f - \tfrac12 \Delta G\, \bar \lambda)

is `pmr.simulation.balance` for rows with places of their own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.arrays import ROW, Modes, State, V, Z
from pmr.simulation.native.compilation import compiled_and_inlined, inlined
from pmr.simulation.native.rows import dot
from pmr.simulation.native.side_arrays import Bodies, Sides
from pmr.simulation.native.simd import LANES, load, store

Array = NDArray[np.float64]


@compiled_and_inlined
def account(modes: Modes, bodies: Bodies, state: State, sides: Sides, f: Array) -> None:
    """Energy of the present state under loads f (i,), and the work done since the last call."""
    multipliers, z, v = state.multipliers, state.modes[Z], state.modes[V]
    work, stored = 0.0, dot(v, v) / 2.0
    for n in range(len(z)):
        stored += modes.stiffness[n] * z[n] * z[n] / 2.0
    for l in range(len(f)):
        moved, direct = 0.0, 0.0
        for n in range(len(z)):
            moved += modes.B[l, n] * (z[n] - sides.old_z[n])
        for n in range(len(f)):
            moved += bodies.energy[l, n] * (f[n] - sides.old_loads[n])
            direct += bodies.energy[l, n] * f[n]
        for k in range(len(multipliers)):
            moved -= sides.inputs[k, l] * multipliers[k] - sides.old_inputs[k, l] * sides.old_multipliers[k]
        work += (f[l] + sides.old_loads[l]) / 2.0 * moved
        stored += f[l] * direct / 2.0
    for k in range(len(multipliers)):
        force, given = multipliers[k], bodies.compliance[k] * multipliers[k] / 2.0
        if force != 0.0:
            for l in range(len(f)):
                given -= sides.inputs[k, l] * f[l]
            for l in range(len(multipliers)):
                given += sides.half[k, l] * multipliers[l]
            stored += force * given
        mean = (force + sides.old_multipliers[k]) / 2.0
        if mean != 0.0 and sides.moved[0]:
            work += mean / 2.0 * _turned(bodies, state, sides, f, k)
    sides.energy[0] = stored
    sides.energy[1] += work
    keep(state, sides, f)


@inlined
def _turned(bodies: Bodies, state: State, sides: Sides, f: Array, k: int) -> float:
    """What the new place of a contact makes of the motion, twice its mean over the step."""
    turned, row, old = 0.0, state.modes[ROW + k], sides.old_rows[k]
    for n in range(bodies.moves[k, 0], bodies.moves[k, 1]):
        turned += (row[n] - old[n]) * (state.modes[Z, n] + sides.old_z[n])
    for l in range(len(f)):
        turned += (sides.inputs[k, l] - sides.old_inputs[k, l]) * (f[l] + sides.old_loads[l])
    for l in range(len(state.multipliers)):  # G = N + N^T, of which a quadratic form takes twice either
        turned -= (sides.half[k, l] - sides.old_half[k, l]) * (state.multipliers[l] + sides.old_multipliers[l])
    return turned


@inlined
def keep(state: State, sides: Sides, f: Array) -> None:
    """For the next step."""
    z, multipliers = state.modes[Z], state.multipliers
    for n in range(len(z)):
        sides.old_z[n] = z[n]
    for l in range(len(f)):
        sides.old_loads[l] = f[l]
    for k in range(len(multipliers)):
        sides.old_multipliers[k] = multipliers[k]
        for l in range(len(f)):
            sides.old_inputs[k, l] = sides.inputs[k, l]
        if sides.moved[0]:
            for n in range(0, len(z), LANES):
                store(sides.old_rows[k], n, load(state.modes[ROW + k], n))
            for n in range(0, sides.half.shape[1], LANES):
                store(sides.old_half[k], n, load(sides.half[k], n))
    sides.moved[0] = False
