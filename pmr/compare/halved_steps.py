"""A motion simulated with ever smaller steps, and what the runs say of each other (`pmr.compare.step_error`)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from pmr.compare import forces
from pmr.compare.booms import tip_columns
from pmr.compare.errors import round_off, zero_round_off
from pmr.compare.evaluation import respond
from pmr.compare.outputs import Outputs
from pmr.compare.runs import (
    away_from_kinks,
    between_kinks,
    is_recorded,
    outputs,
    outputs_from,
    run_from_start,
    without_rates,
)
from pmr.compare.spectrum import band
from pmr.errors import SimulationError
from pmr.results import Response
from pmr.simulation import contact_step
from pmr.simulation.contact_step import contact_frequency
from pmr.simulation.excitation import Excitation
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.stepping import TimeStepping, is_aliased
from pmr.system.body import length_outputs
from pmr.system.states import SystemTrajectory
from pmr.system.system import System

Array = NDArray[np.float64]
Compared = TypeVar("Compared")

#: Ratio of two differences in a row above which a motion is not resolved yet.
ROUGH = 0.6
#: Share of the error by which what is beyond the finest run may change it.
SETTLED = 0.25
#: Differences that are small enough as they stand, whether they fall or not.
NEGLIGIBLE = 1e-3
#: Difference that is none.
ROUND_OFF = 1e-12
#: Steps of all runs together up to which they go on being halved, beyond the two halvings that are always made.
BUDGET = 300_000
#: The same where rows only push: behind an impact smaller steps settle nothing.
BUDGET_OF_IMPACTS = 50_000
#: Steps of a run up to which even these are made.
LONGEST = 4_000_000
#: Steps at which runs are compared, at most.
COMPARED = 20_000
#: Least rho_inf of runs that others are compared with.  With less, steps damp what they don't resolve, so that runs
#: which all lack it agree; with 1, rows that move can make it grow.
UNDAMPED = 0.95


def reference_rho(system: System, rho_inf: float) -> float:
    """`rho_inf` of the runs that one with this value is compared with: at least `UNDAMPED`.

    Rows without residual flexibility grow with more damping than others, and what only pushes bounces otherwise.
    """
    parts = [body if system.on_one_path else body.carriers for body in system.bodies.values()]
    flexible = all(getattr(part, "flexibility", None) is not None for part in parts)
    return max(rho_inf, UNDAMPED) if flexible and np.isnan(system.clearance).all() else rho_inf


@dataclass(frozen=True)
class Sampled:
    """Outputs and forces of a run at the T times at which runs are compared."""

    outputs: Outputs
    forces: forces.Histories = field(default_factory=dict)  # of completed responses, without steps beside kinks


class Stepped:
    """A system that is simulated with several steps; its `run` with the given one is made unless it is known.

    Where `complete` adds to a response the forces that follow from others, all forces are sampled.

    The given run chooses its parts as any run does.  What it is compared with makes each step in as many as that run
    made it in or those beside it, whichever are most, and as many in half the step: so parts become shorter with the
    step, at impacts and between them.
    """

    def __init__(
        self,
        system: System,
        excitation: Excitation,
        run: SystemTrajectory | None = None,
        complete: Callable[[Response], Response] | None = None,
    ) -> None:
        self.system, self.excitation, self._known, self._complete = system, excitation, run, complete
        self._form = SystemForm.of(system)
        self.pushing = not np.isnan(system.clearance).all()
        #: The time grid that the error is asked for of.
        self.given = replace(excitation.stepping, schedule=())
        self.reference_rho = reference_rho(system, self.given.rho_inf)
        #: What of a displacement may be round-off, in m.
        self.round_off = round_off(system.bodies, excitation.forces(system.input_names), self.given.end)
        #: Numbers of the tip's displacements among all.
        self.tips = tip_columns(system)
        self.moved = np.flatnonzero(np.concatenate([length_outputs(body) for body in system.bodies.values()]))
        chosen = self.pushing and not self.given.parts and is_recorded(system, self.given)
        #: The given run, where it chose parts.
        self.run = self.simulate(self.given) if chosen else None
        self._known = self._known or self.run
        self._parts = self.given.parts
        if self.pushing and self.run is None:
            self._parts = contact_step.parts(contact_frequency(system, excitation), self.given)

    def halved(self, times: int) -> TimeStepping:
        """The time grid of a run that the given one is compared with, its step halved so many times."""
        grid, step = self.given, self.given.step / 2**times
        if self.run is None or self.run.parts is None:
            return TimeStepping(grid.end, step, self.reference_rho, self._parts)
        parts = np.pad(self.run.parts[1:], 1, mode="edge")
        most = np.max([parts[:-2], parts[1:-1], parts[2:]], axis=0)
        return TimeStepping(grid.end, step, self.reference_rho, schedule=tuple(np.repeat(most, 2**times).tolist()))

    def simulate(self, stepping: TimeStepping) -> SystemTrajectory:
        """All steps of a run; errors as for `pmr.simulation.Simulator`."""
        if self._known is not None and stepping == self.given:
            return self._known
        return run_from_start(self._form, self.excitation.on_grid(stepping))

    def displacements(self, run: SystemTrajectory, which: list[int] | None = None) -> Array:
        """All or some displacements (T, o) m of a run."""
        chosen = self.moved if which is None else self.moved[which]
        return np.hstack(list(systems.displacements(self.system, run, chosen.tolist()).values()))

    def observed(self, stepping: TimeStepping, which: list[int] | None = None) -> Array:
        """All or some, (T, o) m, of a run of which no more is recorded; errors likewise."""
        chosen = self.moved if which is None else self.moved[which]
        return systems.observe(self._form, self.excitation.on_grid(stepping), chosen.tolist()).y

    def sample(
        self, stepping: TimeStepping, every: int, rates: bool = False
    ) -> tuple[Sampled, SystemTrajectory | None]:
        """Each `every`-th step of a run, with velocities where `rates` are wanted, and the run if it is recorded.

        Displacements that are round-off are zero, and so are forces beside kinks of extensions.  Errors likewise.
        """
        excitation, run, of_all = self.excitation.on_grid(stepping), None, forces.Histories()
        if rates or is_recorded(self.system, stepping):
            run = self.simulate(stepping)
            if rates:
                sampled = outputs(self.system, run, excitation, every)
            else:
                sampled = without_rates(self.system, run.at(slice(None, None, every)))
            of_all = self._forces(run.at(slice(None, None, every)))
        else:
            observation = systems.observe(self._form, excitation, every=every)
            sampled = outputs_from(self.system, observation.y, observation.multipliers)
        sampled = between_kinks(self.system, sampled, excitation, excitation.times[::every], self.given.step)
        moves, _ = zero_round_off(sampled.displacement, sampled.displacement, self.round_off)
        return Sampled(replace(sampled, displacement=moves), of_all), run

    def _forces(self, run: SystemTrajectory) -> forces.Histories:
        """All forces of a run but beside kinks; none where responses are not to be completed."""
        if self._complete is None:
            return {}
        away = away_from_kinks(self.excitation, run.t, self.given.step)
        histories = forces.histories(self._complete(respond(self.system, run)))
        return {kind: {name: force[away] for name, force in of.items()} for kind, of in histories.items()}


class Runs:
    """Runs of a `stepped` system with its step, half of it, and so on, at its reference rho_inf.

    Velocities are outputs where `rates` are wanted.
    """

    def __init__(self, stepped: Stepped, rates: bool = False) -> None:
        self._stepped, self._rates, stepping = stepped, rates, stepped.given
        self._stride = -(-stepping.steps // COMPARED)
        self._budget = BUDGET_OF_IMPACTS if stepped.pushing else BUDGET
        self._last: SystemTrajectory | None = None
        self.halved, self.taken = -1, 0

    @property
    def stepping(self) -> TimeStepping:
        """Time grid of the last run."""
        return self._stepped.halved(self.halved)

    @property
    def _work(self) -> int:
        """Steps of the last run, those that are parts of one included."""
        stepping = self.stepping
        return sum(stepping.schedule) or stepping.steps * max(1, stepping.parts)

    @property
    def resolved(self) -> bool:
        """Whether the last run can tell all tones of path and loads from slower ones."""
        return not any(is_aliased(signal, self.stepping) for _, signal in self._stepped.excitation.signals)

    @property
    def affordable(self) -> bool:
        """Whether one more run is to be made."""
        steps = 2 * self._work
        return steps <= LONGEST and (self.halved < 2 or self.taken + steps <= self._budget)

    def given(self, first: Sampled) -> Sampled:
        """Sample the run with the given step and rho_inf; the `first` run where that is the same."""
        grid, stepping = self._stepped.given, self.stepping
        if self._stepped.run is None and (stepping.rho_inf, stepping.parts) == (grid.rho_inf, grid.parts):
            return first
        if self._stepped.run is None:
            self.taken += self._work
        return self._stepped.sample(grid, self._stride, self._rates)[0]

    def next(self) -> Sampled:
        """Sample the next run, with half the step of the last one, at the times of comparison.

        Raises InputError or SimulationError as for `pmr.simulation.Simulator`.
        """
        self.halved += 1
        try:
            sample, self._last = self._stepped.sample(self.stepping, self._stride * 2**self.halved, self._rates)
        except SimulationError:
            self.halved -= 1
            raise
        self.taken += self._work
        return sample

    def band(self) -> float:
        """Frequency in Hz above which 1 % of the tip's motion lies, by its RMS, in the last run; 0 if nothing moves.

        Where the tip rests, on a support for instance, that of all outputs.
        """
        of, stepping = self._stepped, self.stepping
        if self._last is None:
            y = self._moving(of.observed(stepping, of.tips))
            if not np.any(y):
                y = self._moving(of.observed(stepping))
            return band(y, stepping.step)
        y = self._moving(of.displacements(self._last, of.tips))
        return band(y if np.any(y) else self._moving(of.displacements(self._last)), stepping.step)

    def _moving(self, y: Array) -> Array:
        """Signals y (T, o) with zeros in the columns that don't exceed round-off."""
        return zero_round_off(y, y, self._stepped.round_off)[0]


class Ladder(Generic[Compared]):
    """Differences between runs with ever smaller steps, and how fast they converge.

    `apart` is the measure of a difference to a finer run, a fraction.  The error is that of the `given` run, by default
    of the first.
    """

    def __init__(
        self, apart: Callable[[Compared, Compared], float], first: Compared, given: Compared | None = None
    ) -> None:
        self._apart = apart
        self.first, self.last = first if given is None else given, first
        self.differences: list[float] = []

    def add(self, finer: Compared) -> None:
        """Add the samples of a run with a smaller step."""
        self.differences.append(self._apart(self.last, finer))
        self.last = finer

    @property
    def whole(self) -> float:
        """Difference of the first run to the last."""
        return self._apart(self.first, self.last)

    @property
    def rest(self) -> float:
        """Sum of all further differences, as a geometric series; infinite where they don't decrease."""
        if len(self.differences) < 2:
            return np.inf
        before, last = self.differences[-2:]
        if last <= ROUND_OFF:
            return 0.0
        ratio = last / before if before > 0.0 else np.inf
        return last * ratio / (1.0 - ratio) if ratio <= ROUGH else np.inf

    @property
    def is_decreasing(self) -> bool:
        """Whether differences fall, or the last one is negligible."""
        return np.isfinite(self.rest) or self.differences[-1] <= NEGLIGIBLE

    @property
    def most(self) -> float:
        """Error of the first run with a rest of no more than the last difference, also where differences don't fall."""
        return self.whole + min(self.rest, self.differences[-1])

    @property
    def settled(self) -> bool:
        """Whether the rest is small against the error of the first run, or several differences in a row are small."""
        difference = self.whole
        small = len(self.differences) > 1 and difference + sum(self.differences[-2:]) <= NEGLIGIBLE
        return self.rest <= SETTLED * difference or small

    def error(self, part: float | None = None) -> float:
        """Error of the first run, or of a part of what it says that is so far from the last run; both share the rest.

        Where differences don't fall, the difference to the last run, which is the least that the error may be.
        """
        difference, remainder = self.whole, self.rest
        part = difference if part is None else part
        return part * (1.0 + remainder / difference) if np.isfinite(remainder) and difference > 0.0 else part

    def halvings(self, limit: float) -> int | None:
        """How often the step has to be halved for an error below `limit`; None where these runs don't show it."""
        if not self.settled:
            return None
        remainder = self.rest if np.isfinite(self.rest) else self.differences[-1]
        errors = np.append(np.cumsum(self.differences[::-1])[::-1], 0.0) + remainder
        errors *= max(1.0, self.whole / errors[0]) if errors[0] > 0.0 else 1.0
        below = np.flatnonzero(errors <= limit)
        return int(below[0]) if len(below) else None
