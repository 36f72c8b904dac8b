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
from pmr.simulation.native.simd import LANES, load, spread, store, total

Array = NDArray[np.float64]


@compiled_and_inlined
def account(modes: Modes, bodies: Bodies, state: State, sides: Sides, f: Array) -> None:
    """Energy of the present state under loads f (i,), and the work done since the last call."""
    z, v, old_z = state.modes[Z], state.modes[V], sides.old_z
    for l in range(len(f)):
        sides.loads[l] = f[l]
    for k in range(len(state.multipliers)):
        sides.forces[k] = state.multipliers[k]
    held, moved = spread(0.0), spread(0.0)
    for n in range(0, len(z), LANES):
        own, push = load(z, n), spread(0.0)
        held = held + load(v, n) * load(v, n) + load(modes.stiffness, n) * own * own
        for l in range(len(f)):
            push = push + load(modes.B[l], n) * (f[l] + sides.old_loads[l])
        moved = moved + push * (own - load(old_z, n))
    stored, work = total(held), total(moved)  # both twice so far
    for l in range(len(f)):
        direct, before = dot(bodies.energy[l], sides.loads), dot(bodies.energy[l], sides.old_loads)
        stored += f[l] * direct
        work += (f[l] + sides.old_loads[l]) * (direct - before)
    for k in range(len(state.multipliers)):
        force, old_force = sides.forces[k], sides.old_forces[k]
        to, before = dot(sides.inputs[k], sides.loads), dot(sides.inputs[k], sides.old_loads)
        old_to, old_before = to, before
        if sides.moved[0]:
            old_to, old_before = dot(sides.old_inputs[k], sides.loads), dot(sides.old_inputs[k], sides.old_loads)
        work -= force * (to + before) - old_force * (old_to + old_before)
        if force != 0.0:
            given = bodies.compliance[k] * force / 2.0 - to + dot(sides.half[k], sides.forces)
            stored += 2.0 * force * given
        if sides.moved[0] and force + old_force != 0.0:
            turned = _turned(bodies, state, sides, k) + to + before - old_to - old_before
            work += (force + old_force) / 2.0 * turned
    sides.energy[0] = stored / 2.0
    sides.energy[1] += work / 2.0
    keep(state, sides, f)


@inlined
def _turned(bodies: Bodies, state: State, sides: Sides, k: int) -> float:
    """What the new place of a contact makes of the motion, twice its mean over the step, but for that of inputs."""
    z, old_z, row, old, turned = state.modes[Z], sides.old_z, state.modes[ROW + k], sides.old_rows[k], spread(0.0)
    for n in range(bodies.moves[k, 0], bodies.moves[k, 1], LANES):
        turned = turned + (load(row, n) - load(old, n)) * (load(z, n) + load(old_z, n))
    for n in range(0, len(sides.forces), LANES):  # G = N + N^T, of which a quadratic form takes twice either
        changed = load(sides.half[k], n) - load(sides.old_half[k], n)
        turned = turned - changed * (load(sides.forces, n) + load(sides.old_forces, n))
    return total(turned)


@inlined
def keep(state: State, sides: Sides, f: Array) -> None:
    """For the next step."""
    z = state.modes[Z]
    for n in range(0, len(z), LANES):
        store(sides.old_z, n, load(z, n))
    for l in range(len(f)):
        sides.old_loads[l] = f[l]
    for k in range(len(state.multipliers)):
        sides.old_forces[k] = state.multipliers[k]
    if sides.moved[0]:
        for k in range(len(state.multipliers)):
            for n in range(0, sides.inputs.shape[1], LANES):
                store(sides.old_inputs[k], n, load(sides.inputs[k], n))
            for n in range(0, len(z), LANES):
                store(sides.old_rows[k], n, load(state.modes[ROW + k], n))
            for n in range(0, sides.half.shape[1], LANES):
                store(sides.old_half[k], n, load(sides.half[k], n))
    sides.moved[0] = False
