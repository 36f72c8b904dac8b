r"""The compiled loop over the steps of a system of bodies, with its balance of energy.

A step is that of one body (`pmr.simulate.native.step`): only the rows come from elsewhere.  What is stored and the work
that loads and travelling contacts do,

.. math::
    E &= \tfrac12 |\dot z|^2 + \tfrac12 z^T \Omega^2 z + \tfrac12 \lambda^T (G + 1/k) \lambda - \lambda^T H f
    + \tfrac12 f^T B^T R B f, \\
    \Delta W &= \bar f^T \Delta (B^T z + B^T R B f - H^T \lambda)
    + \bar \lambda^T (\Delta C\, \bar z + \Delta H\, \bar f - \tfrac12 \Delta G\, \bar \lambda)

is `pmr.simulate.balance` for rows with places of their own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pmr.simulate.native.arrays import ROW, Scheme, State, V, Z
from pmr.simulate.native.compilation import compiled, compiled_and_inlined, inlined
from pmr.simulate.native.multibody_arrays import Bodies, Sides
from pmr.simulate.native.multibody_rows import move_sides
from pmr.simulate.native.rows import dot
from pmr.simulate.native.step import FINISHED, advance

Array = NDArray[np.float64]


@compiled
def run(
    bodies: Bodies,
    scheme: Scheme,
    state: State,
    sides: Sides,
    x: Array,
    f: Array,
    parts: int,
    z: Array,
    v: Array,
    multipliers: Array,
    peaks: Array,
    energy: Array,
) -> tuple[int, int]:
    """Steps to places x (T, q) under f (T, i); z, v, multipliers, peaks, energy (T // parts, .) of each `parts`-th.

    Returns the number of steps taken and 0, or what stopped them as `advance` says.
    """
    m = len(state.multipliers)
    for n in range(len(x)):
        row, first = n // parts, n % parts == 0
        failed = move_sides(bodies, scheme, state, sides, x[n])
        if failed == 0:
            failed = advance(bodies, scheme, state, f[n])
        if failed:
            return n, failed
        account(bodies, state, sides, f[n])
        for k in range(m):
            force = state.multipliers[k]
            peaks[row, k] = force if first else max(peaks[row, k], force)
        if (n + 1) % parts == 0:
            for k in range(z.shape[1]):
                z[row, k], v[row, k] = state.modes[Z, k], state.modes[V, k]
            for k in range(m):
                multipliers[row, k] = state.multipliers[k]
            energy[row, 0], energy[row, 1] = sides.energy[0], sides.energy[1]
    return len(x), FINISHED


@compiled_and_inlined
def account(bodies: Bodies, state: State, sides: Sides, f: Array) -> None:
    """Energy of the present state under loads f (i,), and the work done since the last call."""
    modes, multipliers = state.modes, state.multipliers
    z, v = modes[Z], modes[V]
    work, stored = 0.0, dot(v, v) / 2.0
    for n in range(len(z)):
        stored += bodies.stiffness[n] * z[n] * z[n] / 2.0
    for l in range(len(f)):
        moved, direct = 0.0, 0.0
        for n in range(len(z)):
            moved += bodies.plain_inputs[l, n] * (z[n] - sides.old_z[n])
        for n in range(len(f)):
            moved += bodies.energy[l, n] * (f[n] - sides.old_loads[n])
            direct += bodies.energy[l, n] * f[n]
        for k in range(len(multipliers)):
            moved -= sides.inputs[k, l] * multipliers[k] - sides.old_inputs[k, l] * sides.old_multipliers[k]
        work += (f[l] + sides.old_loads[l]) / 2.0 * moved
        stored += f[l] * direct / 2.0
    for k in range(len(multipliers)):
        force, turned, given = multipliers[k], 0.0, bodies.compliance[k] * multipliers[k] / 2.0
        for n in range(len(z)):
            turned += (modes[ROW + k, n] - sides.old_rows[k, n]) * (z[n] + sides.old_z[n])
        for l in range(len(f)):
            turned += (sides.inputs[k, l] - sides.old_inputs[k, l]) * (f[l] + sides.old_loads[l])
            given -= sides.inputs[k, l] * f[l]
        for l in range(len(multipliers)):
            change = sides.flexibility[k, l] - sides.old_flexibility[k, l]
            turned -= change * (multipliers[l] + sides.old_multipliers[l]) / 2.0
            given += sides.flexibility[k, l] * multipliers[l] / 2.0
        work += (force + sides.old_multipliers[k]) * turned / 4.0
        stored += force * given
    sides.energy[0] = stored
    sides.energy[1] += work
    _keep(state, sides, f)


@inlined
def _keep(state: State, sides: Sides, f: Array) -> None:
    """For the next step."""
    z, multipliers = state.modes[Z], state.multipliers
    for n in range(len(z)):
        sides.old_z[n] = z[n]
    for l in range(len(f)):
        sides.old_loads[l] = f[l]
    for k in range(len(multipliers)):
        sides.old_multipliers[k] = multipliers[k]
        for n in range(len(z)):
            sides.old_rows[k, n] = state.modes[ROW + k, n]
        for l in range(len(f)):
            sides.old_inputs[k, l] = sides.inputs[k, l]
        for l in range(len(multipliers)):
            sides.old_flexibility[k, l] = sides.flexibility[k, l]
