"""One part of a step of whatever is simulated: a body on its tables, or bodies on their contacts' sides; compiled.

What a body that is nothing but its tables lacks is None, and what would be done with it is left out when the loop is
compiled.  All others have arrays without entries for what they lack, so that they share what is compiled.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.simulation.native import quasi_static, terms
from pmr.simulation.native.arrays import Divided, Modes, Outputs, Scheme, State, Tables
from pmr.simulation.native.compilation import compiled_and_inlined, inlined
from pmr.simulation.native.energy import account
from pmr.simulation.native.handles import call
from pmr.simulation.native.outputs import observe, observe_moments, observe_sides
from pmr.simulation.native.rows import move_rows
from pmr.simulation.native.side_arrays import SideOutputs, Sides
from pmr.simulation.native.sides import give, press
from pmr.simulation.native.step import advance

Array = NDArray[np.float64]


class Loop(NamedTuple):
    """A simulation: what it is made of, and where it stands."""

    modes: Modes
    divided: Divided
    scheme: Scheme
    tables: Any  # `Tables`, or None
    bodies: Any  # `Bodies` and `Sides`, or None
    sides: Any
    state: State
    levels: Any  # `Levels` and `Control`, or None
    control: Any
    terms: Any  # `Terms`, or None
    quasi_static: Any  # `QuasiStatic`, or None


@inlined
def start_sides(sides: Sides | None, loop: Loop, s: Array, f: Array) -> int:
    """Before the first step: the sides at s (P,), and the energy under f (i,); as `move_sides` returns."""
    failed = 0
    if sides is not None:  # decided when compiled
        if np.isnan(sides.energy[0]):
            failed = call(sides.calls[0], (loop.bodies, loop.divided, loop.scheme, loop.state, sides, s))
            if failed == 0:
                press(loop.modes, loop.bodies, loop.state, sides, f)
                account(loop.modes, loop.bodies, loop.state, sides)
                sides.energy[1] = 0.0
    return failed


@inlined
def make_part(loop: Loop, s: Array, f: Array, c: Any) -> int:
    """One part of a step to s (P,), f (i,) and amplitudes c (K,) or None at its end; as `advance` returns."""
    quasi_static.leave(loop.quasi_static, loop.state.modes)
    failed = move(loop.tables, loop.sides, loop, s)
    if failed == 0:
        _give(loop.sides, loop, f)
        failed = advance(loop.divided, loop.scheme, loop.state, loop.terms, loop.quasi_static, f, c)
    if failed == 0:
        quasi_static.stop(loop.quasi_static, loop.state.modes)
        _account(loop.sides, loop)
        terms.account(loop.terms, loop.state)
        quasi_static.finish(loop.quasi_static, loop.scheme, loop.state.modes)
    return failed


@inlined
def move(tables: Tables | None, sides: Sides | None, loop: Loop, s: Array) -> int:
    """Take the rows to s (P,); 0, or the number from 1 of one that depends on those before it."""
    failed = 0
    if tables is not None:
        failed = move_rows(tables, loop.divided, loop.state, s[0])
    if sides is not None:
        failed = call(sides.calls[0], (loop.bodies, loop.divided, loop.scheme, loop.state, sides, s))  # move_sides
        terms.turn(loop.terms, loop.bodies, sides)
    return failed


@inlined
def _give(sides: Sides | None, loop: Loop, f: Array) -> None:
    if sides is not None:
        give(loop.modes, loop.bodies, loop.divided, loop.state, sides, f)


@inlined
def _account(sides: Sides | None, loop: Loop) -> None:
    if sides is not None:
        account(loop.modes, loop.bodies, loop.state, sides)


class Alone(NamedTuple):
    """A body on one path."""

    tables: Tables
    divided: Divided
    scheme: Scheme
    outputs: Outputs
    state: State


@compiled_and_inlined
def step_on_tables(body: Alone, s: float, f: Array, y: Array) -> int:
    """One step of a body on one path to s under f (i,), and its outputs y (o,); 0, or what `advance` returns."""
    return step_alone(body, s, f, y)


@inlined
def step_alone(body: Alone, s: float, f: Array, y: Array) -> int:
    """The same as a part of `pmr.simulation.native.bound_step`, for which it need not be compiled by itself."""
    failed = move_rows(body.tables, body.divided, body.state, s)
    if failed == 0:
        failed = advance(body.divided, body.scheme, body.state, None, None, f, None)
    if failed == 0:
        observe(body.tables, body.outputs, body.state, f, y)
    return failed


@inlined
def observe_all(loop: Loop, outputs: Any, f: Array, y: Array) -> None:
    """All outputs y (o,) of the bodies at present, under f (i,)."""
    _observe_tables(loop.tables, outputs, loop.state, f, y)
    _observe_sides(loop.sides, outputs, loop, f, y)


@inlined
def _observe_tables(tables: Tables | None, outputs: Outputs, state: State, f: Array, y: Array) -> None:
    if tables is not None:
        observe(tables, outputs, state, f, y)


@inlined
def _observe_sides(sides: Sides | None, outputs: SideOutputs, loop: Loop, f: Array, y: Array) -> None:
    if sides is not None:
        observe_sides(outputs, loop.bodies, sides, loop.state, f, y)
        observe_moments(loop.terms.rubbing, outputs, loop.bodies, sides, loop.state, y)
