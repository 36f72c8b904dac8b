"""A step that is made in parts, as many as the forces of contacts that only push ask for; compiled.

`pmr.simulation.native.levels` has what decides.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native import friction
from pmr.simulation.native.arrays import Drive
from pmr.simulation.native.compilation import addressed, called, inlined
from pmr.simulation.native.contact import begin_impulses
from pmr.simulation.native.energy import keep
from pmr.simulation.native.handles import call, instead, number
from pmr.simulation.native.levels import (
    BEGIN,
    MISSED,
    Control,
    mark,
    note,
    predict,
    take_back,
    turn_to,
)
from pmr.simulation.native.part import Loop, make_part, move, start_sides
from pmr.simulation.native.quasi_static import follow
from pmr.simulation.native.side_arrays import Sides
from pmr.simulation.native.step import FINISHED
from pmr.simulation.native.terms import WORK, begin_terms

Array = NDArray[np.float64]

#: Where a step misses less than this share of what it may, the next one is made in half as many parts.
SPARE = 0.125
#: Returned where path and loads are known at fewer times than a step has parts.
COARSE = -6


@addressed
def take_step(loop: Loop, drive: Drive, n: int, row: int) -> int:
    """Step number n of those that are driven, or with n < 0 what comes before the first; as `advance` returns."""
    if n < 0:
        return start_sides(loop.sides, loop, drive.s[0], drive.f[0])
    begin_impulses(loop.state.contact)
    reach = slice(n * drive.per, (n + 1) * drive.per + 1)
    return step_in_parts(loop, drive.given[n], drive.s[reach], drive.f[reach], drive.c[reach], drive.peaks[row])


@inlined
def step_in_parts(loop: Loop, given: int, s: Array, f: Array, c: Array, peaks: Array) -> int:
    """One step, in as many parts as it takes to keep to the tolerance; as `advance` returns, or COARSE before it."""
    contact, state, control = loop.state.contact, loop.state, loop.control
    level, last = given if given >= 0 else control.level[0], len(loop.levels.parts) - 1
    found = given < 0 and last > 0
    if found:
        mark(contact, state, control)
        _mark(loop.sides, loop.terms, control)
    while True:
        if loop.levels.parts[level] > len(s) - 1:
            control.level[0] = level
            return COARSE
        now = instead(loop, loop.levels.loops[level])
        if level != control.active[0]:
            failed = call(loop.levels.calls[BEGIN], (now, level, s[0], f[0], c[0]))
            if failed:
                return failed
        failed, off = _parts(now, level, found, s, f, c, peaks)
        if failed or not found or off <= 1.0 or level == last:
            break
        take_back(contact, state, control)
        _take_back(loop.sides, loop.terms, control)
        begin_impulses(contact)
        while off > 1.0 and level < last:  # half the length misses an eighth and may miss a half
            level, off = level + 1, off / 4.0
    control.level[0] = level - 1 if off < SPARE and level > 0 else level
    return failed


@called
def _parts(loop: Loop, level: int, judged: bool, s: Array, f: Array, c: Array, peaks: Array) -> tuple[int, float]:
    """The parts of a step on a level; what failed, or 0, and what one of them misses over what it may."""
    levels, state, control = loop.levels, loop.state, loop.control
    stride, off = (len(s) - 1) // levels.parts[level], 0.0
    for at in range(stride, len(s), stride):
        if judged:
            note(state.contact, state, control)
        failed = make_part(loop, s[at], f[at], c[at])
        if failed:
            return failed, off
        for k in range(len(peaks)):
            force = state.multipliers[k]
            peaks[k] = force if at == stride else max(peaks[k], force)
        if judged:
            given = loop.modes, loop.terms, state.contact, state, control, loop.scheme, f[at]
            off = max(off, number(levels.calls[MISSED], given))
    return FINISHED, off


@addressed
def begin(loop: Loop, level: int, s: Array, f: Array, c: Array) -> int:
    """Begin anew on a level at s (P,) under f (i,) and c (K,), where the last step ended; as `move_sides` returns."""
    turn_to(loop.levels, level, loop.state, loop.control)
    failed = move(loop.tables, loop.sides, loop, s)
    if failed == 0:
        begin_terms(loop.terms, loop.state, c)
        predict(loop.modes, loop.scheme, level, loop.terms, loop.state.contact, loop.state, loop.control, f)
        follow(loop.quasi_static, loop.scheme, loop.state.modes)
        _keep(loop.sides, loop, f)
    return failed


@inlined
def _keep(sides: Sides | None, loop: Loop, f: Array) -> None:
    if sides is not None:
        keep(loop.modes, loop.bodies, loop.state, sides, f)


@inlined
def _mark(sides: Sides | None, terms: Any, control: Control) -> None:
    friction.mark(terms.rubbing)
    control.began_energy[2] = terms.numbers[WORK]
    if sides is not None:
        control.began_energy[0], control.began_energy[1] = sides.energy[0], sides.energy[1]


@inlined
def _take_back(sides: Sides | None, terms: Any, control: Control) -> None:
    friction.take_back(terms.rubbing)
    terms.numbers[WORK] = control.began_energy[2]
    if sides is not None:
        sides.energy[0], sides.energy[1] = control.began_energy[0], control.began_energy[1]
