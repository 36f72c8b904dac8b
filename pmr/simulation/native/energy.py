r"""The balance of energy of bodies on their contacts' sides, compiled: a term for each step.

What is stored and the work that loads and travelling contacts do,

.. math::
    E &= \tfrac12 |\dot z|^2 + \tfrac12 z^T \Omega^2 z + \tfrac12 \lambda^T (G + A) \lambda - \lambda^T H f
    + \tfrac12 f^T B^T R B f, \\
    \Delta W &= \bar f^T \Delta (B^T z + B^T R B f - H^T \lambda)
    + \bar \lambda^T (\Delta C\, \bar z + \Delta H\, \bar f - \tfrac12 \Delta (G + A)\, \bar \lambda)

with A of what gives way by itself (`pmr.system.compliance`), is `pmr.simulation.balance` for rows with places of their
own.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.arrays import ROW, Modes, State, V, Z
from pmr.simulation.native.compilation import called, inlined
from pmr.simulation.native.side_arrays import Bodies, Sides
from pmr.simulation.native.sides import press
from pmr.simulation.native.simd import LANES, entry, load, spread, store, total

Array = NDArray[np.float64]


@called
def account(modes: Modes, bodies: Bodies, state: State, sides: Sides) -> None:
    """Energy of the present state under the loads of `press`, and the work done since the last call."""
    z, v, old_z = state.modes[Z], state.modes[V], sides.old_z
    held, moved = spread(0.0), spread(0.0)
    for n in range(0, len(z), LANES):
        own = load(z, n)
        held = held + load(v, n) * load(v, n) + load(modes.stiffness, n) * own * own
        moved = moved + (load(sides.push, n) + load(sides.old_push, n)) * (own - load(old_z, n))
    _take(bodies, state, sides)
    stored = total(held) + sides.of_loads[0]  # both twice so far
    work = total(moved) + sides.of_loads[0] - sides.of_loads[1]
    held, moved = spread(0.0), spread(0.0)  # added up once: that takes as long as some more products
    for k in range(len(state.multipliers)):
        force, old_force = sides.forces[k], sides.old_forces[k]
        if force != 0.0:
            stored -= 2.0 * force * state.pushed[k]
            for n in range(bodies.beside[k, 0], bodies.beside[k, 1], LANES):
                held = held + load(sides.half[k], n) * load(sides.forces, n) * (2.0 * force)
        if force != 0.0 or old_force != 0.0:
            change, sum_ = (force - old_force) / 2.0, (force + old_force) / 2.0
            moved = moved - _pushed(bodies, sides, k) * change
            if sides.moved[0]:
                moved = moved + _turned(bodies, state, sides, k) * sum_
    sides.energy[0] = (stored + total(held)) / 2.0
    sides.energy[1] += (work + total(moved)) / 2.0
    _end(bodies, state, sides)


@inlined
def _take(bodies: Bodies, state: State, sides: Sides) -> None:
    """Forces, and what loads have to do with themselves."""
    moved, wide = spread(0.0), bodies.energy.shape[1]
    for body in range(len(bodies.own_inputs)):
        first, last = bodies.own_inputs[body, 0], bodies.own_inputs[body, 1]
        for n in range(first // LANES * LANES, last, LANES):
            own = spread(0.0)
            for l in range(first, last):
                own = own + load(bodies.energy, l * wide + n) * entry(sides.loads, l)
            moved = moved + own * load(sides.loads, n)
    sides.of_loads[0] = total(moved)
    for k in range(len(state.multipliers)):
        sides.forces[k] = state.multipliers[k]


@inlined
def _pushed(bodies: Bodies, sides: Sides, k: int) -> Any:
    """What loads move in a contact by themselves, four times its mean over the step, in the lanes of a register."""
    pushed = spread(0.0)
    for n in range(bodies.moved_by[k, 0], bodies.moved_by[k, 1], LANES):
        loads = load(sides.loads, n) + load(sides.old_loads, n)
        pushed = pushed + (load(sides.inputs[k], n) + load(sides.old_inputs[k], n)) * loads
    return pushed


@inlined
def _turned(bodies: Bodies, state: State, sides: Sides, k: int) -> Any:
    """What the new place of a contact makes of the motion, twice its mean over the step, but for that of inputs."""
    z, old_z, row, old, turned = state.modes[Z], sides.old_z, state.modes[ROW + k], sides.old_rows[k], spread(0.0)
    for n in range(bodies.moves[k, 0], bodies.moves[k, 1], LANES):
        turned = turned + (load(row, n) - load(old, n)) * (load(z, n) + load(old_z, n))
    # G + A = N + N^T, of which a quadratic form takes twice either
    for n in range(bodies.beside[k, 0], bodies.beside[k, 1], LANES):
        changed = load(sides.half[k], n) - load(sides.old_half[k], n)
        turned = turned - changed * (load(sides.forces, n) + load(sides.old_forces, n))
    return turned


@called
def keep(modes: Modes, bodies: Bodies, state: State, sides: Sides, f: Array) -> None:
    """For the next step."""
    press(modes, bodies, state, sides, f)
    _take(bodies, state, sides)
    _end(bodies, state, sides)


@inlined
def _end(bodies: Bodies, state: State, sides: Sides) -> None:
    for n in range(0, len(sides.old_z), LANES):
        store(sides.old_z, n, load(state.modes[Z], n))
        store(sides.old_push, n, load(sides.push, n))
    for n in range(0, len(sides.loads), LANES):
        store(sides.old_loads, n, load(sides.loads, n))
    for n in range(0, len(sides.forces), LANES):
        store(sides.old_forces, n, load(sides.forces, n))
    sides.of_loads[1] = sides.of_loads[0]
    if sides.moved[0]:
        for k in range(len(state.multipliers)):
            for n in range(bodies.moved_by[k, 0], bodies.moved_by[k, 1], LANES):
                store(sides.old_inputs[k], n, load(sides.inputs[k], n))
            for n in range(bodies.moves[k, 0], bodies.moves[k, 1], LANES):
                store(sides.old_rows[k], n, load(state.modes[ROW + k], n))
            for n in range(bodies.beside[k, 0], bodies.beside[k, 1], LANES):
                store(sides.old_half[k], n, load(sides.half[k], n))
    sides.moved[0] = False
