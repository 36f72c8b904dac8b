"""Laws of the compiled kernel as functions, for statics, charts and other simulators (src/pmr_kernel.h)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.errors import SimulationError
from pmr.files.arrays import Array, Indices, Mask
from pmr.kernel._native import ffi, lib
from pmr.kernel.blocks import LINE
from pmr.kernel.further import mass_numbers
from pmr.kernel.kernel import pointer, structure
from pmr.scene.ground import Ground, MachineMass, edge_rows


class ContactError(SimulationError):
    """No solution of a complementarity problem was found.

    `row` is the number of the first contact that depends linearly on the contacts before it; None if the search did not
    end.
    """

    row: int | None = None


class ContactForces(NamedTuple):
    """Solution of a complementarity problem of m contacts: their forces, and which of them are closed."""

    forces: Array  # (m,) N
    closed: Mask  # (m,): contacts without a gap


def solve_contact(A: Array, b: Array, pushes: Mask, closed: Mask) -> ContactForces:
    """Solve A lambda = b + w with lambda >= 0, w >= 0, lambda w = 0 at contacts that only push and w = 0 at others.

    Parameters
    ----------
    A : (m, m) array, m/N
        Symmetric and positive definite.
    b : (m,) array, m
        Displacements of the contacts beyond their clearances if there are no contact forces; finite numbers.
    pushes, closed : (m,) arrays
        Masks of the contacts that only push, and of those that are closed when the search begins.

    Returns
    -------
    ContactForces
        The forces lambda, and the mask of contacts with w = 0.

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
    arrays: list[NDArray[Any]] = [A, b, only_push, forces, state, work]
    failed = lib.pmr_contact(m, *map(pointer, arrays), trouble)
    if failed == lib.PMR_DEPENDENT:
        error = ContactError(f"contact {trouble[0]} depends on those before it")
        error.row = int(trouble[0])
        raise error
    if failed:
        raise ContactError("which contacts are closed was not settled in 1000 solves")
    return ContactForces(forces, state.astype(bool))


class ContactSearch:
    """Search for the contacts that are closed, as in `solve_contact`.

    The search is for callers that compute the contact forces themselves.
    """

    def __init__(self) -> None:
        """Begin a search."""
        self._state = ffi.new("pmr_search *")

    def change(self, closed: Mask, wrong: Mask) -> Mask:
        """Return the mask (m,) of the contacts that are to be closed in the caller's next solve.

        The mask `closed` (m,) has the contacts that were closed in the last solve, the mask `wrong` (m,) those that its
        result contradicts.  A contact is wrong if it is closed and pulls, or if it is open and overlaps.
        """
        changes = np.array(wrong, np.int32)
        lib.pmr_choose_changes(len(changes), pointer(changes), self._state)
        return np.asarray(closed ^ changes.astype(bool))


class FixedPoint:
    """Iteration of x (n,) to a fixed point x = phi(x), accelerated by generalized conjugate residuals.

    If phi is linear, the number of iterates is the number of distinct eigenvalues of the derivative of phi.  The
    iteration converges even if the eigenvalues are large.
    """

    def __init__(self, size: int, most: int = 32, add_up: Callable[[float], float] | None = None) -> None:
        """Begin without iterates, for n = `size` numbers on this rank; at most `most` earlier directions are stored.

        If each rank has a part of the iterates, ``add_up(value)`` returns the sum of `value` over all ranks.
        """
        count = 4 * -(-size // 4)
        room = np.zeros((4 + 2 * most) * count + LINE // 8)
        first = -room.ctypes.data % LINE // 8
        self._size, self._rows = size, room[first : first + (4 + 2 * most) * count].reshape(4 + 2 * most, count)
        self._state = ffi.new("pmr_iteration *", {"count": count, "measured": count, "most": most})
        names = ("x", "f", "least_x", "least_f", "directions")
        for name, row in zip((*names, "changes"), (0, 1, 2, 3, 4, 4 + most), strict=True):
            setattr(self._state, name, pointer(self._rows[row:]))
        self._raised: BaseException | None = None  # error in `add_up`, which C can't pass on
        if add_up is not None:

            def add(value: Any, _: Any) -> None:
                """Replace the number at the address `value` by its sum over all ranks."""
                value[0] = add_up(value[0])

            def store_error(_: Any, error: BaseException, __: Any) -> None:
                """Store the first `error` of `add_up`, which `next` raises."""
                self._raised = self._raised or error

            self._state.sum = self._add = ffi.callback("void(double *, void *)", add, onerror=store_error)

    def restart(self) -> None:
        """Discard all previous iterates; to be called if phi has become another function."""
        lib.pmr_restart(self._state)

    def next(self, x: Array, phi: Array) -> Array:
        """Return the iterate (n,) to try after x (n,), for `phi` = phi(x) (n,).  Errors of `add_up` are raised."""
        self._rows[0, : self._size], self._rows[1, : self._size] = x, phi - x
        lib.pmr_extrapolate(self._state)
        if self._raised is not None:
            error, self._raised = self._raised, None
            raise error
        return self._rows[0, : self._size].copy()


class SchemeFactors(NamedTuple):
    r"""Factors of generalized-alpha with steps of `h` s.

    The coordinates are z, their rates v, their acceleration z''.  The scheme also has a variable a of its own.  A
    step begins with this prediction::

        a* = a_from_share a + a_from_force z''
        v* = v + v_from_share a + v_from_force z''
        z* = z + h v + z_from_share a + z_from_force z''

    The acceleration of the step adds `gain`, `v_gain` and `z_gain` times itself to a*, v* and z*. A contact force and
    its contribution to a enter the next prediction with the factors of z'' and a.
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
        """Factors for a time step of `step` s, with the spectral radius `rho_inf` (0 to 1) at infinite frequency."""
        factors = ffi.new("pmr_factors *")
        lib.pmr_scheme_factors(step, rho_inf, factors)
        return cls(*(getattr(factors, name) for name in cls._fields))


class JointCylinder(NamedTuple):
    """Cylinder of a joint whose pads have friction, at the end of a step at which it carries `force`."""

    gives: float = 0.0  # m/N: 1/k; 0 if the cylinder is rigid or missing
    compliance: float = 0.0  # m/N: diagonal entry of the cylinder in the matrix A (`solve_contact`)
    force: float = 0.0  # N
    friction: float = 0.0  # N: sum of the pads' friction with which `force` was computed
    drive: float = 0.0  # N: force plus friction at the end of the last step


class PadFriction(NamedTuple):
    """Friction forces of the n pads of a joint along the boom, and the friction at which each pad slides."""

    friction: Array  # (n,) N
    limits: Array  # (n,) N: friction at which each pad slides


def slide_pads(
    stiffness: Array, laws: Array, forces: Array, old: Array, displacement: float, speed: float, cylinder: JointCylinder
) -> PadFriction:
    """Friction of a joint's n pads at the end of a step; raises ValueError if `laws` has another shape.

    Parameters
    ----------
    stiffness : (n,) array, N/m
        Stiffness of each pad along the boom while it sticks.
    laws : (n, l) array
        Constants of each pad's law of friction (`pmr.scene.joints.FrictionLaw`); l is the kernel's number of them.
    forces, old : (n,) arrays, N
        Forces of the pads, and their friction at the end of the last step (`pmr.system.contacts`).
    displacement, speed : float
        Change of the path coordinate in the step, in m, and its rate, in m/s.
    cylinder : JointCylinder
        The joint's cylinder, which gives way to the friction.
    """
    if np.shape(laws) != (len(old), constants := lib.LAW_CONSTANTS):
        raise ValueError(f"{constants} constants of each of {len(old)} pads are allowed, not {np.shape(laws)}")
    arrays = [np.ascontiguousarray(array, float) for array in (stiffness, laws, forces, old)]
    limits, new = np.zeros((2, len(old)))
    joint = ffi.new("pmr_cylinder *", cylinder._asdict())
    lib.pmr_friction(len(old), *map(pointer, arrays), displacement, speed, joint, *map(pointer, (limits, new)))
    return PadFriction(new, limits)


@dataclass(frozen=True)
class Stand:
    """Outriggers on which a machine stands: n places, of which e are the corners of the support polygon."""

    places: Array  # (n, 2) m: X, Y from the pivot, along the axes of the machine
    stiffness: Array  # (n,) N/m
    corners: Indices  # (e,): numbers of the outriggers at the corners, anticlockwise
    height: float  # m: of the pivot above the ground

    @classmethod
    def of_ground(cls, ground: Ground) -> Stand:
        """Return places, stiffnesses, polygon corners and height of a scene's ground, as arrays for the kernel."""
        return cls(
            np.array([outrigger.at for outrigger in ground.outriggers]),
            np.array([outrigger.stiffness for outrigger in ground.outriggers]),
            np.array(ground.corner_numbers),
            ground.height,
        )

    @property
    def polygon(self) -> Array:
        """Corners (e, 2) of the support polygon in m, anticlockwise."""
        return np.asarray(self.places[self.corners])

    @property
    def edges(self) -> Array:
        """Rows (e, 6), one for each edge: a row times a wrench (6,) is the moment about the edge that tips the machine.

        A wrench is a force and its moment about the pivot (`pmr.scene.ground.edge_rows`).
        """
        return edge_rows(self.polygon, self.height)

    def columns(self, wrench: Array) -> Array:
        """Return force and moment on the ground, forces of outriggers, margins at edges and use of the support polygon.

        The result (T, 6 + n + e + 1) has these quantities as columns, in this order, for n outriggers and e edges.
        `wrench` (T, 6) are the force and the moment about the pivot by which boom and machine press on the ground,
        along the axes of the machine.  A SimulationError is raised if the search for the outriggers that lift off does
        not end, or if forces are not finite.
        """
        return self._call_kernel(lib.pmr_stand_columns, wrench, 7 + len(self.places) + len(self.corners))

    def forces(self, loads: Array) -> Array:
        """Return the forces (T, n) in N of the outriggers under loads within the support polygon.

        `loads` (T, 3) are the total vertical force in N, and its moments: sums of forces times X and times Y, in N m.
        Raises a SimulationError as `columns` does.
        """
        return self._call_kernel(lib.pmr_stand_forces, loads, len(self.places))

    def _call_kernel(self, function: Any, loads: Array, width: int) -> Array:
        """Return the results (T, width) of a `function` of the kernel for these outriggers under T loads.

        `loads` (T, any) has a row for each of the T steps.  Raises SimulationError as `columns` does.
        """
        counts = {"outriggers": len(self.places), "corners": len(self.corners), "height": self.height}
        arrays = {"places": self.places, "stiffness": self.stiffness, "at_corners": self.corners, "edges": self.edges}
        stand = structure("pmr_stand", counts | arrays)
        loads = np.ascontiguousarray(loads, float)
        columns = np.zeros((len(loads), width))
        if failed := function(stand, len(loads), pointer(loads), pointer(columns)):
            finite = failed != lib.PMR_NOT_FINITE
            raise SimulationError("which outriggers lift off was not found" if finite else "forces are not finite")
        return columns


def masses_wrench(masses: Sequence[MachineMass], angles: Array, falling: Array) -> Array:
    """Force and moment about the pivot (T, 6) in N and N m by weight and inertia of masses, along the machine's axes.

    `angles` (T, 3, 4) in rad are slewing, roll, pitch and yaw, with rates and second rates.  `falling` (T, 3) in m/s^2
    is the sum of the acceleration of the pivot and an upward gravity, along axes of the ground.
    """
    numbers = mass_numbers(masses)
    wrenches = np.zeros((len(falling), 6))
    angles, falling = (np.ascontiguousarray(of, float) for of in (angles, falling))
    lib.pmr_masses_wrench(len(numbers), pointer(numbers), len(falling), *map(pointer, (angles, falling, wrenches)))
    return wrenches
