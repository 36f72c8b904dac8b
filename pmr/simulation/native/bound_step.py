"""One step of `march` for callers in Python: nothing but s is handed over, so the call takes less than the step.

A call from Python looks at each argument, which takes longer than a step: 3.3 microseconds with 20 modes and arrays,
where a call with one handle (`pmr.simulation.native.handles`) takes 0.33 and the step itself 0.05.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from pmr.simulation.native import contact as contact_rows
from pmr.simulation.native.arrays import Contact, Divided, Outputs, Scheme, State, Tables
from pmr.simulation.native.compilation import compiled_for_python
from pmr.simulation.native.handles import Handle, handle
from pmr.simulation.native.part import Alone, step_alone
from pmr.simulation.native.scheme import GeneralizedAlpha

Array = NDArray[np.float64]

#: Returned instead of the number of a row where s lies off the path.
OFF_THE_PATH = -1


class Bound(NamedTuple):
    """What a step takes but s."""

    body: Alone
    f: Array  # (i,)
    y: Array  # (o,)


def _example(contact: Contact | None) -> Bound:
    """Of the types that all have whose rows hold both ways, or that all others have."""
    one, two, three, four = (np.zeros((1,) * n) for n in range(1, 5))
    tables, divided = Tables(one, four, four, 0), Divided(two, three)
    state = State(two, one, one, np.zeros(1, np.int64), two, two, two, one, one, contact=contact)
    scheme = Scheme(*[0.0] * len(Scheme._fields))
    return Bound(Alone(tables, divided, scheme, Outputs(two, three), state), one, one)


@compiled_for_python
def _advance(bound: Bound, s: float) -> int:
    breaks = bound.body.tables.breaks
    if not breaks[0] <= s <= breaks[len(breaks) - 1]:
        return OFF_THE_PATH
    return step_alone(bound.body, s, bound.f, bound.y)


@cache
def entry(in_contact: bool) -> Callable[[Handle, float], int]:
    """``advance(bound, s)``: a step to s under the loads in f, its outputs in y; compiled when first asked for.

    For handles of `Bound` whose rows all hold both ways, or of which some only push (`in_contact`).  Returns what
    `step_alone` does, or OFF_THE_PATH.  Nothing is looked at as a call of a compiled function would do it.
    """
    contact = contact_rows.contact(np.zeros(1), GeneralizedAlpha(1.0, 0.0).memory()) if in_contact else None
    signature = (handle(_example(contact)).kind, types.float64)
    _advance.compile(signature)
    return _advance.overloads[signature].entry_point
