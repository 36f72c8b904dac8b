"""Runs of a system with its time step, half the step, a quarter and so on, and what is compared of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from pmr.compare.errors import ForceHistories, band_limit, clear_round_off, force_histories
from pmr.compare.evaluation import evaluate_motion
from pmr.compare.motion import round_off
from pmr.compare.outputs import (
    Outputs,
    away_from_kinks,
    fits_in_memory,
    outputs_from_columns,
    outputs_of_run,
    run_from_start,
    tip_columns,
    without_kink_forces,
)
from pmr.errors import SimulationError
from pmr.files.arrays import Array
from pmr.results import Response
from pmr.simulation import Excitation, TimeStepping, contact_step
from pmr.simulation.contact_step import contact_frequency
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.stepping import is_aliased
from pmr.system.body import length_outputs
from pmr.system.states import SystemTrajectory, displacements
from pmr.system.system import System

#: Limit on the number of steps of all runs together, for halving the step more than twice.
BUDGET = 300_000

#: The same limit if contacts only push: after an impact, smaller steps settle nothing.
BUDGET_OF_IMPACTS = 50_000

#: Largest number of steps of any run, the first two halvings included.
LONGEST = 4_000_000

#: Largest number of times at which runs are compared.
COMPARED = 20_000

#: Least rho_inf of the runs with shorter steps.  With less, steps damp motions that they don't resolve, so that runs
#: that lack these motions agree; with 1, rows that move can make such motions grow.
UNDAMPED = 0.95


def reference_rho(system: System, rho_inf: float) -> float:
    """Spectral radius rho_inf of the runs with which a run with `rho_inf` is compared: not less than `UNDAMPED`.

    In two cases the result is `rho_inf` itself.  If the system has rows without residual flexibility, motions can grow
    with less damping.  If it has contacts that only push, these would bounce.
    """
    parts = [body if system.on_one_path else body.carriers for body in system.bodies.values()]
    flexible = all(getattr(part, "flexibility", None) is not None for part in parts)
    return max(rho_inf, UNDAMPED) if flexible and np.isnan(system.clearance).all() else rho_inf


@dataclass(frozen=True)
class Sample:
    """Outputs and forces of a run at the T times at which runs are compared."""

    outputs: Outputs
    forces: ForceHistories = field(default_factory=dict)  # from completed responses, without steps near kinks


class SteppedSystem:
    """A system that is simulated with several time steps.

    `run` is the run with the given step; if it is None, it is simulated when it is needed.  `complete`, if it is not
    None, adds to a response the forces that follow from other forces; then all kinds of forces are sampled.

    If contacts only push, the given run chooses the number of parts of each step, unless its time grid sets that number
    or the run is too long to be recorded.  In runs with shorter steps, each half of a given step has as many parts as
    the given run has at most in three steps: this one, the one before and the one after.  So parts become shorter with
    the step, at impacts and between them.
    """

    def __init__(
        self,
        system: System | SystemForm,
        excitation: Excitation,
        run: SystemTrajectory | None = None,
        complete: Callable[[Response], Response] | None = None,
    ) -> None:
        """Prepare runs of the system under the excitation, whose time grid is the given one.

        The given run is simulated at once if it chooses the parts of its steps; otherwise nothing is.  `run` is the run
        on that grid, None if it is still to be simulated.  `complete` adds forces to a response; None adds none.
        """
        self._form, self.excitation, self._given_run, self._complete = SystemForm.of(system), excitation, run, complete
        self.system = system = self._form.system
        self.pushing = not np.isnan(system.clearance).all()
        #: The time grid whose error is to be computed.
        self.given = replace(excitation.stepping, schedule=())
        self.reference_rho = reference_rho(system, self.given.rho_inf)
        #: Displacement in m that may be round-off.
        self.round_off = round_off(system.bodies, excitation.forces(system.input_names), self.given.end)
        #: Numbers of the tip's displacements among all displacements.
        self.tips = tip_columns(system)
        self.moved = np.flatnonzero(np.concatenate([length_outputs(body) for body in system.bodies.values()]))
        chosen = self.pushing and not self.given.parts and fits_in_memory(system, self.given)
        #: The given run if it chose the numbers of parts; else None.
        self.run = self.simulate(self.given) if chosen else None
        self._given_run = self._given_run or self.run
        self._parts = self.given.parts
        if self.pushing and self.run is None:
            self._parts = contact_step.count_parts(contact_frequency(system, excitation), self.given)

    def halved_grid(self, times: int) -> TimeStepping:
        """Time grid of a run with the given step halved `times` times, and with the reference rho_inf.

        If the given run chose its numbers of parts, a shorter step has as many as the given run has at most in three
        steps: the one that contains it, the one before and the one after.  Otherwise all steps have the numbers of
        parts of the given grid; if it has none, those that the contacts need.
        """
        grid, step = self.given, self.given.step / 2**times
        if self.run is None or self.run.parts is None:
            return TimeStepping(grid.end, step, self.reference_rho, self._parts)
        parts = np.pad(self.run.parts[1:], 1, mode="edge")
        most = np.max([parts[:-2], parts[1:-1], parts[2:]], axis=0)
        return TimeStepping(grid.end, step, self.reference_rho, schedule=tuple(np.repeat(most, 2**times).tolist()))

    def simulate(self, stepping: TimeStepping) -> SystemTrajectory:
        """Motion at all steps on the time grid `stepping`, simulated unless it is the given run's motion.

        Raises InputError or SimulationError as for `pmr.simulation.SystemSimulator`.
        """
        if self._given_run is not None and stepping == self.given:
            return self._given_run
        return run_from_start(self._form, self.excitation.on_grid(stepping))

    def displacements(self, run: SystemTrajectory, numbers: list[int] | None = None) -> Array:
        """Displacements (T, o) in m in a run: all if `numbers` is None, else those with these numbers."""
        chosen = self.moved if numbers is None else self.moved[numbers]
        return np.hstack(list(displacements(self.system, run, chosen.tolist()).values()))

    def simulate_displacements(self, stepping: TimeStepping, numbers: list[int] | None = None) -> Array:
        """Displacements (T, o) in m on the time grid `stepping`, without recording anything else.

        All displacements are returned if `numbers` is None, else those with these numbers.  Raises InputError or
        SimulationError as for `pmr.simulation.SystemSimulator`.
        """
        chosen = self.moved if numbers is None else self.moved[numbers]
        return systems.observe(self._form, self.excitation.on_grid(stepping), chosen.tolist()).y

    def record(self, stepping: TimeStepping, rates: bool) -> SystemTrajectory | None:
        """Run on the time grid `stepping`; None if the states of such a run take too much memory.

        Velocities (`rates`) need the states, so that the run is then recorded in any case.
        """
        return self.simulate(stepping) if rates or fits_in_memory(self.system, stepping) else None

    def sample(self, run: SystemTrajectory | None, stepping: TimeStepping, every: int, rates: bool) -> Sample:
        """Sample each `every`-th step of `run`, which `record` returned for the same `stepping`.

        If `run` is None, the system is simulated now and only these steps are stored.  Velocities are sampled if
        `rates` is true.  Displacements that are round-off are set to zero, and so are forces near kinks of extensions.
        Raises InputError or SimulationError as for `pmr.simulation.SystemSimulator`.
        """
        excitation, of_all = self.excitation.on_grid(stepping), ForceHistories()
        if run is not None:
            sampled = outputs_of_run(self.system, run, excitation, every, rates)
            of_all = self._forces(run.select(slice(None, None, every)))
        else:
            observation = systems.observe(self._form, excitation, every=every)
            sampled = outputs_from_columns(self.system, observation.y, observation.multipliers)
        sampled = without_kink_forces(self.system, sampled, excitation, excitation.times[::every], self.given.step)
        displacement = clear_round_off(sampled.displacement, self.round_off)
        return Sample(replace(sampled, displacement=displacement), of_all)

    def _forces(self, run: SystemTrajectory) -> ForceHistories:
        """Histories of all forces of a run, by kind and name, at the times that are not near kinks of the excitation.

        The result is empty if the system was made without `complete`, the function that adds forces to a motion.
        """
        if self._complete is None:
            return {}
        away = away_from_kinks(self.excitation, run.t, self.given.step)
        histories = force_histories(self._complete(evaluate_motion(self.system, run)))
        return {kind: {name: force[away] for name, force in of.items()} for kind, of in histories.items()}


class Runs:
    """Runs of a system with its step, half the step, a quarter and so on, at the rho_inf of `reference_rho`.

    The system is `stepped`.  Velocities are sampled if `rates` is true.  `halved` counts how often the step of the last
    run is halved, -1 before the first run; `taken` is the number of steps of all runs together.
    """

    def __init__(self, stepped: SteppedSystem, rates: bool) -> None:
        """Begin without runs of the system `stepped`; velocities are sampled if `rates` is true."""
        self._stepped, self._rates, stepping = stepped, rates, stepped.given
        self._stride = -(-stepping.steps // COMPARED)
        self._budget = BUDGET_OF_IMPACTS if stepped.pushing else BUDGET
        self._last: SystemTrajectory | None = None
        self.halved, self.taken = -1, 0

    @property
    def last_grid(self) -> TimeStepping:
        """Time grid of the last run."""
        return self._stepped.halved_grid(self.halved)

    @property
    def _work(self) -> int:
        """Number of steps of the last run, where a step in parts counts once for each part."""
        stepping = self.last_grid
        return sum(stepping.schedule) or stepping.steps * max(1, stepping.parts)

    @property
    def is_resolved(self) -> bool:
        """Whether no tone of path and loads is aliased at the steps of the last run."""
        return not any(is_aliased(signal, self.last_grid) for _, signal in self._stepped.excitation.signals)

    @property
    def can_afford_next(self) -> bool:
        """Whether one more run, with half the step, is within the limits on steps.

        A run has at most `LONGEST` steps.  All runs together have at most `BUDGET`, or `BUDGET_OF_IMPACTS` if some
        contacts only push; but the first two halvings may exceed this budget.
        """
        steps = 2 * self._work
        return steps <= LONGEST and (self.halved < 2 or self.taken + steps <= self._budget)

    def sample_initial_run(self, first: Sample) -> Sample:
        """Sample of the run whose error is to be estimated, that on the grid `SteppedSystem.given`.

        `first` is the sample of the only run so far.  If `SteppedSystem.run` is None, and if the only run had the
        rho_inf and the number of parts of the grid, `first` is returned.  Otherwise the run on the grid is sampled, and
        simulated before if `SteppedSystem.run` is None.
        """
        grid, stepping = self._stepped.given, self.last_grid
        if self._stepped.run is None and (stepping.rho_inf, stepping.parts) == (grid.rho_inf, grid.parts):
            return first
        if self._stepped.run is None:
            self.taken += self._work
        return self._stepped.sample(self._stepped.record(grid, self._rates), grid, self._stride, self._rates)

    def simulate_next(self) -> Sample:
        """Simulate the next run, and return its sample at the times of comparison.

        The first run has the given step, each further run half the step of the one before.  If a run fails, the next
        one has the same step again.  Raises InputError or SimulationError as for `pmr.simulation.SystemSimulator`.
        """
        self.halved += 1
        try:
            run, every = self._stepped.record(self.last_grid, self._rates), self._stride * 2**self.halved
            sample = self._stepped.sample(run, self.last_grid, every, self._rates)
        except SimulationError:
            self.halved -= 1
            raise
        self.taken, self._last = self.taken + self._work, run
        return sample

    def band(self) -> float:
        """Frequency in Hz above which the tip's motion in the last run has 1 % of its RMS; 0 if nothing moves.

        If the tip does not move, since it stands on a support, all displacements take its place.
        """
        of, stepping = self._stepped, self.last_grid
        for numbers in (of.tips, None):
            if self._last is None:
                y = of.simulate_displacements(stepping, numbers)
            else:
                y = of.displacements(self._last, numbers)
            if np.any(y := clear_round_off(y, of.round_off)):
                break
        return band_limit(y, stepping.step)
