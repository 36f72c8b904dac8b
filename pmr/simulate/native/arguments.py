"""Arguments stored in the form in which compiled code has them.

A call from Python looks at each array of each argument, which takes longer than a step: 3.3 microseconds with 20 modes,
where a call with what is stored takes 0.33 and the step itself 0.05.  For arguments that are always the same this is
done once: `store` puts what came of it into plain memory, `stored` reads it there.  ::

    memory = np.zeros(words(typeof(arguments)), np.int64)
    address = memory.ctypes.data

The memory refers to the arrays and does not keep them alive.
"""

from __future__ import annotations

from typing import Any

from numba import types
from numba.core.registry import cpu_target
from numba.extending import intrinsic


def words(kind: Any) -> int:
    """How many integers of 8 bytes it takes to store a value of a Numba type."""
    context = cpu_target.target_context
    return -(-int(context.get_abi_sizeof(context.get_value_type(kind))) // 8)


@intrinsic
def store(typing: Any, address: Any, value: Any) -> Any:
    """Store a value from an address on, where there is room for `words` integers."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = builder.inttoptr(arguments[0], arguments[1].type.as_pointer())
        builder.store(arguments[1], place, align=8)
        return context.get_dummy_value()

    return types.none(types.int64, value), generate


def stored(kind: Any) -> Any:
    """For compiled code: a function of an address that gives the value of a Numba type that `store` put there."""

    @intrinsic
    def read(typing: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            place = builder.inttoptr(arguments[0], context.get_value_type(kind).as_pointer())
            return builder.load(place, align=8)

        return kind(types.int64), generate

    return read
