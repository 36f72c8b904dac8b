"""A machine that carries the frame of a boom and moves by itself (src/machine.c)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError, SimulationError
from pmr.kernel._native import ffi, lib
from pmr.kernel.kernel import State

Array = NDArray[np.float64]
Integers = NDArray[np.int32]


#: Why a step of a machine fails, where its boom's does not.
REASONS = {
    lib.PMR_LOST: "the machine's motion is not found",
    lib.PMR_UPRIGHT: "the machine pitches by 90 degrees, where roll and yaw turn about one axis,",
}


@dataclass(frozen=True)
class Machine:
    """A machine and the boom that it carries, and what drives both over T steps, as `pmr_machine` has them."""

    axes: Integers
    free: Integers
    mass: float
    center: Array
    inertia: Array
    stiffness: Array
    damping: Array
    boom_mass: float
    largest_weight: float
    place: Array
    section_inertia: Array
    section_paths: Integers
    fields: Integers
    inertial: Integers
    masses: Array
    first: Array
    loads: Array
    rotating: Array
    carried: Array
    of_shortened: Integers
    shortened: Array
    motions: Array
    rates: Array
    given: Array
    pushed: Array
    weight: Array


class Carried:
    """A machine and its boom at one moment; `state` is the boom's.

    An InputError is raised for a boom that it can't carry: on a frame without a base that moves, with contacts that
    only push, in steps of several parts.
    """

    def __init__(self, state: State, machine: Machine) -> None:
        self.state, arrays, scalars = state, dict[str, Any](), dict[str, Any]()
        types = dict(ffi.typeof("pmr_machine").fields)
        for field in fields(machine):
            value, kind = getattr(machine, field.name), types[field.name].type
            if kind.kind == "pointer":
                array = np.ascontiguousarray(value, np.int32 if kind.item.cname == "int32_t" else np.float64)
                arrays[field.name] = array
                scalars[field.name] = ffi.cast(kind, array.ctypes.data)
            else:
                scalars[field.name] = value if kind.kind == "primitive" else np.ravel(value).tolist()
        counts = {"sections": len(machine.masses), "shortened_count": len(machine.of_shortened)}
        self._arrays = arrays  # they stay as long as what points to them
        self._machine = ffi.new("pmr_machine *", scalars | counts | {"inertial_count": len(machine.inertial)})
        out = ffi.new("pmr_carried **")
        if lib.pmr_carried_open(state.pointer, self._machine, out):
            allowed = "a frame with a base that moves, contacts that hold both ways and whole steps are allowed"
            raise InputError("machine", "boom", None, allowed)
        self._carried, view = ffi.gc(out[0], lib.pmr_carried_close), ffi.new("pmr_carried_view *")
        lib.pmr_carried_look(self._carried, view)
        sizes = {"b": 18, "held": 6, "springs": 6, "momenta": 6, "inertia": len(machine.inertial)}
        views = {name: _view(getattr(view, name), size) for name, size in sizes.items()}
        self.motion: Array = views["b"].reshape(3, 6)  # of its directions, with rates and second rates
        self.held: Array = views["held"]  # (6,) N, N m: what holds directions that are not free
        self.springs: Array = views["springs"]  # (6,): of springs and dampers
        self.momenta: Array = views["momenta"]  # (6,): linear, angular, about the ground's origin
        self.inertia: Array = views["inertia"]  # inputs by which the frame accelerates the boom

    def needed(self, motion: Array, z: Array, v: Array, a: Array) -> Array:
        """What has to hold the machine (6,) at t = 0 for it to move as (3, 6) and the boom's modes as z, v, a."""
        forces, arrays = np.zeros(6), [np.ascontiguousarray(array, float) for array in (motion, z, v, a)]
        lib.pmr_carried_needed(self._carried, *map(_pointer, arrays), _pointer(forces))
        return forces

    def start(self, motion: Array, z: Array, v: Array) -> None:
        """Begin at t = 0 with motion (3, 6), whose second rates of free directions are found; errors as for `step`."""
        arrays = [np.array(array, float) for array in (motion, z, v)]
        self._raise_unless_done(lib.pmr_carried_start(self._carried, *map(_pointer, arrays)), "the start")

    def step(self, k: int) -> None:
        """Take step k.

        A StepError is raised where the boom's step fails, a SimulationError where the machine's motion is not found or
        not finite, or it stands upright.
        """
        if failed := lib.pmr_carried_step(self._carried, k):
            self._raise_unless_done(failed, f"step {k}")

    def _raise_unless_done(self, failed: int, where: str) -> None:
        if failed in REASONS:
            raise SimulationError(f"{REASONS[failed]} at {where}")
        self.state.raise_unless_done(failed, where)


def _view(pointer: Any, count: int) -> Array:
    """Numbers of the kernel as an array that is read only and follows them."""
    if not count:
        return np.zeros(0)
    array = np.frombuffer(ffi.buffer(pointer, 8 * count), np.float64)
    array.flags.writeable = False
    return array


def _pointer(array: Array) -> Any:
    return ffi.cast("double *", array.ctypes.data)
