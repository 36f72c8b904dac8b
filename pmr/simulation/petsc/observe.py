"""Full-order simulations: run the integrator and record selected quantities."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from pmr.errors import SimulationError
from pmr.fem.factor import factor_of
from pmr.fullmodel.model import FullSystem
from pmr.scene.choice import REFERENCE, refuse_unsupported
from pmr.simulation.balance import refuse_growth
from pmr.simulation.contact_step import StepParts
from pmr.simulation.excitation import Excitation, side_positions
from pmr.simulation.petsc.checkpoint import Checkpoint, CheckpointFile, ReachedState, identity
from pmr.simulation.petsc.constraint import ContactState
from pmr.simulation.petsc.integrate import DividedSteps, Stepped, contact_frequency
from pmr.simulation.petsc.recorder import History, Recorder, Recording
from pmr.simulation.petsc.rows import BlockFactor
from pmr.simulation.petsc.start import SampledExcitation, State, starting_state, starts_moving
from pmr.simulation.refusals import needs_of
from pmr.simulation.start import InitialState
from pmr.simulation.stepping import Progress
from pmr.system.contacts import friction_joints

#: How many times progress is reported.
REPORTS = 1000


def observe(
    system: FullSystem,
    excitation: Excitation,
    recording: Recording | None = None,
    initial: Mapping[str, InitialState] | None = None,
    progress: Progress | None = None,
    checkpoint: Checkpoint | None = None,
) -> History:
    """Simulate full models and return the history of recorded quantities; collective.

    Parameters
    ----------
    system : FullSystem
        System with a positive definite M; `FullSystem.of` makes one of a single model.
    excitation : Excitation
        The system's paths, by name, a load for each ``body.input``, and an amplitude for each term.
    recording : Recording, optional
        By default all outputs at all steps.
    initial : mapping of str to InitialState, optional
        Initial state of each body, with all its n coordinates, on every rank; bodies that are missing start at rest,
        undeformed.  `pmr.simulation.petsc.start.static_start` returns states in equilibrium.
    progress : callable, optional
        As for `pmr.simulation.SystemSimulator`.
    checkpoint : Checkpoint, optional
        If its file exists, the simulation resumes from it, with the parts of steps with which it began.  On one rank
        the result is the same to the last digit as without interruption; on several ranks it differs by round-off,
        since MUMPS adds up messages in the order of their arrival.

    Raises
    ------
    InputError
        If a path leaves the range of a row, a load is missing, the initial position violates a row, rigid rows move
        with rho_inf = 1, a rigid row only pushes, or the checkpoint belongs to another simulation.
    SimulationError
        If a step fails; with step, time, path coordinates and, where rows depend on each other, their names.  Where
        energies are recorded at every step, also if the motion grows without bound.
    """
    run = _Run(system, excitation, recording or Recording(), initial or {})
    return run.history(progress, checkpoint)


class _Run:
    """One simulation: its excitation on the time grid, the parts of its steps, and its start."""

    def __init__(
        self, system: FullSystem, excitation: Excitation, recording: Recording, initial: Mapping[str, InitialState]
    ) -> None:
        self._begin, self._contacts = time.perf_counter(), len(system.contacts)
        self._system, self._initial, self._excitation = system.with_supports(), initial, excitation
        self._at = sample_excitation(self._system, excitation)
        self._needs = needs_of(self._system, self._system.compliance.rigid, self._at.x, excitation.stepping.rho_inf)
        refuse_unsupported("petsc", self._needs, REFERENCE)
        self._recorder = Recorder(self._system, excitation.stepping, recording)
        self._mass, omega = None, 0.0
        if self._needs.pushing_rows or starts_moving(self._system, self._at, initial):
            self._mass = BlockFactor(self._system, lambda model: factor_of(model.M, "M"))
        if self._needs.pushing_rows and self._mass is not None:
            omega = contact_frequency(self._system, self._at.x, self._mass)
        self._lengths = StepParts.for_contacts(excitation.stepping, omega)

    def history(self, progress: Progress | None, checkpoint: Checkpoint | None) -> History:
        """Take all steps, or the steps after a checkpoint, and return the history."""
        recorder, keeper, T = self._recorder, None, self._excitation.stepping.steps
        if checkpoint:
            run_identity = identity(self._system, self._excitation, self._at, recorder, self._initial)
            keeper = CheckpointFile(checkpoint, self._system, run_identity)
        checkpointed = keeper.load(recorder) if keeper else None
        reached = checkpointed or self._starting_state()
        steps = self._steps(reached, checkpointed is not None)
        preparation, begin = time.perf_counter() - self._begin, time.perf_counter()
        stride, state = max(1, T // REPORTS), reached.state
        for step in range(reached.step + 1, T + 1):
            state, due = self._step(steps, step, state, keeper is not None and keeper.due())
            recorder.record(step, state, steps.rows, self._at)
            if keeper and (due or step == T):
                seconds = reached.seconds + time.perf_counter() - begin
                keeper.save(replace(reached, step=step, seconds=seconds, state=state), recorder)
            if progress is not None and (step % stride == 0 or step == T):
                progress(step / T)
        seconds = reached.seconds + time.perf_counter() - begin
        steps.destroy()
        history = recorder.history(self._at, seconds, preparation)
        refuse_growth(history.surplus, "full order", list(self._needs.rigid_moving_rows))
        m, forces, peaks = self._contacts, history.forces, history.peaks
        return replace(history, forces=forces[:, :m], peaks=peaks[:, :m], supports=forces[:, m:])

    def _starting_state(self) -> ReachedState:
        """State at t = 0."""
        state = starting_state(self._system, self._at, self._initial, self._mass)
        return ReachedState(0, 0.0, state, self._lengths.parts)

    def _steps(self, reached: ReachedState, resumed: bool) -> DividedSteps:
        """Integrator of the steps from the reached state on, with the numbers of parts chosen at the beginning.

        The start is recorded, unless the run is `resumed` from a checkpoint.
        """
        system, recorder, state, mass = self._system, self._recorder, reached.state, self._mass
        lengths = replace(self._lengths, parts=reached.parts)
        fine, begun = self._at, reached.step * lengths.finest
        if lengths.finest > 1:
            fine = sample_excitation(system, self._excitation.with_stepping(lengths.stepping.divide(lengths.finest)))
        if mass is not None and not self._needs.pushing_rows:
            mass.destroy()
            mass = None
        steps = DividedSteps(system, lengths, fine, ContactState(system, mass, state), reached.step)
        recorder.follow(state, steps.rows, fine.x[begun], fine.f[begun], fine.c[begun])
        if resumed:
            recorder.forget()
        else:
            recorder.record(0, state, steps.rows, self._at)
        return steps

    def _step(self, steps: DividedSteps, step: int, state: State, due: bool) -> Stepped:
        """Take step number `step` in all parts that `steps` makes; return the state, and whether a checkpoint is due.

        A checkpoint is due if it is on any rank.  A SimulationError is raised with step, time and path coordinates.
        """
        try:
            return steps.step(step, state, due, self._recorder)
        except SimulationError as error:
            travelled = zip(self._excitation.paths, self._at.s[step], strict=True)
            at = ", ".join(f"{name} at {s:g} m" for name, s in travelled)
            where = ", ".join(part for part in (f"step {step}", f"t = {self._at.t[step]:g} s", at) if part)
            raise SimulationError(f"full-order simulation failed at {where}: {error}") from None


def sample_excitation(system: FullSystem, excitation: Excitation) -> SampledExcitation:
    """Sample the excitation at t = 0 and at the end of each step.

    The result holds paths, positions and rates of sides, and loads.  Its amplitudes are those of the system's terms,
    followed by the path coordinates of joints with friction.

    Raises
    ------
    InputError
        If a path, load or amplitude of a term is missing, or a path takes a side where its row is not defined.
    """
    names, x = list(excitation.paths), side_positions(system, excitation)
    rates = np.broadcast_to(system.side_rates(dict(zip(names, excitation.rates.T, strict=True))), x.shape)
    f, c = excitation.forces(system.input_names), excitation.amplitudes(system.term_names)
    c = np.column_stack([c, *(excitation.s[:, names.index(joint)] for joint in friction_joints(system.contacts))])
    return SampledExcitation(excitation.times, excitation.s, x, rates, f, c)
