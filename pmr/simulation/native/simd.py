"""Four numbers of double precision as one, for compiled loops: an AVX register, or two of half the size.

Loops over arrays are left to the compiler as a rule.  Where they are short, a dozen or two entries, it does badly: it
unrolls for long ones, and works off the rest one by one.  Over plain Numba a step takes 1/2.2 of the time with 20
modes and one output, 1/4.2 with 51 outputs; with 6 modes 1/1.2 and 1/2.4 (``python -m benchmarks --only latency``, with
`LANES` = 1 and scalars in place of these functions).  ::

    for n in range(0, len(a), 4):
        store(c, n, load(a, n) * x + load(b, n))
"""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, models, register_model
from numpy.typing import NDArray

Array = NDArray[np.float64]

LANES = 4
#: Bytes; a register that crosses the border of two takes two accesses.
CACHE_LINE = 64
_VECTOR = ir.VectorType(ir.DoubleType(), LANES)


class Lanes(types.Type):
    """Numba's type of four numbers."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


lanes = Lanes()


@register_model(Lanes)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _VECTOR)


@intrinsic
def load(typing: Any, array: Any, n: Any) -> Any:
    """Entries n to n + 3 of a contiguous array; nothing is checked."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return builder.load(_pointer(context, builder, signature, arguments), align=8)

    return lanes(array, n), generate


@intrinsic
def entry(typing: Any, array: Any, n: Any) -> Any:
    """Entry n of a contiguous array; nothing is checked, nor is counted from the end, for which Numba has to look."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        return builder.load(builder.gep(array.data, [arguments[1]]))

    return array.dtype(array, n), generate


@intrinsic
def store(typing: Any, array: Any, n: Any, value: Any) -> Any:
    """Write four numbers to entries n to n + 3 of a contiguous array; nothing is checked."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        builder.store(arguments[2], _pointer(context, builder, signature, arguments), align=8)
        return context.get_dummy_value()

    return types.none(array, n, lanes), generate


@intrinsic
def spread(typing: Any, x: Any) -> Any:
    """Four times the same number."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return _spread(builder, arguments[0])

    return lanes(types.float64), generate


@intrinsic
def total(typing: Any, x: Any) -> Any:
    """Sum of the four."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        halves = [_shuffle(builder, arguments[0], part) for part in ([0, 1], [2, 3])]
        pair = builder.fadd(*halves)
        return builder.fadd(*(builder.extract_element(pair, ir.IntType(32)(k)) for k in range(2)))

    return types.float64(lanes), generate


@intrinsic
def totals(typing: Any, a: Any, b: Any, c: Any, d: Any) -> Any:
    """The sums of four registers as one, in half the time of four `total`."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        a, b, c, d = arguments
        pairs = [_added(builder, both, ([0, 4, 2, 6], [1, 5, 3, 7])) for both in ((a, b), (c, d))]
        return _added(builder, pairs, ([0, 1, 4, 5], [2, 3, 6, 7]))

    return lanes(a, b, c, d), generate


_CASES = [signature(lanes, lanes, lanes), signature(lanes, lanes, types.float64)]


def _arithmetic(function: Any, instruction: str) -> None:
    """Teach the compiler `function` for four numbers and four others, or four times the same one."""

    @infer_global(function)
    class _Operator(ConcreteTemplate):
        cases = _CASES

    @lower_builtin(function, lanes, lanes)
    def with_lanes(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return getattr(builder, instruction)(*arguments)

    @lower_builtin(function, lanes, types.float64)
    def with_number(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return getattr(builder, instruction)(arguments[0], _spread(builder, arguments[1]))


_arithmetic(operator.add, "fadd")
_arithmetic(operator.sub, "fsub")
_arithmetic(operator.mul, "fmul")


def _pointer(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    array = context.make_array(signature.args[0])(context, builder, arguments[0])
    return builder.bitcast(builder.gep(array.data, [arguments[1]]), _VECTOR.as_pointer())


def _spread(builder: Any, x: Any) -> Any:
    first = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), x, ir.IntType(32)(0))
    return _shuffle(builder, first, [0] * LANES)


def _shuffle(builder: Any, x: Any, chosen: list[int]) -> Any:
    mask = ir.Constant(ir.VectorType(ir.IntType(32), len(chosen)), chosen)
    return builder.shuffle_vector(x, ir.Constant(x.type, ir.Undefined), mask)


def _added(builder: Any, two: Sequence[Any], chosen: Sequence[list[int]]) -> Any:
    """Sum of two choices among the numbers of two registers."""
    masks = [ir.Constant(ir.VectorType(ir.IntType(32), LANES), numbers) for numbers in chosen]
    return builder.fadd(*(builder.shuffle_vector(*two, mask) for mask in masks))


def padded(array: Array, multiple: int = LANES) -> Array:
    """With zeros at the end of the last axis, up to a whole number of vector registers or cache lines."""
    wide = np.zeros((*array.shape[:-1], array.shape[-1] + -array.shape[-1] % multiple))
    wide[..., : array.shape[-1]] = array
    return aligned(wide)


def aligned(array: Array) -> Array:
    """Contiguous and writable, for others would be other types to the compiled loop, and from a cache line's start."""
    memory = np.empty(array.size + CACHE_LINE // 8)
    first = -memory.ctypes.data % CACHE_LINE // 8
    copy = memory[first : first + array.size].reshape(array.shape)
    copy[...] = array
    return copy
