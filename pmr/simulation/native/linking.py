"""What a loop calls by addresses: functions that are compiled apart, once for all loops, when a simulation needs them.

Numba would compile all that a loop calls into that loop, and once more into each other one: a scene without friction
would wait for friction, and the same step in a run and in a stepper would be compiled twice.  To call by an address
takes a nanosecond or two.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types

from pmr.simulation.native import contact, friction, levels, parts, sides, terms
from pmr.simulation.native.arrays import Drive
from pmr.simulation.native.handles import address_of, kind_of
from pmr.simulation.native.part import Loop

_ROW, _ROWS = (types.Array(types.float64, ndim, "C") for ndim in (1, 2))
_INTEGER = types.int64
_NOTHING = np.zeros((0, 0))
_DRIVE = Drive(s=_NOTHING, f=_NOTHING, given=np.zeros(0, np.int64), c=_NOTHING, per=1, peaks=_NOTHING)


def link(loop: Loop) -> None:
    """Write the addresses of all that a loop with `Levels` needs; what has not been compiled is."""
    of, pushing = _kinds(loop), loop.state.contact
    assert pushing is not None
    if len(pushing.pushes):
        pushing.calls[0] = address_of(contact.settle, of["contact"], _ROWS, _ROWS, _ROW)
    if loop.sides is not None:
        of_sides = (of[name] for name in ("bodies", "divided", "scheme", "state", "sides"))
        loop.sides.calls[0] = address_of(sides.move_sides, *of_sides, _ROW)
    if len(loop.terms.force):
        _link_terms(loop, of)
    calls = loop.levels.calls
    calls[levels.STEP] = address_of(parts.take_step, of["loop"], kind_of(_DRIVE), _INTEGER, _INTEGER)
    if len(loop.levels.parts) > 1:
        calls[levels.BEGIN] = address_of(parts.begin, of["loop"], _INTEGER, _ROW, _ROW, _ROW)
        of_part = (of[name] for name in ("modes", "terms", "contact", "state", "control", "scheme"))
        calls[levels.MISSED] = address_of(levels.missed, *of_part, _ROW)


def _link_terms(loop: Loop, of: dict[str, Any]) -> None:
    calls, own, divided, state = loop.terms.calls, of["terms"], of["divided"], of["state"]
    calls[terms.BEGIN] = address_of(terms.begin, own, state, _ROW)
    calls[terms.EXPECT] = address_of(terms.expected, own, divided, state, _ROW, _ROW)
    calls[terms.REVISE] = address_of(terms.revised, own, divided, of["scheme"], state)
    calls[terms.ACCOUNT] = address_of(terms.accounted, own, state)
    if loop.sides is not None and len(loop.terms.rubbing.pads):
        calls[terms.TURN] = address_of(friction.turn, of["rubbing"], of["bodies"], of["sides"])


def _kinds(loop: Loop) -> dict[str, Any]:
    """Types of the handles of a loop and its parts."""
    held = {**loop._asdict(), "loop": loop, "contact": loop.state.contact, "rubbing": loop.terms.rubbing}
    return {name: kind_of(one) for name, one in held.items() if isinstance(one, tuple)}
