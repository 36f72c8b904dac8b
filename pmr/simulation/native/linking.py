"""What a loop calls by addresses: functions that are compiled apart, once for all loops, when a simulation needs them.

Numba would compile all that a loop calls into that loop, and once more into each other one: a scene without friction
would wait for friction, and the same step in a run and in a stepper would be compiled twice.  To call by an address
takes a nanosecond or two.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from pmr.simulation.native import contact, friction, levels, parts, sides, terms
from pmr.simulation.native.arrays import Drive
from pmr.simulation.native.compilation import claimed
from pmr.simulation.native.handles import address_of, kind_of, known
from pmr.simulation.native.part import Loop

Addresses = NDArray[np.int64]

_ROW, _ROWS = (types.Array(types.float64, ndim, "C") for ndim in (1, 2))
_INTEGER = types.int64
_NOTHING = np.zeros((0, 0))
_DRIVE = Drive(s=_NOTHING, f=_NOTHING, given=np.zeros(0, np.int64), c=_NOTHING, per=1, peaks=_NOTHING)


class Call(NamedTuple):
    """A function for such types, and where its address belongs."""

    calls: Addresses
    number: int
    function: Any
    kinds: tuple[Any, ...]


def link(loop: Loop) -> None:
    """Write the addresses of all that a loop with `Levels` needs; what has not been compiled is.

    What another process compiles at present comes last (`pmr.simulation.native.ahead`).
    """
    left = list(_calls(loop))
    while left:
        free = (k for k, one in enumerate(left) if known(one.function, *one.kinds) or not claimed(one.function))
        one = left.pop(next(free, 0))
        one.calls[one.number] = address_of(one.function, *one.kinds)


def _calls(loop: Loop) -> Iterator[Call]:
    """What takes longest to compile first."""
    of, pushing, calls = _kinds(loop), loop.state.contact, loop.levels.calls
    assert pushing is not None
    yield Call(calls, levels.STEP, parts.take_step, (of["loop"], kind_of(_DRIVE), _INTEGER, _INTEGER))
    if loop.sides is not None:
        of_sides = (of[name] for name in ("bodies", "divided", "scheme", "state", "sides"))
        yield Call(loop.sides.calls, 0, sides.move_sides, (*of_sides, _ROW))
    if len(pushing.pushes):
        yield Call(pushing.calls, 0, contact.settle, (of["contact"], _ROWS, _ROWS, _ROW))
    if len(loop.levels.parts) > 1:
        yield Call(calls, levels.BEGIN, parts.begin, (of["loop"], _INTEGER, _ROW, _ROW, _ROW))
        of_part = (of[name] for name in ("modes", "terms", "contact", "state", "control", "scheme"))
        yield Call(calls, levels.MISSED, levels.missed, (*of_part, _ROW))
    if len(loop.terms.force):
        yield from _calls_of_terms(loop, of)


def _calls_of_terms(loop: Loop, of: dict[str, Any]) -> Iterator[Call]:
    calls, own, divided, state = loop.terms.calls, of["terms"], of["divided"], of["state"]
    yield Call(calls, terms.BEGIN, terms.begin, (own, state, _ROW))
    yield Call(calls, terms.EXPECT, terms.expected, (own, divided, state, _ROW, _ROW))
    yield Call(calls, terms.REVISE, terms.revised, (own, divided, of["scheme"], state))
    yield Call(calls, terms.ACCOUNT, terms.accounted, (own, state))
    if loop.sides is not None and len(loop.terms.rubbing.pads):
        yield Call(calls, terms.TURN, friction.turn, (of["rubbing"], of["bodies"], of["sides"]))


def _kinds(loop: Loop) -> dict[str, Any]:
    """Types of the handles of a loop and its parts."""
    held = {**loop._asdict(), "loop": loop, "contact": loop.state.contact, "rubbing": loop.terms.rubbing}
    return {name: kind_of(one) for name, one in held.items() if isinstance(one, tuple)}
