r"""The one compiled loop of `march`: any bodies, whole steps or parts of them, states recorded.

There are three kinds of loops.  A body that is nothing but its tables on one path takes O(r m) a step: what it lacks is
None, and what would be done with it is left out when its loop is compiled.  Other bodies on tables have one loop, and
bodies on contacts with places of their own another, as have long chains: what some of them lack are arrays without
entries.  These loops call by addresses what is compiled apart, each when first asked for: a step, places of contacts,
contacts that only push, steps in parts, terms that vary in time, friction (`pmr.simulation.native.linking`).

`run` is the entry point.  A system that is advanced from outside (`pmr.simulation.native.stepper`) has `step_observed`
of `pmr.simulation.native.stepped`, and a body alone `step_on_tables`, which takes a third of a microsecond from Python
(`pmr.simulation.native.bound_step`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native.arrays import Contact, Drive, Record, V, Z
from pmr.simulation.native.compilation import compiled, inlined
from pmr.simulation.native.handles import call
from pmr.simulation.native.levels import STEP
from pmr.simulation.native.part import Loop, make_part
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
    failed = start(loop.levels, loop, drive)
    if failed:
        return begun, failed
    row, until = np.int64(begun // every), every - begun % every
    steps = min(every * len(record.multipliers), begun + (len(drive.s) - 1) // drive.per)
    for number in range(begun, steps):
        n = number - begun
        failed = step(loop.levels, loop, drive, n, row)
        if failed:
            return number, failed
        until -= 1
        if until == 0:
            _record(loop, record, row)
            row, until = row + 1, every
    return steps, FINISHED


@inlined
def start(levels: Any, loop: Loop, drive: Drive) -> int:
    """What comes before the first step; as `move_sides` returns."""
    if levels is None:  # decided when compiled
        return 0
    return call(levels.calls[STEP], (loop, drive, -1, 0))


@inlined
def step(levels: Any, loop: Loop, drive: Drive, n: int, row: int) -> int:
    """Step number n, whole or in parts; as `advance` returns."""
    if levels is None:
        return make_part(loop, drive.s[n + 1], drive.f[n + 1], None)
    return call(levels.calls[STEP], (loop, drive, n, row))


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
