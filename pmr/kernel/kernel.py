"""Systems, signals and banks of filters of the compiled kernel (src/pmr_kernel.h describes its functions)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, NamedTuple, Protocol
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmr.errors import InputError
from pmr.files.arrays import Array
from pmr.kernel._native import ffi, lib
from pmr.kernel.blocks import LINE, pack, seal
from pmr.kernel.data import Modal, system_data
from pmr.kernel.further import Frame
from pmr.system.from_scene import CombinedRings
from pmr.system.system import System


def code_variant() -> str:
    """Name of the kernel's machine code that this processor runs: avx2, sse2, vectors or plain."""
    return str(ffi.string(lib.pmr_variant()).decode())


def checksum(content: bytes | bytearray) -> int:
    """Checksum that a block stores of its `content`, the bytes after its first `LINE` bytes."""
    return int(lib.pmr_checksum(ffi.from_buffer(content), len(content)))


class StateSizes:
    """Sizes of the state and the results of a system, as in `pmr_sizes` (src/pmr_kernel.h)."""

    modes: int  # with padding
    contacts: int
    forces: int
    outputs: int
    pads: int
    pushing: int
    further: int


class DriverSizes:
    """Sizes of the drivers of a system and of its parts, as in `pmr_sizes` (src/pmr_kernel.h)."""

    inputs: int
    paths: int
    terms: int
    drivers: int
    motions: int
    hoist: int
    computed: int
    ground: int


class Kernel(StateSizes, DriverSizes):
    """A system in memory.  It does not change, so any number of states in any number of threads may use it."""

    def __init__(self, block: bytes | bytearray) -> None:
        """Copy and open a block; an InputError is raised if the bytes are no block of this kernel, or damaged."""
        room = np.empty(len(block) + LINE, np.uint8)
        first = -room.ctypes.data % LINE  # an address that is a multiple of `LINE`
        self._block = room[first : first + len(block)]
        self._block[:] = np.frombuffer(block, np.uint8)
        self._block.flags.writeable = False
        out, why = ffi.new("pmr_system **"), ffi.new(f"char[{lib.PMR_MESSAGE}]")
        if lib.pmr_system_open(ffi.from_buffer(self._block), len(self._block), out, why):
            raise InputError("system", "block", None, ffi.string(why).decode(errors="replace"))
        self._system = ffi.gc(out[0], lib.pmr_system_close)
        sizes = ffi.new("pmr_sizes *")
        lib.pmr_system_sizes(self._system, sizes)
        for name in _field_types("pmr_sizes"):
            setattr(self, name, getattr(sizes, name))

    @classmethod
    def of(
        cls,
        system: System,
        forms: Mapping[str, Modal],
        frame: Frame | None = None,
        reduced: CombinedRings | None = None,
    ) -> Kernel:
        """Kernel of a system whose bodies have these modal forms, by name (`pmr.simulation.modal.modal_form`).

        If there is a moving `frame` (`pmr.simulation.moving.MovingFrame`), the motions of the frame drive the system.
        Without a frame, paths, loads and amplitudes of terms do.  A caller that already has the system in modes with
        combined rings passes it as `reduced`; the kernel then computes no reactions of supports.  Errors as
        `pmr.kernel.data.system_data`.
        """
        data = system_data(system, forms, frame, reduced)
        block = pack(data.arrays)
        seal(block, checksum(block[LINE:]))
        return cls(block)

    @property
    def block(self) -> bytes:
        """Bytes of the block that the system was opened from."""
        return self._block.tobytes()

    def frame_drivers(self, motions: ArrayLike) -> Array:
        """Drivers u (N,) for motions (3, n) of the frame: values, rates and second rates.

        An InputError is raised for another shape, and for a system without a frame.
        """
        at = np.ascontiguousarray(motions, float)
        if not self.motions or at.shape != (3, self.motions):
            raise InputError("kernel", "motions", at.shape, f"{(3, self.motions)} of a system with a frame is allowed")
        u, work = np.zeros(self.drivers), np.zeros(lib.pmr_frame_work(self._system))
        lib.pmr_frame(self._system, *map(pointer, (at, u, work)))
        return u

    def names(self, kind: Literal["drivers", "motions", "outputs", "further", "contacts", "forces"]) -> tuple[str, ...]:
        """Names of all quantities of a `kind`, such as drivers, in the order of their numbers."""
        count = ffi.new("size_t *")
        text = lib.pmr_system_names(self._system, kind.encode(), count)
        lines = ffi.buffer(text, count[0])[:].split(b"\n") if count[0] else []
        return tuple(line.decode("unicode_escape") for line in lines)


def pointer(array: NDArray[Any] | None) -> Any:
    """Pointer to a contiguous array (any shape) of int32 or float64 for the kernel; NULL for None.

    Neither type nor order is checked, and the caller has to keep the array alive.
    """
    if array is None:
        return ffi.NULL
    return ffi.cast("int32_t *" if array.dtype == np.int32 else "double *", ffi.from_buffer(array))


#: Arrays to which a structure's fields point, by the structure.
_ARRAYS = WeakKeyDictionary[Any, list[NDArray[Any]]]()


@cache
def _field_types(kind: str) -> dict[str, Any]:
    """Types of the fields of the kernel's C structure `kind`, by the fields' names."""
    return {name: field.type for name, field in ffi.typeof(kind).fields}


def structure(kind: str, fields: Mapping[str, Any]) -> Any:
    """Return a pointer to a new C structure `kind` of the kernel, such as ``pmr_machine``, with the values of `fields`.

    A field that is a pointer takes an array, which is kept as long as the structure; an array that is not contiguous or
    not of the field's type is copied.
    """
    types, values, arrays = _field_types(kind), dict[str, Any](), list[NDArray[Any]]()
    for name, value in fields.items():
        of_field, values[name] = types[name], value
        if of_field.kind == "pointer":
            arrays.append(np.ascontiguousarray(value, np.int32 if of_field.item.cname == "int32_t" else np.float64))
            values[name] = pointer(arrays[-1])
        elif of_field.kind == "array":
            values[name] = np.ravel(value).tolist()
    address = ffi.new(f"{kind} *", values)
    _ARRAYS[address] = arrays
    return address


class Signal(Protocol):
    """Signal of a scene (`pmr.scene.signals`)."""

    @property
    def strands(self) -> tuple[Any, ...]:
        """Polynomials and sines whose sum is the signal, in pieces; raises NotImplementedError for any other signal."""


class Signals:
    """N signals, one for each driver and in the order of the drivers, as the kernel's `pmr_signals`.

    Raises NotImplementedError if a signal is not a sum of polynomials and sines; the drivers have to be sampled then
    (`State.advance_sampled`).
    """

    def __init__(self, signals: Sequence[Signal]) -> None:
        """Make the kernel's structures of the N `signals`, one for each driver."""
        strands = [signal.strands for signal in signals]
        every = [strand for of_signal in strands for strand in of_signal]
        powers = max([1, *(strand.polynomials.shape[1] for strand in every)])
        self._count, first_piece = len(signals), np.cumsum([0, *(len(strand.breaks) for strand in every)])
        pieces = np.zeros((first_piece[-1], powers + 4))  # coefficients, amplitude, angles
        for first, strand in zip(first_piece, every, strict=False):
            of_strand = pieces[first : first + len(strand.breaks)]
            of_strand[:, powers - strand.polynomials.shape[1] : powers] = strand.polynomials
            of_strand[:, powers], of_strand[:, powers + 1 :] = strand.amplitude, strand.angles
        fields = {
            "drivers": len(signals),
            "powers": powers,
            "first_strand": np.cumsum([0, *map(len, strands)]),
            "first_piece": first_piece,
            "spread": [strand.spread for strand in every],
            "breaks": np.concatenate([np.zeros(0), *(strand.breaks for strand in every)]),
            "pieces": pieces,
        }
        self.pointer = structure("pmr_signals", fields)

    def at(self, t: float) -> Array:
        """Values of the N signals at the time t in s, with their first and second rates: (3, N)."""
        u = np.zeros((3, self._count))
        lib.pmr_signals_at(self.pointer, t, *map(pointer, (u, u[1:])))
        return u


class BankRecord(NamedTuple):
    """Results of a bank of filters at T steps.

    The results are the probabilities of S places, the mean of the n states over all places and speeds, and the level of
    the innovations: a running mean of their squares over their variance.
    """

    probability: Array  # (T, S)
    states: Array  # (T, n)
    level: Array  # (T,)


@dataclass(frozen=True)
class Bank:
    """Kalman filters with n states: one for each place where a slider may be, and each speed at which it may move.

    There are S places along the slider's path, and D speeds.  `up` and `down` are the probabilities that a step at each
    speed leads to the next place, or to the place before.  `rest` and `active` are transition matrices between the
    speeds: while nothing moves, and in full motion.
    """

    F: Array  # (S, n, n)
    H: Array  # (S, n)
    gain: Array  # (S, n)
    variance: Array  # (S,): of innovations, over the level
    up: Array  # (D,)
    down: Array  # (D,)
    rest: Array  # (D, D)
    active: Array  # (D, D)
    #: numbers by which likelihoods and the level of innovations follow: temper, attack, decay and floor
    following: Mapping[str, float]


def advance_bank(bank: Bank, y: Array, activity: Array, least_level: Array, of_speeds: Array, delay: int) -> BankRecord:
    """Filter measurements y (T,) at T steps by a bank that begins with equally likely places.

    NaN in y stands for no measurement.  `activity` (T,), 0 to 1, says how much is in motion: the transition matrix
    between speeds is the mean of `active` and `rest`, with this weight of `active`.  The level of the innovations, a
    running mean of their squares divided by their variance, scales all variances; it never falls below `least_level`
    (T,) and the floor of `bank`.  `of_speeds` (T, D) are logarithms of the likelihoods of the speeds.  The
    probabilities of places at a step also use the measurements of up to `delay` steps after it.
    """
    S, n = bank.H.shape
    fields = {name: value for name, value in vars(bank).items() if name != "following"} | dict(bank.following)
    data = structure("pmr_bank", fields | {"places": S, "speeds": len(bank.up), "states": n})
    memory = np.zeros(lib.pmr_bank_memory(data))
    lib.pmr_bank_start(data, pointer(memory))
    record = BankRecord(np.zeros((len(y), len(bank.up) * S)), np.zeros((len(y), n)), np.zeros(len(y)))
    out = structure("pmr_bank_record", record._asdict())
    signals = [np.ascontiguousarray(x, float) for x in (y, activity, least_level, of_speeds)]
    lib.pmr_bank_advance(data, pointer(memory), len(y), *map(pointer, signals), out)
    places, of_models = np.zeros((len(y), S)), pointer(record.probability)
    lib.pmr_bank_places(data, pointer(memory), len(y), pointer(signals[1]), delay, of_models, pointer(places))
    return record._replace(probability=places)
