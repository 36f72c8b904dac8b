"""Full-order simulations, of one body or of a system of them: what runs the integrator and keeps what is asked for."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.errors import SimulationError
from pmr.fem.factor import factor_of
from pmr.fullmodel.model import FullModel
from pmr.fullmodel.system import BODY, FullSystem
from pmr.scene.simulators import REFERENCE, Needs, refuse
from pmr.simulate import contact_step
from pmr.simulate.balance import refuse_growth
from pmr.simulate.excitation import Excitation
from pmr.simulate.native.multibody_march import places
from pmr.simulate.native.scheme import GeneralizedAlpha
from pmr.simulate.petsc.checkpoint import Checkpoint
from pmr.simulate.petsc.constraint import compliances, paths
from pmr.simulate.petsc.effective import BlockFactor
from pmr.simulate.petsc.history import History, Recording, SystemHistory
from pmr.simulate.petsc.integrate import Integrator
from pmr.simulate.petsc.pushing import Pushing
from pmr.simulate.petsc.recorder import Recorder, Sampled
from pmr.simulate.petsc.resume import Keeper, identity
from pmr.simulate.petsc.rows import PathCompliance
from pmr.simulate.petsc.start import Onset, State, moves_at_once, starting_state
from pmr.simulate.start import InitialState
from pmr.simulate.stepping import Progress

Array = NDArray[np.float64]

#: How often progress is told.
TOLD = 1000


def observe(
    model: FullModel,
    excitation: Excitation,
    recording: Recording | None = None,
    initial: InitialState | None = None,
    progress: Progress | None = None,
    checkpoint: Checkpoint | None = None,
) -> History:
    """Simulate a full model and keep what is recorded; collective.

    Parameters
    ----------
    model : FullModel
        M positive definite.
    excitation, initial, progress
        As for `pmr.simulate.Simulator`; the initial state is whole, (n,), on every rank.
    recording : Recording, optional
        By default all outputs at all steps.
    checkpoint : Checkpoint, optional
        If its file exists, the simulation goes on from there.  On one rank the result is the same to the last digit
        as without interruption; on several as far as MUMPS adds up messages in the order of their arrival.

    Raises
    ------
    InputError
        If the path leaves the rows' domain, a load is missing, the initial position violates a row, rigid rows move
        with rho_inf = 1 or only push, or the checkpoint is not of this simulation.
    SimulationError
        If a step fails; with step, time, slider position and, where rows depend on each other, their names.  Where
        energies are recorded at every step, also if the motion grows without bound.
    """
    excitation.along(model.rows.domain if model.rows.rows else (-np.inf, np.inf))
    excitation.forces(model.input_names)
    loads = {f"{BODY}.{name}": load for name, load in excitation.loads.items()}
    system, start = FullSystem.of(model, next(iter(excitation.paths))), {} if initial is None else {BODY: initial}
    found = observe_system(system, replace(excitation, loads=loads), recording, start, progress, checkpoint)
    states = found.states[BODY]
    return History(
        t=found.t,
        s=found.s[:, 0],
        y=found.y[BODY],
        multipliers=found.forces,
        residual_position=found.residual_position,
        residual_velocity=found.residual_velocity,
        energy=found.energy,
        states=replace(states, s=states.s[:, 0]),
        seconds=found.seconds,
        preparation=found.preparation,
        surplus=found.surplus,
        peaks=None if np.isnan(system.clearance).all() else found.peaks,
    )


def observe_system(
    system: FullSystem,
    excitation: Excitation,
    recording: Recording | None = None,
    initial: Mapping[str, InitialState] | None = None,
    progress: Progress | None = None,
    checkpoint: Checkpoint | None = None,
) -> SystemHistory:
    """Simulate full models that contacts join; arguments, errors and what is collective as of `observe`.

    Parameters
    ----------
    excitation : Excitation
        The system's paths, by name, and a load for each ``body.input``.
    initial : mapping of str to InitialState, optional
        Of each body, whole, on every rank; those that are missing start at rest, undeformed.  `static_start` gives one.
    """
    run = _Run(system, excitation, recording or Recording(), initial or {})
    return run.history(progress, checkpoint)


@dataclass(frozen=True)
class _Prepared:
    """What takes the steps, and from where: step number, wall time so far, state."""

    integrator: Integrator
    first: int
    earlier: float
    state: State


class _Run:
    """One simulation: its excitation on the time grid and on the parts of its steps, and its start."""

    def __init__(
        self, system: FullSystem, excitation: Excitation, recording: Recording, initial: Mapping[str, InitialState]
    ) -> None:
        self._begin, self._contacts = time.perf_counter(), len(system.contacts)
        self._system, self._initial = system.supported(), initial
        self._stepping, self._names = excitation.stepping, tuple(excitation.paths)
        self._at = sampled(self._system, excitation)
        self._needs = _needs(self._system, excitation, self._at)
        refuse("petsc", self._needs, REFERENCE)
        self._recorder = Recorder(self._system, self._stepping, recording)
        onset = Onset(self._at.x[0], self._at.rates[0], self._at.f[0])
        pushes = bool(self._needs.pushing)
        self._mass = None
        if pushes or moves_at_once(self._system, onset, initial):
            self._mass = BlockFactor(self._system, lambda model: factor_of(model.M, "M"))
        self._parts, self._fine = 1, self._at
        if pushes:
            self._parts = contact_step.parts(self._contact_frequency(), self._stepping)
            fine = excitation.with_stepping(self._stepping.divided(self._parts))
            self._fine = self._at if self._parts == 1 else sampled(self._system, fine)
        self._method = GeneralizedAlpha(self._stepping.divided(self._parts).step, self._stepping.rho_inf)
        self._onset = onset

    def history(self, progress: Progress | None, checkpoint: Checkpoint | None) -> SystemHistory:
        """Take all steps that a checkpoint has not."""
        stepping, recorder, keeper = self._stepping, self._recorder, None
        if checkpoint:
            told = identity(self._system, self._fine, stepping, recorder, self._initial)
            keeper = Keeper(checkpoint, self._system, told)
        ready = self._prepared(keeper)
        integrator, state = ready.integrator, ready.state
        preparation, begin = time.perf_counter() - self._begin, time.perf_counter()
        stride = max(1, stepping.steps // TOLD)
        for step in range(ready.first + 1, stepping.steps + 1):
            state, due = self._step(integrator, step, state, keeper is not None and keeper.due())
            recorder.record(step, state, integrator.constraint.rows, self._at)
            if keeper and (due or step == stepping.steps):
                keeper.save(step, ready.earlier + time.perf_counter() - begin, state, recorder)
            if progress is not None and (step % stride == 0 or step == stepping.steps):
                progress(step / stepping.steps)
        seconds = ready.earlier + time.perf_counter() - begin
        integrator.destroy()
        found = recorder.history(self._at, seconds, preparation)
        refuse_growth(found.surplus, "full order", list(self._needs.rigid_moving))
        m = self._contacts
        return replace(found, forces=found.forces[:, :m], peaks=found.peaks[:, :m], supports=found.forces[:, m:])

    def _prepared(self, keeper: Keeper | None) -> _Prepared:
        system, fine, recorder = self._system, self._fine, self._recorder
        found = keeper.load(recorder) if keeper else None
        first, earlier, state = found or (0, 0.0, starting_state(system, self._onset, self._initial, self._mass))
        rows = paths(system, fine.x, first * self._parts)
        pushing = None
        if self._mass is not None and self._needs.pushing:
            pushing = Pushing(system, self._method, state, self._mass)
        elif self._mass is not None:
            self._mass.destroy()
        integrator = Integrator(system, self._method, rows, pushing)
        begun = first * self._parts
        if found:
            recorder.resume(state, rows, fine.x[begun], fine.f[begun])
        else:
            recorder.follow(state, rows, fine.x[0], fine.f[0])
            recorder.record(0, state, rows, self._at)
        return _Prepared(integrator, first, earlier, state)

    def _step(self, integrator: Integrator, step: int, state: State, due: bool) -> tuple[State, bool]:
        """A step in all its parts; whether any rank is due for a checkpoint."""
        for part in range((step - 1) * self._parts + 1, step * self._parts + 1):
            try:
                state, due = integrator.step(part, state, self._fine.f[part], due)
            except SimulationError as error:
                travelled = zip(self._names, self._at.s[step], strict=True)
                at = ", ".join(f"{name} at {s:g} m" for name, s in travelled)
                where = ", ".join(part for part in (f"step {step}", f"t = {self._at.t[step]:g} s", at) if part)
                raise SimulationError(f"full-order simulation failed at {where}: {error}") from None
            self._recorder.follow(state, integrator.constraint.rows, self._fine.x[part], self._fine.f[part])
        return state, due

    def _contact_frequency(self) -> float:
        """Largest omega in rad/s of the contacts that only push, along the paths."""
        system, largest = self._system, 0.0
        pushing = np.flatnonzero(~np.isnan(system.clearance))
        assert self._mass is not None
        steps = np.unique(np.linspace(0, len(self._at.x) - 1, contact_step.PLACES).astype(int))
        rows = paths(system, self._at.x[steps])
        mobility = PathCompliance(compliances(system, self._mass, rows.visited), rows)
        F = np.diag(system.compliance[pushing])
        for k in range(len(steps)):
            rows.move(k)
            found = mobility.of_rows(rows)[np.ix_(pushing, pushing)]
            largest = max(largest, contact_step.frequency(F, found))
        return float(system.comm.bcast(largest))


def sampled(system: FullSystem, excitation: Excitation) -> Sampled:
    """The excitation at the steps.

    Raises
    ------
    InputError
        If a path or load is missing, or takes a side where its row is not defined.
    """
    names, sides = list(excitation.paths), system.sides
    rates = np.zeros((len(excitation.times), len(sides)))
    for k, side in enumerate(sides):
        if side.place.path in names:
            rates[:, k] = side.place.rate * excitation.rates[:, names.index(side.place.path)]
    x = places(system, excitation)
    return Sampled(excitation.times, excitation.s, x, rates, excitation.forces(system.input_names))


def _needs(system: FullSystem, excitation: Excitation, at: Sampled) -> Needs:
    """What the contacts ask of a simulator."""
    travelling = {side.contact for side, x in zip(system.sides, at.x.T, strict=True) if np.any(x != x[0])}
    rigid, pushing = system.compliance == 0.0, ~np.isnan(system.clearance)
    names = np.array([*system.contact_names, ""])[:-1]  # text, whatever their number
    moving = np.array([k in travelling for k in range(len(names))], bool)
    return Needs(
        pushing=tuple(names[pushing].tolist()),
        rigid_pushing=tuple(names[pushing & rigid].tolist()),
        giving=tuple(names[~rigid].tolist()),
        rigid_moving=tuple(names[rigid & moving].tolist()),
        paths=tuple(excitation.paths),
        rho_inf=excitation.stepping.rho_inf,
    )
