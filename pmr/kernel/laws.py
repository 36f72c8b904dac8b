"""Laws of the compiled kernel by themselves, for statics, charts and other simulators (src/pmr_kernel.h)."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.errors import SimulationError
from pmr.kernel._native import ffi, lib

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class ContactError(SimulationError):
    """A complementarity problem without a solution; `row` is the contact that depends on those before it, or None."""

    row: int | None = None


def solve_contact(A: Array, b: Array, pushes: Mask, closed: Mask) -> tuple[Array, Mask]:
    """Solve A lambda = b + w with lambda >= 0, w >= 0, lambda w = 0 at contacts that only push and w = 0 at others.

    Parameters
    ----------
    A : (m, m) array, m/N
        Symmetric and positive definite.
    b : (m,) array, m
        How far contacts come out beyond their clearances without forces.
    pushes, closed : (m,) arrays
        Contacts that only push, and which of them the search begins with as closed ones.

    Returns
    -------
    forces : (m,) array, N
    closed : (m,) array

    Raises
    ------
    ContactError
        If closed contacts depend on each other, or the search does not end.
    """
    m = len(b)
    A, b = np.ascontiguousarray(A, float), np.ascontiguousarray(b, float)
    forces, work = np.zeros(m), np.zeros(lib.pmr_contact_work(m))
    only_push, state = np.ascontiguousarray(pushes, np.int32), np.array(closed, np.int32)
    trouble = ffi.new("int *")
    failed = lib.pmr_contact(
        m, *map(_doubles, (A, b)), _integers(only_push), _doubles(forces), _integers(state), _doubles(work), trouble
    )
    if failed == lib.PMR_DEPENDENT:
        error = ContactError(f"contact {trouble[0]} depends on those before it")
        error.row = int(trouble[0])
        raise error
    if failed:
        raise ContactError("which contacts are closed was not settled in 1000 solves")
    return forces, state.astype(bool)


class ContactSearch:
    """Search for the closed contacts where the caller solves for their forces; `solve_contact` makes the same one."""

    def __init__(self) -> None:
        self._state = ffi.new("pmr_search *")

    def change(self, closed: Mask, wrong: Mask) -> Mask:
        """Closed contacts (m,) of the next solve, where some are on the wrong side: they pull, or overlap."""
        changes = np.array(wrong, np.int32)
        lib.pmr_choose_changes(len(changes), _integers(changes), self._state)
        return np.asarray(closed ^ changes.astype(bool))


class SchemeFactors(NamedTuple):
    """Factors of generalized-alpha with steps of `h` s.

    With the acceleration-like variable a and the acceleration z'', a step begins with a* = a_from_share a +
    a_from_force z'', v* = v + v_from_share a + v_from_force z'' and z* = z + h v + z_from_share a + z_from_force z''.
    Its acceleration adds gain, v_gain and z_gain times itself to these.  Likewise for a force and its share in a.
    """

    h: float
    gain: float
    v_gain: float
    z_gain: float
    a_from_force: float
    a_from_share: float
    v_from_force: float
    v_from_share: float
    z_from_force: float
    z_from_share: float

    @classmethod
    def of(cls, step: float, rho_inf: float) -> SchemeFactors:
        """Factors of a step in s with the spectral radius `rho_inf` at infinite frequency."""
        factors = ffi.new("pmr_factors *")
        lib.pmr_scheme_factors(step, rho_inf, factors)
        return cls(*(getattr(factors, name) for name in cls._fields))


def slide_pads(
    stiffness: Array, old: Array, limits: Array, moved: float, softness: float = 0.0, given: float = 0.0
) -> Array:
    """Friction (n,) N of a joint's pads after the old one, that slide by `moved` m (`pmr.system.friction`)."""
    arrays = [np.ascontiguousarray(array, float) for array in (stiffness, old, limits)]
    new = np.zeros(len(old))
    lib.pmr_friction(len(old), *map(_doubles, arrays), moved, softness, given, _doubles(new))
    return new


def _doubles(array: Array) -> Any:
    return ffi.cast("double *", array.ctypes.data)


def _integers(array: NDArray[np.int32]) -> Any:
    return ffi.cast("int32_t *", array.ctypes.data)
