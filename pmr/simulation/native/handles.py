"""Named tuples of arrays that compiled code reads from memory, by their address.

Numba hands a tuple over field by field, and an array as seven numbers and more: the some hundred arrays of a loop are
800 arguments of each function that gets it, and most of the time of compiling, and of a call from Python, goes into
them.  A handle is one argument.  Its fields are read where they are used, and a field that is a named tuple is a
handle again, into the same memory ::

    held = handle(State(...))
    function(held)  # compiled: held.multipliers[0] += 1.0

The memory is not written again, which is said to the compiler: what it has read it keeps, whatever is written to arrays
meanwhile.  So a loop over an array's entries takes as long as where the array itself is an argument.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import cache
from hashlib import blake2b
from typing import Any

import numpy as np
from llvmlite import ir
from numba import typeof, types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.imputils import lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    intrinsic,
    register_model,
    typeof_impl,
    unbox,
)
from numba.np.numpy_support import as_dtype
from numpy.typing import NDArray

Words = NDArray[np.int64]

_WORD = 8
_INTEGER = ir.IntType(64)


class HandleType(types.Type):
    """Numba's type of a handle of a named tuple's type."""

    def __init__(self, of: Any) -> None:
        self.of = of
        digest = blake2b(str(of).encode(), digest_size=12).hexdigest()  # the name stands in that of each function
        super().__init__(name=f"Handle({of.instance_class.__name__} {digest})")


class Handle(int):
    """The address, for Python; it keeps the memory and the arrays alive."""

    kind: HandleType
    kept: tuple[Any, Words]


def handle(values: Any) -> Handle:
    """That of a named tuple of arrays (C order), integers, floats, None and such tuples.

    Arrays are referred to, so what is written to them is seen; all else is copied.
    """
    words = words_of(values)
    held = Handle(words.ctypes.data)
    held.kind, held.kept = _kind_of(values), (values, words)
    return held


def entry_of(function: Any, *held: Handle) -> Callable[..., Any]:
    """What a call from Python of a compiled function with such handles leads to, without a look at their types.

    It is compiled when first asked for.
    """
    signature = tuple(one.kind for one in held)
    function.compile(signature)
    return function.overloads[signature].entry_point


def address_of(function: Any, *kinds: Any) -> int:
    """Where compiled code of a function for such types begins, which `call` and `number` take.

    It is compiled or loaded when first asked for.
    """
    found = _addresses.get((function, kinds))
    if found is None:
        function.compile(kinds)
        one = function.overloads[kinds]
        found = one.library.get_pointer_to_function(one.fndesc.llvm_func_name)
        _addresses[function, kinds] = found
    return found


def known(function: Any, *kinds: Any) -> bool:
    """Whether it has been asked for in this process."""
    return (function, kinds) in _addresses


_addresses = dict[Any, int]()


def kind_of(values: Any) -> HandleType:
    """Numba's type of a handle of such values."""
    return _kind_of(values)


def words_of(values: Any) -> Words:
    """What stands in memory: of an array its address, its size, its shape and its strides but the last one."""
    found = list[int]()
    _add_words(values, found)
    return np.array(found, np.int64)


def _add_words(value: Any, found: list[int]) -> None:
    if value is None:
        return
    if isinstance(value, tuple):
        for field in value:
            _add_words(field, found)
    elif isinstance(value, np.ndarray):
        if not value.flags.c_contiguous:
            raise TypeError("an array in C order is asked for")
        found.extend((value.ctypes.data, value.size, *value.shape, *value.strides[:-1]))
    elif isinstance(value, float):
        found.extend(struct.unpack("q", struct.pack("d", value)))
    else:
        found.append(int(value))


def _size(kind: Any) -> int:
    """Words of a Numba type."""
    if isinstance(kind, types.BaseTuple):
        return sum(map(_size, kind.types))
    if isinstance(kind, types.Array):
        return 1 + 2 * kind.ndim
    return 0 if isinstance(kind, types.NoneType) else 1


@cache
def _of(kind: Any) -> HandleType:
    return HandleType(kind)


_kinds = dict[Any, HandleType]()


def _kind_of(values: Any) -> HandleType:
    """Kept for tuples that are alike, as Numba takes far longer to find the type than all else takes."""
    like = _like(values)
    if like not in _kinds:
        _kinds[like] = _of(_type_of(values))
    return _kinds[like]


def _type_of(value: Any) -> Any:
    """As Numba says, which would look through all classes there are for each named tuple that it meets."""
    if isinstance(value, tuple):
        return types.BaseTuple.from_types([_type_of(field) for field in value], type(value))
    return typeof(value)


def _like(value: Any) -> Any:
    if isinstance(value, tuple):
        return (type(value), *map(_like, value))
    if isinstance(value, np.ndarray):
        return value.dtype.char, value.ndim, value.flags.writeable
    return type(value)


@typeof_impl.register(Handle)
def _typeof(value: Handle, context: Any) -> HandleType:
    return value.kind


@register_model(HandleType)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _INTEGER.as_pointer())


@unbox(HandleType)
def _unbox(kind: HandleType, value: Any, c: Any) -> NativeValue:
    address = c.pyapi.long_as_longlong(value)
    return NativeValue(c.builder.inttoptr(address, _INTEGER.as_pointer()), is_error=cgutils.false_bit)


@infer_getattr
class _Fields(AttributeTemplate):
    key = HandleType

    def generic_resolve(self, kind: HandleType, name: str) -> Any:
        if name not in kind.of.fields:
            return None
        field = kind.of.types[kind.of.fields.index(name)]
        return _of(field) if isinstance(field, types.BaseNamedTuple) else field


@lower_getattr_generic(HandleType)
def _read(context: Any, builder: Any, kind: HandleType, value: Any, name: str) -> Any:
    number = kind.of.fields.index(name)
    field = kind.of.types[number]
    if isinstance(field, types.NoneType):
        return context.get_dummy_value()
    at = builder.gep(value, [_INTEGER(sum(map(_size, kind.of.types[:number])))], source_etype=_INTEGER)
    if isinstance(field, types.BaseNamedTuple):
        return at
    if isinstance(field, types.Array):
        return _read_array(context, builder, field, at)
    return _read_word(builder, at, 0, context.get_value_type(field))


def _read_array(context: Any, builder: Any, kind: Any, at: Any) -> Any:
    """An array's parts as Numba has them."""
    n, pointer = kind.ndim, context.get_data_type(kind.dtype).as_pointer()
    item = _INTEGER(as_dtype(kind.dtype).itemsize)  # what LLVM says of it takes a module each time
    shape = [_read_word(builder, at, 2 + k, _INTEGER) for k in range(n)]
    strides = [*(_read_word(builder, at, 2 + n + k, _INTEGER) for k in range(n - 1)), item]
    parts = {
        "meminfo": None, "parent": None, "nitems": _read_word(builder, at, 1, _INTEGER), "itemsize": item,
        "data": _read_word(builder, at, 0, pointer),
        "shape": cgutils.pack_array(builder, shape), "strides": cgutils.pack_array(builder, strides),
    }  # fmt: skip
    model = context.data_model_manager[kind]
    array = ir.Constant(model.get_value_type(), ir.Undefined)
    for name, part in parts.items():
        position = model.get_field_position(name)
        part = ir.Constant(array.type.elements[position], None) if part is None else part
        array = builder.insert_value(array, part, position)
    return array


def _read_word(builder: Any, at: Any, number: int, kind: Any) -> Any:
    place = builder.gep(at, [_INTEGER(number)], source_etype=_INTEGER)
    read = builder.load(place, typ=kind, align=_WORD)
    read.set_metadata("invariant.load", builder.module.add_metadata([]))
    return read


def _calling(kind: Any) -> Any:
    """A function of compiled code that calls what stands at an address (`address_of`) and returns such a number."""

    @intrinsic
    def calling(typing: Any, address: Any, arguments: Any) -> Any:
        kinds = [types.unliteral(one) for one in arguments.types]

        def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
            convention = context.call_conv
            form = convention.get_function_type(kind, kinds)
            found = cgutils.alloca_once(builder, context.get_value_type(kind))
            packed = convention._get_arg_packer(kinds).as_arguments(builder, cgutils.unpack_tuple(builder, given[1]))
            function = builder.inttoptr(given[0], form.as_pointer())
            builder.call(function, [found, ir.Constant(form.args[1], None), *packed])  # none of these raises
            return builder.load(found)

        return kind(types.int64, types.Tuple(kinds)), generate

    return calling


#: ``call(address, (argument, ...))``, which returns an integer, and the same of a float.
call, number = _calling(types.int64), _calling(types.float64)


@intrinsic
def instead(typing: Any, held: Any, words: Any) -> Any:
    """A handle like another one, whose memory is an array (`words_of`)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        array = context.make_array(signature.args[1])(context, builder, arguments[1])
        return builder.bitcast(array.data, _INTEGER.as_pointer())

    return held(held, words), generate
