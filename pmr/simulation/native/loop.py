r"""The one compiled loop of `march`: any bodies, whole steps or parts of them, states recorded.

What a simulation lacks is None, and what would be done with it is left out when the loop is compiled: tables of a body
on one path, or sides of contacts with places of their own; levels of steps that are made in parts; a balance of energy;
terms that vary in time.
So a body alone on its tables takes O(r m) a step and nothing else.

`run` is the entry point.  A system that is advanced from outside (`pmr.simulation.native.stepper`) has `step_observed`
of `pmr.simulation.native.part`, and a body alone `step_on_tables`, which takes a third of a microsecond from Python
(`pmr.simulation.native.bound_step`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.arrays import Contact, Drive, Record, V, Z
from pmr.simulation.native.compilation import compiled, inlined
from pmr.simulation.native.contact import begin_impulses
from pmr.simulation.native.part import Loop, make_part, start_sides
from pmr.simulation.native.parts import step_in_parts
from pmr.simulation.native.step import FINISHED
from pmr.simulation.native.terms import WORK

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@compiled
def run(loop: Loop, drive: Drive, record: Record, every: int, begun: int) -> tuple[int, int]:
    """Take `every` as many steps as `record` has room for; how many it were, and 0 or what stopped them.

    The first `begun` of them have been taken, and `drive` may end before the others do.  It is COARSE where the next
    step is made in more parts than `drive` has samples of: the state is that before it.  Recorded is
    each `every`-th step.
    """
    failed = start_sides(loop.sides, loop, drive.s[0], drive.f[0])
    if failed:
        return begun, failed
    row, until = np.int64(begun // every), every - begun % every
    steps = min(every * len(record.multipliers), begun + (len(drive.s) - 1) // drive.per)
    for number in range(begun, steps):
        n = number - begun
        begin_impulses(loop.state.contact)
        failed = step(loop.levels, loop, drive, n, record.peaks, row)
        if failed:
            return number, failed
        until -= 1
        if until == 0:
            _record(loop, record, row)
            row, until = row + 1, every
    return steps, FINISHED


@inlined
def step(levels: Any, loop: Loop, drive: Drive, n: int, peaks: Any, row: int) -> int:
    """Step number n, whole or in parts; as `advance` returns."""
    if levels is None:  # decided when compiled
        return make_part(loop, drive.s[n + 1], drive.f[n + 1], _at(drive.c, n + 1))
    reach = slice(n * drive.per, (n + 1) * drive.per + 1)
    return step_in_parts(loop, drive.given[n], drive.s[reach], drive.f[reach], _at(drive.c, reach), peaks[row])


@inlined
def _at(c: Any, steps: Any) -> Any:
    """Amplitudes of a step or some; None without terms."""
    return None if c is None else c[steps]


@inlined
def _record(loop: Loop, record: Record, row: int) -> None:
    """All but peaks."""
    _copy(record.z, row, loop.state.modes[Z])
    _copy(record.v, row, loop.state.modes[V])
    _copy(record.multipliers, row, loop.state.multipliers)
    _record_parts(record.parts, loop, row)
    _record_impulses(record.impulses, loop.state.contact, row)
    _record_energy(record.energy, loop.sides, row)
    _record_work(record.given, loop.terms, row)
    _record_friction(record.friction, loop.terms, row)


@inlined
def _copy(rows: Any, row: int, values: Array) -> None:
    if rows is not None:
        for k in range(rows.shape[1]):
            rows[row, k] = values[k]


@inlined
def _record_parts(rows: Any, loop: Loop, row: int) -> None:
    if rows is not None:
        rows[row] = loop.levels.parts[loop.control.active[0]]


@inlined
def _record_impulses(rows: Any, contact: Contact, row: int) -> None:
    if rows is not None:
        _copy(rows, row, contact.impulse)


@inlined
def _record_energy(rows: Any, sides: Any, row: int) -> None:
    if rows is not None:
        _copy(rows, row, sides.energy)


@inlined
def _record_work(rows: Any, terms: Any, row: int) -> None:
    if rows is not None:
        rows[row] = terms.numbers[WORK]


@inlined
def _record_friction(rows: Any, terms: Any, row: int) -> None:
    if rows is not None:
        _copy(rows, row, terms.rubbing.forces)
