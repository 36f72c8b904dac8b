"""One step of `march` for callers in Python: nothing but s is handed over, so the call takes less than the step.

A call from Python looks at each array of each argument, which takes longer than a step: 3.3 microseconds with 20 modes,
where a call with what is stored takes 0.33 and the step itself 0.05.  For arguments that are always the same this is
done once: `store_at` puts what came of it, `words` of it, into plain memory, `stored` reads it there.  The memory
refers to the arrays and does not keep them alive.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import typeof, types
from numba.core.registry import cpu_target
from numba.extending import intrinsic
from numpy.typing import NDArray

from pmr.simulation.native import contact as contact_rows
from pmr.simulation.native.arrays import Contact, Divided, Outputs, Scheme, State, Tables
from pmr.simulation.native.compilation import compiled, compiled_for_python, inlined
from pmr.simulation.native.part import step_on_tables
from pmr.simulation.native.scheme import GeneralizedAlpha

Array = NDArray[np.float64]
Memory = NDArray[np.int64]
Arguments = tuple[Tables, Divided, Scheme, Outputs, State, Array, Array]

#: Returned instead of the number of a row where s lies off the path.
OFF_THE_PATH = -1


def words(kind: Any) -> int:
    """How many integers of 8 bytes it takes to store a value of a Numba type."""
    context = cpu_target.target_context
    return -(-int(context.get_abi_sizeof(context.get_value_type(kind))) // 8)


@intrinsic
def store_at(typing: Any, address: Any, value: Any) -> Any:
    """Store a value from an address on, where there is room for `words` integers."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = builder.inttoptr(arguments[0], arguments[1].type.as_pointer())
        builder.store(arguments[1], place, align=8)
        return context.get_dummy_value()

    return types.none(types.int64, value), generate


def stored(kind: Any) -> Any:
    """For compiled code: a function of an address that gives the value of a Numba type that `store_at` put there."""

    @intrinsic
    def read(typing: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            place = builder.inttoptr(arguments[0], context.get_value_type(kind).as_pointer())
            return builder.load(place, align=8)

        return kind(types.int64), generate

    return read


def _example(contact: Contact | None) -> Arguments:
    """Arguments of the types that all have whose rows hold both ways, or that all others have."""
    one, two, three, four = (np.zeros((1,) * n) for n in range(1, 5))
    tables, divided = Tables(one, four, four, 0), Divided(two, three)
    state = State(two, one, one, np.zeros(1, np.int64), two, two, two, one, one, contact=contact)
    return tables, divided, Scheme(*[0.0] * len(Scheme._fields)), Outputs(two, three), state, one, one


_CONTACT = contact_rows.contact(np.zeros(1), GeneralizedAlpha(1.0, 0.0).memory())
_TYPE, _TYPE_IN_CONTACT = (typeof(_example(contact)) for contact in (None, _CONTACT))
_stored, _stored_in_contact = (stored(kind) for kind in (_TYPE, _TYPE_IN_CONTACT))


def store(
    tables: Tables, divided: Divided, scheme: Scheme, outputs: Outputs, state: State, f: Array, y: Array
) -> Memory:
    """Memory for `advance`; the arrays have to outlive it."""
    memory = np.zeros(words(_TYPE if state.contact is None else _TYPE_IN_CONTACT), np.int64)
    _store(memory.ctypes.data, (tables, divided, scheme, outputs, state, f, y))
    return memory


@compiled
def _store(address: int, arguments: Arguments) -> None:
    store_at(address, arguments)


@compiled_for_python
def _advance(address: int, s: float) -> int:
    return _advanced(_stored(address), s)


@compiled_for_python
def _advance_in_contact(address: int, s: float) -> int:
    return _advanced(_stored_in_contact(address), s)


@inlined
def _advanced(arguments: Arguments, s: float) -> int:
    tables, divided, scheme, outputs, state, f, y = arguments
    breaks = tables.breaks
    if not breaks[0] <= s <= breaks[len(breaks) - 1]:
        return OFF_THE_PATH
    return step_on_tables(tables, divided, scheme, outputs, state, s, f, y)


@cache
def entry(in_contact: bool) -> Callable[[int, float], int]:
    """``advance(address, s)``: a step to s under the loads in f, its outputs in y; compiled when first asked for.

    For arguments whose rows all hold both ways, or of which some only push (`in_contact`).  Returns what
    `step_on_tables` does, or OFF_THE_PATH.  Nothing is looked at as a call of a compiled
    function would do it: the address has to be that of the memory that `store` gave.
    """
    signature = (types.int64, types.float64)
    advance = _advance_in_contact if in_contact else _advance
    advance.compile(signature)
    return advance.overloads[signature].entry_point
