"""One simulation of a system: its start, the compiled steps, why they failed, and where its energy comes from."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from pmr.errors import SimulationError
from pmr.scene.simulators import refuse
from pmr.simulation import balance, contact_step
from pmr.simulation.blocks import Ended, in_blocks
from pmr.simulation.excitation import Excitation, in_order, on_path, places, rates_of_places
from pmr.simulation.native import loop as kernel
from pmr.simulation.native.arrays import ROW, Drive, Record, V, Z
from pmr.simulation.native.building import loop_of
from pmr.simulation.native.form import SystemForm
from pmr.simulation.native.handles import handle
from pmr.simulation.native.part import Loop
from pmr.simulation.native.parts import COARSE
from pmr.simulation.native.scheme import GeneralizedAlpha
from pmr.simulation.native.start import Onset, begin, places_of, reason
from pmr.simulation.native.term_arrays import signals
from pmr.simulation.needs import needs_of
from pmr.simulation.start import InitialState
from pmr.simulation.stepping import Progress
from pmr.system.assembly import Assembly
from pmr.system.body import Trajectory
from pmr.system.friction import Friction

Array = NDArray[np.float64]
#: Steps between two looks at the clock, the keyboard and the progress; fewer where steps in parts take long.  The way
#: into compiled code and cold caches take some 40 us, a seventh of 4096 steps of a body of six coordinates.
BLOCK = 16384
#: Steps for which paths and loads are evaluated at once where they are made in parts: at so many times, of so many
#: steps at least.  Fewer take as long.
TIMES, FINE = 2048, 64
#: Numbers that are recorded in the meantime: fewer steps where there are more coordinates.
RECORDED = 2**22


@dataclass(frozen=True)
class Steps:
    """Some steps in a row; the first of them is the last of those before, or the start."""

    first: int  # number of the first one
    t: Array  # (T,) s
    record: Record  # in modal coordinates; its arrays are valid until the next steps: what is kept is to be copied
    s: Array  # (T, P) m
    f: Array  # (T, i) N
    stored: Array  # (T,) J
    work: Array  # (T,) J: since the start

    def at(self, rows: NDArray[np.int64] | slice) -> Steps:
        """Some of them, by their numbers from the first one on."""
        t, s, f, stored, work = (one[rows] for one in (self.t, self.s, self.f, self.stored, self.work))
        return Steps(self.first, t, some(self.record, rows), s, f, stored, work)


class March:
    """One simulation; arguments and errors as for `pmr.simulation.SystemSimulator`.

    Amplitudes of terms (., K) that others are multiples of are found by those of the excitation, or by `amplitudes`;
    `omega` in rad/s is that of contacts that only push, by default on the excitation's way.
    """

    def __init__(
        self,
        form: SystemForm,
        excitation: Excitation,
        initial: Mapping[str, InitialState],
        amplitudes: Array | None = None,
        omega: float | None = None,
    ) -> None:
        system, stepping = form.system, excitation.stepping
        self.form, self.system, self.t, self.body = form, system, excitation.times, form.on_tables
        if self.body is not None and excitation.paths:
            excitation.along(self.body.domain)  # refused in its own words
        self.x, self._paths = places(system, excitation), tuple(excitation.paths)
        parts: tuple[int, ...] = (1,)
        self.pushing, asked = ~np.isnan(form.modal.clearance), bool(stepping.parts or stepping.schedule)
        if asked or not self.pushing.any():
            omega = 0.0
        elif omega is None:
            omega = contact_step.contact_frequency(form.modal, excitation)
        if self.pushing.any():
            parts = contact_step.levels(omega, stepping)
        given = np.searchsorted(parts, stepping.schedule) if stepping.schedule else np.full(stepping.steps, -1)
        self.finest, self._given, self._sampling = parts[-1], given.astype(np.int64), 0.0
        sizes = excitation.amplitudes(system.term_names) if amplitudes is None else amplitudes
        self._numbers, self._mix, matrices = signals(form, sizes)
        self._path, self._loads = tuple(excitation.paths.values()), in_order(excitation.loads, system.input_names)
        self._terms = [in_order(excitation.terms, system.term_names, "term")[k] for k in self._numbers]
        self._fine_step = stepping.divided(self.finest).step
        self._drive = s, f, c = self._sampled(0, stepping.steps, 1)
        methods = [GeneralizedAlpha(stepping.divided(count).step, stepping.rho_inf) for count in parts]
        x = places(form.modal, excitation)
        rows = Assembly(form.modal).at(x[0])
        needs = needs_of(form.modal, np.all(rows.F == 0.0, axis=1), x, stepping.rho_inf)
        refuse("march", needs)
        self._growing = list(needs.rigid_moving)  # nothing damps their forces
        x_rate = rates_of_places(system, excitation)
        self.onset = onset = Onset(self._paths, s[0], self.x[0], x_rate, rows, f[0], initial, c[0])

        def begun() -> Loop:  # without a reference to itself, so that what it holds is free at once
            loop = loop_of(form, methods, parts, omega, onset.paths, matrices)
            begin(loop, form, methods[0], onset)
            return loop

        self._begun, self.loop, self._friction = begun, begun(), Friction.of(form.modal.contacts)
        self._account = None if self.body is None else balance.Account(self.body, stepping.steps)
        self._stored, self._work = np.zeros(len(self.t)), np.zeros(len(self.t))
        self._sampling = 0.0  # s, of the steps that follow

    @property
    def f(self) -> Array:
        """Loads (T, i) in N at the steps."""
        return self._drive[1]

    @property
    def s(self) -> Array:
        """Path coordinates (T, P) in m at the steps."""
        return self._drive[0]

    def mixed(self, c: Array) -> Array:
        """Amplitudes (J,) as the loop takes them, from those of all terms (K,), without friction."""
        return np.asarray(self._mix @ c[self._numbers])

    def outputs_at(self, s: Mapping[str, float], f: Array) -> Array:
        """Theirs (o,) of the present state where the paths lead to s m: O q + W f - X lambda."""
        assembly, state = Assembly(self.form.modal), self.loop.state
        moved = assembly.outputs @ state.modes[Z, self.form.used] + assembly.direct @ f
        x = self.form.modal.coordinates(s)
        found = np.asarray(moved - assembly.at(x).X @ state.multipliers)
        if self._friction is not None:
            found += assembly.turned(x) @ self._friction.moments(self.friction, state.multipliers)
        return found

    @property
    def friction(self) -> Array:
        """Of the pads that rub, (n,) N along the boom, at present; none without any."""
        return np.zeros(0) if self._friction is None else self.loop.terms.rubbing.forces.copy()

    @property
    def forces(self) -> Array:
        """Of all contacts, (m,) N, at present."""
        friction = None if self._friction is None else self.friction
        return self.form.forces(self.loop.state.multipliers.copy(), friction)

    @property
    def loop(self) -> Loop:
        """The simulation, and where it stands."""
        return self._handle.kept[0]

    @loop.setter
    def loop(self, loop: Loop) -> None:
        self._handle = handle(loop)

    def failed(self, number: int, where: str) -> SimulationError:
        """Why the compiled loop stopped, from what it returned."""
        why = reason(self.form.modal, self.loop.state.modes[ROW:], number)
        return SimulationError(f"march failed at {where}: {why}")

    def run(self, take: Callable[[Steps], None], progress: Progress | None = None) -> Ended:
        """Take all steps; `take` gets some of them at a time.

        A GrowthError is raised where more than `balance.GROWN` of the largest energy comes from nowhere.
        """

        def taken(first: int, rows: Record) -> None:
            take(self._steps(first, first + len(rows.multipliers), rows))

        seconds = self.observe(1, taken, progress)
        least = balance.round_off(self.form.modes.B @ self.form.modes.B.T, self.f, float(self.t[1]))
        surplus = balance.surplus(self._stored, self._work, least, since_start=bool(self.pushing.any()))
        balance.refuse_growth(surplus, "march", self._growing)
        return Ended(seconds, surplus)

    def again(self) -> float:
        """Take all steps once more from the start, as `run` does, and keep nothing: the solver's seconds."""
        self.loop, self._sampling = self._begun(), 0.0
        return self.observe(1, lambda first, rows: None)

    def observe(self, every: int, take: Callable[[int, Record], None], progress: Progress | None = None) -> float:
        """Take all steps; `take` gets each `every`-th, some of them at a time, and the number of the first among these.

        That is the last one of those before, or the start.  The solver's seconds; energy is not checked.
        """
        count = (len(self.t) - 1) // every
        most = max(1, min(BLOCK // every, RECORDED // (2 * len(self.form.used)), count))
        room = self._room(most + 1)

        def advance(first: int, last: int) -> None:
            self._take((first - 1) * every + 1, some(room, slice(1, last - first + 1)), every)
            if last == 1 and room.energy is not None:  # that of the start, which the loop finds
                room.energy[:] = self.loop.sides.energy

        def taken(first: int, last: int) -> None:
            rows = self._known(some(room, slice(last - first + 1)))
            self._check_finite(rows.z, first - 1, every)
            for forces in (rows.multipliers, rows.peaks):
                if forces is not None:
                    without_pull(forces, self.pushing)
            take(first - 1, rows)
            for begun, ended in zip(some(room, slice(1)), some(rows, slice(-1, None)), strict=True):
                if ended is not None:
                    begun[:] = ended

        return in_blocks(count + 1, most, self.finest, advance, taken, progress) - self._sampling

    def steps_of(self, rows: slice, every: int) -> slice:
        """Numbers of the steps that such rows are of."""
        return slice(rows.start * every, (rows.stop - 1) * every + 1, every)

    def _take(self, first: int, rows: Record, every: int) -> None:
        """Take steps from number `first` on, as many as there is room for."""
        count, taken = every * len(rows.multipliers), 0
        while True:  # once where no step is taken, too: so it is compiled before the clock runs
            begun, per = first - 1 + taken, self._parts_of(first - 1 + taken)
            end = first - 1 + (count if per == 1 else min(count, taken + max(FINE, TIMES // per)))
            s, f, c = self._sampled(begun, end, per) if per > 1 else (one[begun : end + 1] for one in self._drive)
            drive = Drive(s, f, given=self._given[begun:end], c=c, per=per, peaks=rows.peaks)
            if self.loop.levels is None:
                drive = drive._replace(given=None, c=None)
            taken, failed = kernel.run(self._handle, handle(drive), handle(rows), every, taken)
            if failed and failed != COARSE:
                raise self.failed(failed, self._where(first + taken) if count else self._start)
            if taken == count:
                return

    def _parts_of(self, step: int) -> int:
        """In how many parts a step is tried first."""
        if self.finest == 1:
            return 1
        level = self._given[step]
        return int(self.loop.levels.parts[level if level >= 0 else self.loop.control.level[0]])

    def _sampled(self, first: int, last: int, per: int) -> tuple[Array, Array, Array]:
        """Paths (., P) m, loads (., i) N and amplitudes (., J) of some steps, at `per` parts of each.

        To evaluate them takes far longer than a step, so it is done for those steps alone that are made in parts.
        """
        begun = perf_counter()
        t = np.arange(first * self.finest, last * self.finest + 1, self.finest // per) * self._fine_step
        nothing = np.empty((len(t), 0))
        s, f, c = (
            np.column_stack([nothing, *(one.value(t) for one in signals)])
            for signals in (self._path, self._loads, self._terms)
        )
        c = c @ self._mix.T
        if self.body is not None:  # a body that nothing moves has one place all the same
            domain = self.body.domain
            s = on_path(self._path[0], s[:, 0], domain, t)[:, None] if self._path else np.full((len(t), 1), domain[0])
        self._sampling += perf_counter() - begun
        return s, f, c

    def _steps(self, first: int, last: int, rows: Record) -> Steps:
        """Steps `first` to `last`, the latter excluded, with their energies."""
        at = slice(first, last)
        s, f = self.s[at], self.f[at]
        if rows.energy is not None:
            self._stored[at], self._work[at] = rows.energy.T
        if self._account is not None:
            assert rows.z is not None and rows.v is not None
            self._account.add(first, Trajectory(self.t[at], rows.z, rows.v, rows.multipliers, s[:, 0], 0.0), f)
            self._stored[at], self._work[at] = self._account.stored[at], self._account.work[at]
        if rows.given is not None:
            self._work[at] += rows.given
        return Steps(first, self.t[at], rows, s, f, self._stored[at], self._work[at])

    def _room(self, size: int) -> Record:
        """Room for so many steps, the first of which is the start."""
        m, r, state, loop = len(self.pushing), int(self.form.used[-1]) + 1, self.loop.state, self.loop
        return Record(
            z=np.tile(state.modes[Z, :r], (size, 1)),
            v=np.tile(state.modes[V, :r], (size, 1)),
            multipliers=np.tile(state.multipliers, (size, 1)),
            **({} if loop.levels is None else self._room_beside(size, m if self.pushing.any() else 0)),
        )

    def _room_beside(self, size: int, m: int) -> dict[str, Array | None]:
        """Of m contacts where some only push; without entries where nothing is known."""
        loop, pads = self.loop, 0 if self._friction is None else len(self._friction.pads)
        return {
            "peaks": np.tile(loop.state.multipliers[: m if self.finest > 1 else 0], (size, 1)),
            "parts": np.ones(size, np.int64),
            "impulses": np.zeros((size, m)),
            "energy": None if loop.sides is None else np.tile(loop.sides.energy, (size, 1)),
            "given": np.zeros(size),
            "friction": None if loop.terms.rubbing is None else np.zeros((size, pads)),
        }

    def _known(self, rows: Record) -> Record:
        """Without what nothing is known of."""
        pushing, finest = self.pushing.any(), self.finest
        return rows._replace(
            peaks=rows.peaks if finest > 1 else None,
            parts=rows.parts if finest > 1 else None,
            impulses=rows.impulses if pushing else None,
            friction=None if self._friction is None else rows.friction,
        )

    def _check_finite(self, recorded: Array, first: int, every: int) -> None:
        """Raise SimulationError at the first row that is not finite; row 0 is step `first` times `every`."""
        finite = np.isfinite(recorded).all(axis=1)
        if not finite.all():
            where = self._where((first + int(np.argmin(finite))) * every)
            raise SimulationError(f"march failed at {where}: not finite")

    @property
    def _start(self) -> str:
        return f"t = 0 s{places_of(self._paths, self.s[0])}"

    def _where(self, step: int) -> str:
        return f"step {step}, t = {self.t[step]:g} s{places_of(self._paths, self.s[step])}"


def some(record: Record, rows: NDArray[np.int64] | slice) -> Record:
    """Some rows of a record."""
    return Record._make(None if array is None else array[rows] for array in record)


def without_pull(multipliers: Array, pushing: NDArray[np.bool_]) -> None:
    """Rows that only push have round-off of the others' forces at most where they let go: none."""
    multipliers[:, pushing] = np.maximum(multipliers[:, pushing], 0.0)
