"""Arguments kept in the form in which compiled code has them.

A call from Python looks at each array of each argument, which takes longer than a step.  For arguments that are always
the same this is done once: `keep` stores what came of it in plain memory, `kept` reads it there.  ::

    memory = np.zeros(words(typeof(arguments)), np.int64)

The memory refers to the arrays and does not keep them alive.
"""

from __future__ import annotations

from typing import Any

from numba import types
from numba.core.registry import cpu_target
from numba.extending import intrinsic


def words(kind: Any) -> int:
    """How many integers of 8 bytes it takes to keep a value of a Numba type."""
    context = cpu_target.target_context
    return -(-int(context.get_abi_sizeof(context.get_value_type(kind))) // 8)


@intrinsic
def keep(typing: Any, memory: Any, value: Any) -> Any:
    """Store a value in memory, an array of `words` integers."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.store(arguments[1], _place(context, builder, signature, arguments), align=8)
        return context.get_dummy_value()

    return types.none(memory, value), generate


def kept(kind: Any) -> Any:
    """For compiled code: a function of the memory that gives the value of a Numba type that `keep` stored there."""

    @intrinsic
    def read(typing: Any, memory: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            place = _place(context, builder, signature, arguments, context.get_value_type(kind))
            return builder.load(place, align=8)

        return kind(memory), generate

    return read


def _place(context: Any, builder: Any, signature: Any, arguments: Any, value_type: Any = None) -> Any:
    array = context.make_array(signature.args[0])(context, builder, arguments[0])
    return builder.bitcast(array.data, (value_type or arguments[1].type).as_pointer())
