"""States of the compiled kernel: how simulations are started and stepped, and what is recorded of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pmr.errors import InputError, SimulationError
from pmr.files.arrays import Array
from pmr.kernel._native import ffi, lib
from pmr.kernel.kernel import Kernel, Signals, pointer, structure

Integers = NDArray[np.int32]
_STARTS = {"rest": lib.PMR_AT_REST, "given": lib.PMR_GIVEN, "equilibrium": lib.PMR_IN_EQUILIBRIUM}


class StepError(SimulationError):
    """A step or start failed: with the error code of the kernel (src/pmr_kernel.h), and the contact that caused it.

    The contact is given by its number, -1 if no contact caused the error.
    """

    def __init__(self, message: str, failure: int, contact: int) -> None:
        """Store the error code `failure` and the number of the `contact`, besides the `message`."""
        super().__init__(message)
        self.failure, self.contact = failure, contact


@dataclass(frozen=True)
class Settings:
    """Time step, damping and substeps with which a system is simulated.

    If `parts` has several numbers, each step is divided into equal substeps.  Their number is the smallest one in
    `parts` that keeps the error of the forces of contacts that only push within the tolerance.  `energy` says whether
    the energy balance, stored energy and work, is computed.
    """

    step: float  # s
    rho_inf: float = 0.9  # spectral radius at infinite frequency, 0 to 1
    parts: tuple[int, ...] = (1,)  # allowed numbers of substeps in a step, ascending
    contact_omega: float = 0.0  # rad/s: frequency of contacts that only push; 0: their forces don't decide on substeps
    tolerance: float = 1e-5  # error of these forces in a substep, over the largest force so far
    energy: bool = True


class Record:
    """Recorded arrays of T steps by name, one row for each step; quantities that are not in `names` are not recorded.

    The numbers of substeps are in `parts` (T,), which is empty if they are not recorded.  The array `ends` is about the
    last step alone.  It has a row (3 + N,) for each substep of this step: a free extension with its first and second
    rate, and the N drivers, at the substep's end.  The kernel fills it only if there is a free extension.
    """

    FIELDS = ("z", "v", "multipliers", "impulses", "peaks", "energy", "friction", "outputs", "drivers", "hoist")

    def __init__(self, kernel: Kernel, steps: int, names: Sequence[str] = (*FIELDS, "parts"), parts: int = 0) -> None:
        """Make arrays of zeros for the quantities `names` in `steps` steps of a kernel.

        `parts` is the number of rows of `ends`: the largest number of substeps that the last step may have.  With 0,
        no ends of substeps are recorded.
        """
        sizes = (kernel.modes, kernel.modes, kernel.contacts, kernel.contacts, kernel.contacts, 2, kernel.pads)
        columns = dict(zip(self.FIELDS, (*sizes, kernel.outputs, kernel.drivers, kernel.hoist), strict=True))
        self.arrays = {name: np.zeros((steps, columns[name])) for name in names if name != "parts"}
        self.parts: Integers = np.zeros(steps if "parts" in names else 0, np.int32)
        self.ends = np.zeros((parts, 3 + kernel.drivers))
        self.steps = steps

    def __getitem__(self, name: str) -> Array:
        """Recorded array (T, columns) of the quantity `name`."""
        return self.arrays[name]

    def at(self, first: int) -> Any:
        """Structure ``pmr_record`` for the kernel, whose pointers lead to row `first` of each recorded array.

        Pointers of quantities that are not recorded are NULL.
        """
        arrays: dict[str, NDArray[Any]] = {**self.arrays, "parts": self.parts}
        recorded = {name: array[first:] for name, array in arrays.items() if array.size}
        return structure("pmr_record", recorded | ({"ends": self.ends} if self.ends.size else {}))


class SampledAdvance(NamedTuple):
    """Number of steps taken, and number of substeps that the next step needs: 0 if all steps were taken."""

    taken: int
    needed: int


class StateOutputs(NamedTuple):
    """Outputs of a system, and forces of its contacts, at the end of a step."""

    values: Array  # (o,)
    forces: Array  # (forces,) N


class State:
    """One simulation of a system at the end of its last step; it belongs to one thread at a time.

    Its arrays are read only and follow the simulation: modal coordinates `z` and rates `v` (modes,), `multipliers`
    (contacts,) in N, `impulses` (contacts,) in N s of the last step, `friction` (pads,) in N, and `drivers` (N,).
    `energy` (2,) in J is the stored energy and the energy put in since the start.  An InputError is raised for settings
    that are not allowed, and by methods for arrays of a wrong shape or type.
    """

    def __init__(self, kernel: Kernel, settings: Settings) -> None:
        """Open a simulation of the kernel's system; raise an InputError for settings that are not allowed."""
        self.kernel, self.settings = kernel, settings
        out, why = ffi.new("pmr_state **"), ffi.new(f"char[{lib.PMR_MESSAGE}]")
        chosen = structure("pmr_settings", vars(settings) | {"levels": len(settings.parts)})
        if lib.pmr_state_open(kernel._system, chosen, out, why):
            raise InputError("simulation", "settings", None, ffi.string(why).decode())
        self._state = ffi.gc(out[0], lib.pmr_state_close, lib.pmr_state_memory(out[0]))
        view = ffi.new("pmr_view *")
        lib.pmr_state_view(self._state, view)
        self._view = view
        r, m = kernel.modes, kernel.contacts
        self.z, self.v = (self._array(part, r) for part in (view.z, view.v))
        self.multipliers, self.impulses = (self._array(part, m) for part in (view.multipliers, view.impulses))
        self.energy, self.friction = self._array(view.energy, 2), self._array(view.friction, kernel.pads)
        self.drivers = self._array(view.drivers, kernel.drivers)

    def _array(self, pointer: Any, count: int) -> Array:
        """Read-only view (`count`,) of the state's numbers at the address `pointer`; it follows the simulation."""
        if not count:
            return np.zeros(0)
        array = np.frombuffer(ffi.buffer(pointer, 8 * count), np.float64)
        array.flags.writeable = False
        return array

    @property
    def step_number(self) -> int:
        """Number of the last step; 0 at the start."""
        return int(self._view.step[0])

    @property
    def parts(self) -> int:
        """Number of substeps of the last step."""
        return int(self._view.parts[0])

    @property
    def memory(self) -> int:
        """Memory of the state in bytes."""
        return int(lib.pmr_state_memory(self._state))

    def start(
        self,
        kind: Literal["rest", "given", "equilibrium"],
        u: ArrayLike,
        z: ArrayLike = (),
        v: ArrayLike = (),
        rates: ArrayLike | None = None,
    ) -> None:
        """Begin at t = 0 under drivers u (N,): at rest, with given z and v (modes,), or at rest in equilibrium.

        `kind` says which of the three; z and v have an effect only with ``given``.  With the `rates` (P,) of the paths
        in m/s, v is corrected by the change of least kinetic energy, so that rigid contacts move with their paths.  A
        StepError is raised if nothing holds the bodies, or if contacts depend on each other; an InputError for numbers
        that are not finite.
        """
        drivers = self._check_array("u", u, self.kernel.drivers)
        moving = None if rates is None else self._check_array("rates", rates, self.kernel.paths)
        pointers = map(pointer, (drivers, moving, *self._initial_modes(kind, z, v)))
        self.raise_unless_done(lib.pmr_start_moving(self._state, _STARTS[kind], *pointers), "the start")

    def _initial_modes(self, kind: str, z: ArrayLike, v: ArrayLike) -> list[Array]:
        """Coordinates z and rates v (modes,) for a start: as passed if its `kind` is ``given``, otherwise zeros.

        Raises InputError for another shape, or numbers that are not finite.
        """
        count = self.kernel.modes
        return [self._check_array(n, x if kind == "given" else np.zeros(count), count) for n, x in (("z", z), ("v", v))]

    def step(self, u: ArrayLike, rates: ArrayLike | None = None) -> None:
        """Take one step, at the end of which the drivers are u (N,).

        In substeps, drivers follow straight lines if `rates` is None, else cubics with the `rates` (2, N) at the
        beginning and the end of the step.  A StepError is raised if the step fails or the drivers are not finite.
        """
        at = self._check_array("u", u, self.kernel.drivers, finite=False)
        led = None if rates is None else self._check_array("rates", np.ravel(rates), 2 * self.kernel.drivers)
        failed = lib.pmr_step(self._state, pointer(at), pointer(led))
        self.raise_unless_done(failed, f"step {self.step_number + 1}")

    def start_in_frame(
        self,
        kind: Literal["rest", "given", "equilibrium"],
        motions: ArrayLike,
        rows: Integers | None = None,
        z: ArrayLike = (),
        v: ArrayLike = (),
    ) -> None:
        """Begin at t = 0 with the n motions that drive the frame, (3, n): values, rates and second rates.

        Only the first rows[k] of the three numbers of motion k are prescribed; None stands for all three.  The bodies
        begin as `kind` says; z and v (modes,) are the coordinates and rates of a ``given`` state.  Errors as `start`.
        """
        at = self._check_array("motions", np.ravel(motions), 3 * self.kernel.motions)
        arrays = (at, _ensure_integers("rows", rows, self.kernel.motions), *self._initial_modes(kind, z, v))
        pointers = map(pointer, arrays)
        self.raise_unless_done(lib.pmr_start_in_frame(self._state, _STARTS[kind], *pointers), "the start")

    def step_in_frame(self, motions: ArrayLike, rows: Integers | None = None) -> None:
        """Take one step, at the end of which the n motions of the frame are (3, n): values, rates and second rates.

        Only the first rows[k] of the three numbers of motion k are prescribed; None stands for all three.  A StepError
        is raised if the step fails.
        """
        count = self.kernel.motions
        at = self._check_array("motions", np.ravel(motions), 3 * count, finite=False)
        failed = lib.pmr_step_in_frame(self._state, pointer(at), pointer(_ensure_integers("rows", rows, count)))
        self.raise_unless_done(failed, f"step {self.step_number + 1}")

    def advance(
        self,
        signals: Signals,
        steps: int,
        record: Record,
        first: int = 0,
        every: int = 1,
        parts: Integers | None = None,
    ) -> None:
        """Take `steps` steps with drivers from signals; record each `every`-th step, from row `first` of the record on.

        `parts` (steps,), int32, has the number of substeps of each step, one of the numbers in the settings' `parts`;
        if it is None, the kernel chooses.  A StepError is raised if a step fails.  The state is then at the end of the
        last whole step, and previous steps have been recorded; after PMR_NOT_FINITE the state has to be started or
        restored.
        """
        _check_room(record, first, steps // every, self.settings.parts[-1])
        taken, schedule = ffi.new("int64_t *"), pointer(_ensure_integers("parts", parts, steps))
        failed = lib.pmr_advance(self._state, signals.pointer, steps, every, schedule, record.at(first), taken)
        self.raise_unless_done(failed, f"step {self.step_number + 1}")

    def advance_sampled(
        self, u: Array, per: int, record: Record, first: int = 0, every: int = 1, parts: Integers | None = None
    ) -> SampledAdvance:
        """Take steps whose drivers are given by samples at equal distances, `per` of them in each step.

        The first row of the samples u (steps * per + 1, N) is at the end of the previous step.  If the number of
        substeps that a step needs does not divide `per`, the state stops before this step.  `record`, `first`, `every`,
        `parts` and errors are those of `advance`; an InputError is raised for samples of another shape.
        """
        u = np.ascontiguousarray(u, float)
        steps = (len(u) - 1) // per
        if u.shape != (steps * per + 1, self.kernel.drivers):
            allowed = f"(steps {per} + 1, {self.kernel.drivers}) is allowed"
            raise InputError("state", "u", u.shape, allowed)
        _check_room(record, first, steps // every, self.settings.parts[-1])
        taken = ffi.new("int64_t *")
        needed = ffi.new("int *")
        schedule = pointer(_ensure_integers("parts", parts, steps))
        failed = lib.pmr_advance_sampled(
            self._state, pointer(u), per, steps, every, schedule, record.at(first), taken, needed
        )
        self.raise_unless_done(failed, f"step {self.step_number + 1}")
        return SampledAdvance(int(taken[0]), int(needed[0]))

    def outputs(self) -> StateOutputs:
        """Outputs of the system, and forces of all contacts, at the end of the last step."""
        y, forces = np.zeros(self.kernel.outputs), np.zeros(self.kernel.forces)
        lib.pmr_outputs(self._state, pointer(y), pointer(forces))
        return StateOutputs(y, forces)

    @property
    def hoist(self) -> Array:
        """Outputs (10,) of the hoist at the end of the last step, in the order of `pmr.scene.hoist.OUTPUTS`.

        The array is empty if the system has no hoist.  Errors as `further`.
        """
        last = self.kernel.further - self.kernel.computed
        return self.further()[last - self.kernel.hoist : last]

    @property
    def ground(self) -> Array:
        """Outputs (g,) of outriggers at the end of the last step, in the order of `pmr.kernel.further.ground_outputs`.

        The array is empty if the scene has no ground.  Errors as `further`.
        """
        last = self.kernel.further - self.kernel.computed - self.kernel.hoist
        return self.further()[last - self.kernel.ground : last]

    @property
    def computed(self) -> Array:
        """Outputs (k,) of a free luffing angle or extension after the last step, ordered as `ComputedData.outputs`.

        The array is empty if angle and extensions are prescribed.  Errors as `further`.
        """
        return self.further()[self.kernel.further - self.kernel.computed :]

    def further(self) -> Array:
        """Further outputs (further,) at the end of the last step.

        The first outputs are the reactions of rigid supports in N and N m.  In a frame, the position of the tip in m
        follows, relative to the pivot along the ground's axes, and the force of the luffing cylinder in N.  Last come
        the outputs of outriggers, of a hoist, and of a free luffing angle or extension, as far as the system has them.
        A StepError is raised if forces of outriggers are not found or not finite.
        """
        further = np.zeros(self.kernel.further)
        failed = lib.pmr_further(self._state, pointer(further))
        self.raise_unless_done(failed, f"the outputs of step {self.step_number}")
        return further

    def save(self) -> bytes:
        """Bytes of the state, from which `restore` continues."""
        content = ffi.new("char[]", lib.pmr_state_bytes(self._state))
        lib.pmr_state_save(self._state, content)
        return bytes(ffi.buffer(content))

    def restore(self, content: bytes) -> None:
        """Continue from `content`, the bytes that `save` returned for a state of this system with these settings.

        An InputError is raised if the bytes belong to another state, or are damaged.
        """
        why = ffi.new(f"char[{lib.PMR_MESSAGE}]")
        failed = lib.pmr_state_restore(self._state, content, len(content), why)
        if failed == lib.PMR_REFUSED:
            raise InputError("state", "bytes", None, ffi.string(why).decode(errors="replace"))
        self.raise_unless_done(failed, "a restored state")

    @property
    def pointer(self) -> Any:
        """Address of the state, for the kernel's functions."""
        return self._state

    def _check_array(self, name: str, values: ArrayLike, count: int, finite: bool = True) -> Array:
        """Return `values` as a contiguous array (count,); raise an InputError about `name` for another shape.

        Numbers that are not finite are refused, too, if `finite`; otherwise the kernel refuses them itself.
        """
        array = np.ascontiguousarray(values, float)
        if array.shape != (count,):
            raise InputError("state", name, array.shape, f"{(count,)} is allowed")
        if finite and not np.isfinite(array).all():
            raise InputError("state", name, None, "finite numbers are allowed")
        return array

    def raise_unless_done(self, failed: int, where: str) -> None:
        """Raise a StepError for the error code `failed` of a kernel function, unless the code is PMR_DONE.

        The message says `where` the function failed, and names the contact that caused it.
        """
        if failed == lib.PMR_DONE:
            return
        trouble = lib.pmr_state_trouble(self._state)
        names = self.kernel.names("contacts")
        contact = names[trouble] if 0 <= trouble < len(names) else "one of the contacts"
        reasons = {
            lib.PMR_REFUSED: "drivers that are not finite, of another system, parts that the settings have not, or "
            "derivatives with a hoist",
            lib.PMR_DEPENDENT: f"{contact} depends on those before it, or nothing holds the bodies",
            lib.PMR_UNSETTLED: "which contacts are closed was not settled in 1000 solves",
            lib.PMR_UNCONVERGED: "forces of terms or friction do not converge",
            lib.PMR_NOT_FINITE: "a coordinate, or a force on the ground, is no finite number",
            lib.PMR_LIFTED: "which outriggers lift off is not found",
            lib.PMR_LOST: "the motion of machine, luffing angle or extension is not found: shorter steps are needed",
            lib.PMR_UPRIGHT: "the machine pitches by 90 degrees, or foot, lug and pivot of its cylinder come in line",
            lib.PMR_BEYOND: "the extension has left its stroke and stop_travel beyond it",
            lib.PMR_STROKE: "the length of the luffing cylinder at the first luffing angle is needed within its stroke",
            lib.PMR_BLOCKED: "the hook is at its head sheaves: its rope is too short",
        }
        message = f"the kernel failed at {where}: {reasons.get(failed, f'error {failed}')}"
        raise StepError(message, failed, trouble)


def _check_room(record: Record, first: int, rows: int, parts: int) -> None:
    """Raise an InputError unless the record has `rows` rows from row `first` on, and enough rows of `ends`.

    The rows of `ends` have to suffice for `parts` substeps; this is checked only if the record has any.
    """
    if first < 0 or first + rows > record.steps:
        raise InputError("state", "record", record.steps, f"{first + rows} rows or more are needed")
    if record.ends.size and len(record.ends) < parts:
        raise InputError("state", "record", len(record.ends), f"ends of {parts} parts or more are needed")


def _ensure_integers(name: str, numbers: Integers | None, count: int) -> Integers | None:
    """Return `numbers`; raise an InputError about `name` unless they are None or contiguous int32 (count,)."""
    if numbers is not None and (
        numbers.dtype != np.int32 or numbers.shape != (count,) or not numbers.flags.c_contiguous
    ):
        raise InputError("state", name, numbers.shape, f"{(count,)} integers of 32 bits are allowed")
    return numbers


class BoundStep:
    """Steps of a state for fast loops in Python: pointers are made once, and methods return error codes.

    An error code is 0 if the step was done.  With a frame, `step` takes a step to `motions` (3, n) of the frame; only
    the first rows[k] numbers of motion k are prescribed, with `rows` (n,).  Without a frame, `step` takes a step to the
    drivers u (N,) in the first row of `motions` (3, N).  `step_by_rates` takes a step along cubics, with the `rates`
    (2, N) of the drivers at both ends of the step.

    `observe` writes to `values` the quantities with the chosen `numbers`.  The numbers count through the outputs, then
    the forces of contacts, and then the outputs of a hoist, of a free luffing angle or extension, and of outriggers.
    If there are limits, `observe` returns -1 - k if limit number k does not hold, once for each limit.
    """

    def __init__(self, state: State, numbers: Sequence[int], limits: Any = None) -> None:
        """Bind the steps of `state` to arrays of this object, and `observe` to the quantities `numbers` (k).

        `limits` are those that the kernel looks at, its `pmr_limits`; None for no limits.
        """
        kernel, count = state.kernel, len(numbers)
        self.motions = np.zeros((3, kernel.motions or kernel.drivers))
        self.rows: Integers = np.ones(self.motions.shape[1], np.int32)
        self.rates = np.zeros((2, kernel.drivers))  # rates of the drivers at both ends of a step
        self._numbers, self.values = np.array(numbers, np.int32), np.zeros(count)
        handle, motions = state.pointer, pointer(self.motions)
        if kernel.motions:
            self.step = partial(lib.pmr_step_in_frame, handle, motions, pointer(self.rows))
            self.step_by_all = partial(lib.pmr_step_in_frame, handle, motions, ffi.NULL)
        else:
            self.step = self.step_by_all = partial(lib.pmr_step, handle, motions, ffi.NULL)
        self.step_by_rates = partial(lib.pmr_step, handle, motions, pointer(self.rates))
        all_outputs = numbers == [*range(kernel.outputs)]
        arguments = handle, count, ffi.NULL if all_outputs else pointer(self._numbers), pointer(self.values)
        if limits is not None:
            self.observe = partial(lib.pmr_observe_and_watch, *arguments, limits)
        elif all_outputs:
            self.observe = partial(lib.pmr_outputs, handle, pointer(self.values), ffi.NULL)
        else:
            self.observe = partial(lib.pmr_observe, *arguments)
