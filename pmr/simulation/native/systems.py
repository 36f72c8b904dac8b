"""The compiled simulator of any system: generalized-alpha in the modal coordinates of each body.

The bodies' M, K and D never change, so each body is diagonalised once; only the multipliers of the m contacts couple
the bodies, by one m x m solve in each step (`pmr.kernel`, docs/system_of_bodies.md).  A body may be reduced or of full
order, up to some thousand coordinates: the same loop is the reference for the error of a reduction.

`March` is one simulation by the kernel: its start, its steps block by block, and its energy balance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmr.errors import SimulationError
from pmr.files.arrays import Array
from pmr.kernel._native import lib
from pmr.kernel.kernel import Signals
from pmr.kernel.state import Record, Settings, State, StepError
from pmr.simulation import contact_step
from pmr.simulation.excitation import Excitation, first_moves, side_positions
from pmr.simulation.native.form import SystemForm, begin, driver_signals, path_text, step_failure
from pmr.simulation.native.form import start_of as start_of
from pmr.simulation.native.form import static_start as static_start
from pmr.simulation.start import InitialState
from pmr.simulation.stepping import Progress, Recorder, SimulationEnd, energy_round_off, energy_surplus, refuse_growth
from pmr.system.states import SystemTrajectory, displacements
from pmr.system.system import System


@dataclass(frozen=True)
class Observation:
    """Selected outputs and contact forces of a simulation, at T recorded steps."""

    t: Array  # (T,) s
    y: Array  # (T, o), in the units of the outputs
    multipliers: Array  # (T, m) N
    seconds: float  # wall time of solver and outputs


#: Most steps in one call of the kernel, between which the user can interrupt; fewer if divided steps take long.
BLOCK = 16384
#: After a call that takes less than this many seconds, calls take more steps.
BRIEF = 0.05
#: Samples of drivers that are computed at once: number of times, and least number of steps.
TIMES, FINE = 2048, 64
#: Most numbers recorded in one call of the kernel: fewer steps if there are more coordinates.
RECORDED = 2**22


class Steps(NamedTuple):
    """Records of T steps, one block of a simulation.

    The first record repeats the last one of the block before; in the first block it is the start.  The arrays are valid
    until the next steps are taken: copy what you keep.
    """

    z: Array  # (T, modes): modal coordinates
    v: Array  # (T, modes): rates of the modal coordinates
    multipliers: Array  # (T, m) N
    energy: Array  # (T, 2) J: stored energy, and work since the start
    drivers: Array  # (T, N)
    peaks: Array | None = None  # (T, m) N: largest force within the step, if steps may be divided
    parts: NDArray[np.int32] | None = None  # (T,): number of parts of each step
    impulses: Array | None = None  # (T, m) N s: impulse in the step, if contacts only push
    friction: Array | None = None  # (T, n) N: of the pads that rub
    hoist: Array | None = None  # (T, 10): outputs of a hoist

    def at(self, rows: slice) -> Steps:
        """Return the records in the slice `rows`; the arrays are views."""
        return Steps._make(None if array is None else array[rows] for array in self)


class March:
    """One simulation by the kernel of a system in modal form; errors as `pmr.simulation.SystemSimulator`."""

    def __init__(
        self, form: SystemForm, excitation: Excitation, initial: Mapping[str, InitialState] | None = None
    ) -> None:
        """Start the kernel for the system in `form` under the excitation, in the states `initial` of bodies by name.

        Bodies without a state start undeformed and at rest.  If `initial` is None, the simulation starts as
        ``excitation.start`` says.
        """
        system, stepping, kernel = form.system, excitation.stepping, form.kernel
        self.form, self.excitation, self.t = form, excitation, excitation.times
        if system.on_one_path and excitation.paths:
            (body,) = system.bodies.values()
            excitation.path_within(body.domain)  # raises the error of a path out of its range
        self.x = side_positions(system, excitation)
        self.pushing = ~np.isnan(form.modal.clearance)
        parts: tuple[int, ...] = (1,)
        omega = 0.0
        if self.pushing.any():
            if not (stepping.parts or stepping.schedule):
                omega = contact_step.contact_frequency(form.modal, excitation)
            parts = contact_step.part_counts(omega, stepping)
        self.finest = parts[-1]
        self._schedule = np.array(stepping.schedule, np.int32) if stepping.schedule else None
        x = side_positions(form.modal, excitation, first_moves(excitation))
        # names of rigid rows that move: their forces are not damped
        self._growing = list(form.refuse_unsupported(x, stepping.rho_inf).rigid_moving_rows)
        self._signals: Signals | None
        self._energy, self._work = np.zeros(len(self.t)), np.zeros(len(self.t))
        self.state = State(kernel, Settings(stepping.step, stepping.rho_inf, parts, omega))
        self._drivers, self._sampling = driver_signals(form, excitation), 0.0
        frame = form.frame if form.frame is not None and form.frame.drives(excitation) else None
        try:
            self._signals = Signals(self._drivers if frame is None else frame.signals)
        except NotImplementedError:
            frame = self._signals = None
        if frame is not None:
            start = partial(self.state.start_in_frame, motions=frame.motions(excitation, 0.0).ravel())
        else:
            u = self.sample_drivers(0, 0, 1)[0] if self._signals is None else self._signals.at(0.0)[0]
            start = partial(self.state.start, u=u)
        if initial is None and excitation.start == "equilibrium" and system.hoist and excitation.resting is not None:
            still = March(form, excitation.resting).state  # the kernel alone finds the equilibrium of a rope
            initial = form.initial_states(still.z, still.v)
        try:
            self._start_again = begin(form, start, excitation, initial)
        except StepError as error:
            raise self._failure(error, 0) from None
        self._sampling = 0.0  # s: time spent to sample drivers since the start

    def restart(self) -> None:
        """Set the kernel's state to t = 0 again."""
        self._start_again()
        self._sampling = 0.0

    def run(self, take: Callable[[int, Steps], None], progress: Progress | None = None) -> SimulationEnd:
        """Take all steps, and check the energy at the end; return the solver's time and the surplus of energy.

        ``take(first, steps)`` is called for blocks of consecutive steps: `first` is the number of the first step.
        `progress`, if it is not None, is called with the share of steps that are done.  Raises GrowthError if too much
        energy comes from neither loads nor contacts that travel: more than the share `pmr.simulation.stepping.GROWN` of
        the largest energy.
        """
        paths, inputs, least = self.form.kernel.paths, self.form.kernel.inputs, 0.0

        def record_block(first: int, steps: Steps) -> None:
            """Store energies and work of some steps and hand these to `take`; `first` is the first record's number."""
            nonlocal least
            at = slice(first, first + len(steps.z))
            self._energy[at], self._work[at] = steps.energy.T
            loads = steps.drivers[:, paths : paths + inputs]
            least = max(least, energy_round_off(self.form.mobility, loads, float(self.t[1])))
            take(first, steps)

        seconds = self.observe(1, record_block, progress)
        surplus = energy_surplus(self._energy, self._work, least, since_start=bool(self.pushing.any()))
        refuse_growth(surplus, self._growing)
        return SimulationEnd(seconds, surplus)

    def rerun(self) -> float:
        """Take all steps once more from the start, without output; return the solver's time in s."""
        self.restart()
        return self.observe(1, lambda first, steps: None)

    def observe(self, every: int, take: Callable[[int, Steps], None], progress: Progress | None = None) -> float:
        """Take steps, and return the solver's time in s; records of each `every`-th step are passed to `take`.

        `every` is at most the number of steps.  Steps after the last one that is recorded are not taken.  The energy is
        not checked.  ``take(first, steps)`` is called for blocks of consecutive records: `first` is the number of the
        first record, `steps` are the records.  The first record of a block repeats the last one of the block before; in
        the first block it is the start.  `progress`, if it is not None, is called with the share of steps that are
        done.  Raises SimulationError if a step fails or a state is not finite, and the errors of `take` and `progress`.
        """
        count = (len(self.t) - 1) // every
        most = max(1, min(BLOCK // every, RECORDED // (2 * self.form.kernel.modes), count))
        record = Record(self.form.kernel, most + 1, self._record_names)
        room = self._begin_record(record)
        first, seconds, size = 1, 0.0, max(1, most // self.finest)  # a step in parts takes as long as so many
        while first <= count:
            last = min(first + size, count + 1)
            clock = perf_counter()
            self._advance((first - 1) * every, last - first, every, record)
            elapsed = perf_counter() - clock
            steps = room.at(slice(last - first + 1))
            for forces in (steps.multipliers, steps.peaks):
                if forces is not None and self.pushing.any():
                    remove_pull(forces, self.pushing)
            take(first - 1, steps)
            for array in room if last <= count else ():
                if array is not None:
                    array[0] = array[last - first]
            if progress is not None:
                progress((last - 1) / count)
            first, seconds, size = last, seconds + elapsed, min(2 * size, most) if elapsed < BRIEF else size
        return seconds - self._sampling

    @property
    def _record_names(self) -> tuple[str, ...]:
        """Names of the arrays of `Steps` that are recorded at each step.

        Modal coordinates, rates, contact forces, energies and drivers always are; the other arrays depend on what the
        system has.
        """
        of_parts = ("peaks", "parts") if self.finest > 1 else ()
        impulses = ("impulses",) if self.pushing.any() else ()
        friction = ("friction",) if self.form.kernel.pads else ()
        hoist = ("hoist",) if self.form.kernel.hoist else ()
        return ("z", "v", "multipliers", "energy", "drivers", *of_parts, *impulses, *friction, *hoist)

    def _begin_record(self, record: Record) -> Steps:
        """Write the present state into the first row of each array of a record, and return these arrays."""
        arrays: dict[str, Any] = dict(record.arrays)
        for name, array in arrays.items():
            array[0] = getattr(self.state, "multipliers" if name == "peaks" else name)
        if "parts" in self._record_names:
            record.parts[0] = 1
            arrays["parts"] = record.parts
        return Steps(**arrays)

    def _advance(self, first: int, rows: int, every: int, record: Record) -> None:
        """Take `rows` times `every` steps after the step number `first`, and record each `every`-th step.

        The states are recorded in the rows 1 to `rows` of `record`; row 0 is the state at the step `first`, which does
        not change.  Raises SimulationError if a step fails or a state is not finite.
        """
        steps = rows * every
        schedule = None if self._schedule is None else self._schedule[first : first + steps]
        try:
            if self._signals is not None:
                self.state.advance(self._signals, steps, record, 1, every, schedule)
            else:
                self._advance_sampled(first, steps, every, schedule, record)
        except StepError as error:
            finite = np.isfinite(record["z"][: rows + 1]).all(axis=1)
            if error.failure == lib.PMR_NOT_FINITE and not finite.all():
                where = self._step_text((first // every + int(np.argmin(finite))) * every)
                raise SimulationError(f"stopped at {where}: not finite") from None
            raise self._failure(error, self.state.step_number + 1) from None

    def _advance_sampled(
        self, first: int, steps: int, every: int, schedule: NDArray[np.int32] | None, record: Record
    ) -> None:
        """Take `steps` steps after number `first`, with drivers sampled in Python at the points that the parts need.

        The record gets a row for each `every`-th step, from row 1 on.  `schedule` (steps,) has the number of parts of
        each step; if it is None, the kernel chooses.  Raises StepError if a step fails.
        """
        taken, per = 0, self.state.settings.parts[0]
        while taken < steps:
            skip = -taken % every  # steps up to the next record, if a call ended between two records
            count, each = (every * max(1, max(FINE, TIMES // per) // every), every) if skip == 0 else (skip - 1, skip)
            if skip == 1:
                count = each = 1
            end = min(steps, taken + count)
            parts = None if schedule is None else schedule[taken:end]
            if parts is not None:
                per = int(np.lcm.reduce(parts))
            u = self.sample_drivers(first + taken, first + end, per)
            done, needed = self.state.advance_sampled(u, per, record, 1 + taken // every, each, parts)
            taken, per = taken + done, needed or max(self.state.settings.parts[0], per // 2)

    def sample_drivers(self, first: int, last: int, per: int) -> Array:
        """Values (K, N) of the drivers at `per` evenly spaced times in each step, from step `first` to step `last`.

        Both ends are included: K is (last - first) per + 1.
        """
        clock = perf_counter()
        t = np.arange(first * per, last * per + 1) * (float(self.t[1]) / per)
        u = np.column_stack([np.empty((len(t), 0)), *(signal.value(t) for signal in self._drivers)])
        self._sampling += perf_counter() - clock
        return u

    def _failure(self, error: StepError, step: int) -> SimulationError:
        """Return an error with words for the user, for an `error` of the kernel in step number `step`."""
        x = side_positions(self.form.modal, self.excitation, [step])[0]
        return step_failure(self._step_text(step), self.form, error, x)

    def _step_text(self, step: int) -> str:
        """Text with number and time of a step, and the path coordinates; the start has no number."""
        number = f"step {step}, " if step else ""
        return f"{number}t = {self.t[step]:g} s{path_text(tuple(self.excitation.paths), self.excitation.s[step])}"


def remove_pull(multipliers: Array, pushing: NDArray[np.bool_]) -> None:
    """Set negative forces in `multipliers` (T, m) in N to zero, in place, for contacts that only push.

    `pushing` (m,) is true for these contacts.  A negative force of such a contact is only the round-off of larger
    forces.
    """
    np.maximum(multipliers, np.where(pushing, 0.0, -np.inf), out=multipliers)


def simulate(
    system: System,
    excitation: Excitation,
    initial: Mapping[str, InitialState] | None = None,
    progress: Progress | None = None,
    every: int = 1,
) -> SystemTrajectory:
    """Simulate all bodies from t = 0 on, and return the trajectory of each `every`-th step.

    Arguments and errors as `pmr.simulation.SystemSimulator`.  `progress`, if not None, is called with the share of the
    run that is done.  The trajectory's `seconds` are the wall time of the steps in modal coordinates, without
    diagonalisation and transformation to q.
    """
    return simulate_form(SystemForm.of(system), excitation, initial, progress, every)


def simulate_form(
    form: SystemForm,
    excitation: Excitation,
    initial: Mapping[str, InitialState] | None = None,
    progress: Progress | None = None,
    every: int = 1,
) -> SystemTrajectory:
    """Simulate a system in modal form, and record every `every`-th step; simulations can share the kernel of `form`.

    If `initial` is None, the simulation starts as ``excitation.start`` says; `progress`, if not None, is called with
    the share of the run that is done.  The errors are those of `simulate`.
    """
    recorder = Recorder(np.arange(0, excitation.stepping.steps + 1, every))
    return recorder.trajectory(follow(March(form, excitation, initial), recorder, progress))


def follow(
    march: March, take: Callable[[int, SystemTrajectory], None], progress: Progress | None = None
) -> SimulationEnd:
    """Take all steps of `march`, some thousand at a time; nothing is stored.

    ``take(first, part)`` is called for blocks of consecutive steps: `first` is the number of the first step, and `part`
    is the trajectory of the block.  The first step of a block repeats the last one of the block before; in the first
    block it is the start.  The arrays are valid until the next call.  If contacts only push, a step may be divided
    (`pmr.simulation.contact_step`); the trajectory has the states at the ends of whole steps.  `progress`, if not None,
    is called with the share of the run that is done.  Errors as `pmr.simulation.SystemSimulator`; the error of a
    growing motion is raised at the end.
    """
    return march.run(lambda first, steps: take(first, _trajectory(march, first, steps)), progress)


def _trajectory(march: March, first: int, steps: Steps, every: int = 1, modal: bool = False) -> SystemTrajectory:
    """Trajectory of recorded `steps`, each `every`-th one of `march`; `first` is the number of the first record.

    The coordinates are those of the bodies, or the kernel's if `modal`.
    """
    form, P, i = march.form, march.form.kernel.paths, march.form.kernel.inputs
    to_original = form.combined.original_forces
    rows = slice(first * every, (first + len(steps.z) - 1) * every + 1, every)
    states = {
        name: (z, v) if modal else (z @ form.forms[name].X.T, v @ form.forms[name].X.T)
        for name, at in form.columns.items()
        for z, v in [(steps.z[:, at], steps.v[:, at])]
    }
    return SystemTrajectory.from_states(
        form.system,
        march.t[rows],
        states,
        march.x[rows],
        to_original(steps.multipliers),
        None if steps.peaks is None else to_original(steps.peaks),
        steps.energy.T,
        steps.friction,
        loads=steps.drivers[:, P : P + i],
        seconds=0.0,
        surplus=np.nan,
        parts=np.ones(len(steps.z), np.int64) if steps.parts is None else steps.parts.astype(np.int64),
        impulses=None if steps.impulses is None else to_original(steps.impulses),
        amplitudes=steps.drivers[:, P + i : P + i + len(form.system.terms)] if form.system.terms else None,
        rates=march.excitation.rates[rows],
        hoist=steps.hoist,
    )


def observe(
    form: SystemForm, excitation: Excitation, outputs: Sequence[int] | None = None, every: int = 1
) -> Observation:
    """Simulate `form` from the excitation's start; record outputs and contact forces of each `every`-th step alone.

    `outputs` are ascending numbers among the outputs of all bodies, one body after the other; None records all.
    `every` is at most the number of steps.  A long simulation of a large body needs little memory, because no
    coordinates are stored.  The energy balance of `simulate` is not checked: rigid rows that move may grow unnoticed
    with rho_inf near 1 (docs/time_integration.md).  Errors as `pmr.simulation.SystemSimulator`.
    """
    march, count = March(form, excitation), excitation.stepping.steps // every + 1
    y = np.empty((count, len(form.system.output_names if outputs is None else outputs)))
    forces, output_seconds = np.empty((count, len(form.system.contacts))), 0.0

    def record_outputs(first: int, steps: Steps) -> None:
        """Compute and store outputs and contact forces of the records `steps`, from the record number `first` on."""
        nonlocal output_seconds
        clock, rows = perf_counter(), slice(first, first + len(steps.z))
        part = _trajectory(march, first, steps, every, modal=True)
        y[rows], forces[rows] = np.hstack([*displacements(form.in_modes, part, outputs).values()]), part.forces
        output_seconds += perf_counter() - clock

    seconds = march.observe(every, record_outputs)
    return Observation(march.t[::every], y, forces, seconds + output_seconds)
