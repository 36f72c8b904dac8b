r"""The compiled loop over the steps of a system of bodies, with its balance of energy.

A step is that of one body (`pmr.simulation.native.step`): only the rows come from elsewhere.  What is stored and the
work that loads and travelling contacts do,

.. math::
    E &= \tfrac12 |\dot z|^2 + \tfrac12 z^T \Omega^2 z + \tfrac12 \lambda^T (G + 1/k) \lambda - \lambda^T H f
    + \tfrac12 f^T B^T R B f, \\
    \Delta W &= \bar f^T \Delta (B^T z + B^T R B f - H^T \lambda)
    + \bar \lambda^T (\Delta C\, \bar z + \Delta H\, \bar f - \tfrac12 \Delta G\, \bar \lambda)

is `pmr.simulation.balance` for rows with places of their own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.arrays import ROW, Contact, Scheme, State, V, Z
from pmr.simulation.native.compilation import compiled, compiled_and_inlined, inlined
from pmr.simulation.native.contact import begin_impulses
from pmr.simulation.native.multibody_arrays import Bodies, Sides
from pmr.simulation.native.multibody_levels import (
    Multibody,
    begin,
    contact_of,
    mark,
    missed,
    note,
    scheme_of,
    take_back,
)
from pmr.simulation.native.multibody_rows import move_sides
from pmr.simulation.native.rows import dot
from pmr.simulation.native.simd import LANES, load, store
from pmr.simulation.native.step import FINISHED, advance

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Where a step misses less than this share of what it may, the next one is made in half as many parts.
SPARE = 0.125


class Drive(NamedTuple):
    """Paths s (., P) and loads f (., i), sampled as finely as the last level takes it, the start included.

    `given` (T,) are the steps' levels, or -1 where they are to be found.
    """

    s: Array
    f: Array
    given: Indices


class Record(NamedTuple):
    """What is recorded of each step, r' modes and m contacts."""

    z: Array  # (T, r')
    v: Array  # (T, r')
    multipliers: Array  # (T, m) N
    peaks: Array  # (T, m) N: largest within the step
    impulses: Array  # (T, m) N s: given in the step, where contacts only push
    energy: Array  # (T, 2) J: what is stored, and the work since the start
    parts: Indices  # (T,): of how many the step was made


@compiled
def run(march: Multibody, drive: Drive, record: Record) -> tuple[int, int]:
    """Steps along paths under loads; the number of steps taken and 0, or what stopped them as `advance` says."""
    levels, state, control, s, f = march.levels, march.state, march.control, drive.s, drive.f
    finest = levels.parts[-1]
    if control.active[0] < 0 and len(record.z) > 0:
        first = np.int64(0)  # for a literal it would be compiled once more
        failed = _begin(march, first, s[0], f[0])
        if failed:
            return 0, failed
    scheme = scheme_of(levels, 0)
    for n in range(len(record.z)):
        peaks = record.peaks[n]
        begin_impulses(state.contact)
        if finest == 1:  # nothing to choose: the shorter way
            failed = _part(march, scheme, state, s[n + 1], f[n + 1])
            for k in range(len(peaks)):
                peaks[k] = state.multipliers[k]
        else:
            reach = slice(n * finest, (n + 1) * finest + 1)
            failed = _step(march, drive.given[n], s[reach], f[reach], peaks)
        if failed:
            return n, failed
        _record(state.contact, march, record, n)
    return len(record.z), FINISHED


@inlined
def _record(contact: Contact | None, march: Multibody, record: Record, n: int) -> None:
    """All but the peaks."""
    state, z, v = march.state, record.z[n], record.v[n]
    record.parts[n] = march.levels.parts[march.control.active[0]]
    for k in range(len(z)):
        z[k], v[k] = state.modes[Z, k], state.modes[V, k]
    for k in range(len(state.multipliers)):
        record.multipliers[n, k] = state.multipliers[k]
    if contact is not None:
        for k in range(len(state.multipliers)):
            record.impulses[n, k] = contact.impulse[k]
    record.energy[n, 0], record.energy[n, 1] = march.sides.energy[0], march.sides.energy[1]


@inlined
def _step(march: Multibody, given: int, s: Array, f: Array, peaks: Array) -> int:
    """One step, in as many parts as it takes to keep to the tolerance; as `advance` returns."""
    contact, control = march.state.contact, march.control
    level, last = given if given >= 0 else control.level[0], len(march.levels.parts) - 1
    found = given < 0 and last > 0
    if found:
        mark(contact, march)
    while True:
        if level != control.active[0]:
            failed = _begin(march, level, s[0], f[0])
            if failed:
                return failed
        failed, off = _parts(march, level, found, s, f, peaks)
        if failed or not found or off <= 1.0 or level == last:
            break
        take_back(contact, march)
        begin_impulses(contact)
        while off > 1.0 and level < last:  # half the length misses an eighth and may miss a half
            level, off = level + 1, off / 4.0
    control.level[0] = level - 1 if off < SPARE and level > 0 else level
    return failed


@inlined
def _parts(march: Multibody, level: int, judged: bool, s: Array, f: Array, peaks: Array) -> tuple[int, float]:
    """The parts of a step on a level; what failed, or 0, and what one of them misses over what it may."""
    levels, state = march.levels, march.state
    scheme, stride, off = scheme_of(levels, level), levels.parts[-1] // levels.parts[level], 0.0
    now = State(
        state.modes, state.multipliers, state.position, state.interval, state.couplings, state.factor, state.weighted,
        state.shares, contact_of(state.contact, levels, level),
    )  # fmt: skip
    for at in range(stride, len(s), stride):
        if judged:
            note(state.contact, state, march.control)
        failed = _part(march, scheme, now, s[at], f[at])
        if failed:
            return failed, off
        for k in range(len(peaks)):
            force = state.multipliers[k]
            peaks[k] = force if at == stride else max(peaks[k], force)
        if judged:
            off = max(off, missed(state.contact, march, scheme, f[at]))
    return FINISHED, off


@inlined
def _begin(march: Multibody, level: int, s: Array, f: Array) -> int:
    """Begin anew on a level; as `move_sides` returns."""
    failed = begin(march, level, s, f)
    if failed == 0:
        _keep(march.state, march.sides, f)
    return failed


@inlined
def _part(march: Multibody, scheme: Scheme, state: State, s: Array, f: Array) -> int:
    """One part of a step to s (P,) and f (i,) at its end; as `advance` returns."""
    failed = move_sides(march.bodies, scheme, state, march.sides, s)
    if failed == 0:
        failed = advance(march.bodies, scheme, state, f)
    if failed == 0:
        account(march.bodies, state, march.sides, f)
    return failed


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
    _keep(state, sides, f)


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
def _keep(state: State, sides: Sides, f: Array) -> None:
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
