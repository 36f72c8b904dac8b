r"""Error by the time step: the same model is simulated again with half the step, a quarter, and so on.

.. math::
    d_k = \lVert y_{h/2^k} - y_{h/2^{k+1}} \rVert, \qquad
    \lVert y_h - y \rVert \approx \lVert y_h - y_{h/2^n} \rVert + d_{n-1} \frac{\rho}{1 - \rho}, \qquad
    \rho = d_{n-1} / d_{n-2}

with the given step h, the outputs y_h of the run with it, the exact outputs y, and n halvings.  Generalized-alpha is of
second order, so rho tends to 1/4 (Richardson's extrapolation) for motions that the steps resolve, and to about 1/2
after kinks and jumps.  If rho is above 0.6, the steps don't resolve the motion yet and are halved again: two runs that
both miss the motion may agree.  Runs with shorter steps have a rho_inf of at least 0.95: with less, all runs would damp
motions that they don't resolve, and would agree on the damped motion.  Only halving shows the error.  Doubling the step
would not: a tone that looks like a slower tone at the step h does so at 2 h as well.

Reduced and full model take the same steps, so no comparison of the two shows this error.  The module also writes the
summary of this error and warnings about it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from pmr.compare.errors import (
    ForceHistories,
    band_limit,
    force_errors,
    force_histories,
    relative_error,
    round_off,
    zero_round_off,
)
from pmr.compare.outputs import (
    Outputs,
    RoundOffBounds,
    away_from_kinks,
    differences,
    fits_in_memory,
    outputs_from_columns,
    outputs_of_run,
    outputs_without_rates,
    run_from_start,
    tip_columns,
    without_kink_forces,
)
from pmr.compare.responses import evaluate_motion
from pmr.compare.trust import FAR
from pmr.errors import SimulationError
from pmr.errors.text import percent, two_digits
from pmr.results import Response
from pmr.results.quantities import QUANTITIES
from pmr.scene.signals import SignalBase
from pmr.simulation import Excitation, TimeStepping, contact_step
from pmr.simulation.contact_step import contact_frequency
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.stepping import is_aliased
from pmr.system.body import length_outputs
from pmr.system.states import SystemTrajectory
from pmr.system.system import System

Compared = TypeVar("Compared")

#: Ratio of two differences in a row above which a motion is not resolved yet.
ROUGH = 0.6
#: Largest share of the error that extrapolation beyond the finest run may contribute.
SETTLED = 0.25
#: Differences up to this one are small enough, whether they decrease or not.
NEGLIGIBLE = 1e-3
#: Differences up to this one count as zero.
NO_DIFFERENCE = 1e-12
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
    """Spectral radius rho_inf of the runs with which a run with `rho_inf` is compared; at least `UNDAMPED` if possible.

    It is `rho_inf` itself if the system has rows without residual flexibility, which can grow with less damping, or
    contacts that only push, which would bounce.
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
    or the run is too long to be recorded.  In runs with shorter steps, each half of a given step has the largest number
    of parts that this step, the one before and the one after have in the given run.  So parts become shorter with the
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
        self._known = self._known or self.run
        self._parts = self.given.parts
        if self.pushing and self.run is None:
            self._parts = contact_step.count_parts(contact_frequency(system, excitation), self.given)

    def halved_grid(self, times: int) -> TimeStepping:
        """Time grid of a run with the given step halved `times` times, and with the reference rho_inf."""
        grid, step = self.given, self.given.step / 2**times
        if self.run is None or self.run.parts is None:
            return TimeStepping(grid.end, step, self.reference_rho, self._parts)
        parts = np.pad(self.run.parts[1:], 1, mode="edge")
        most = np.max([parts[:-2], parts[1:-1], parts[2:]], axis=0)
        return TimeStepping(grid.end, step, self.reference_rho, schedule=tuple(np.repeat(most, 2**times).tolist()))

    def simulate(self, stepping: TimeStepping) -> SystemTrajectory:
        """Motion at all steps on a time grid; if the grid is that of the given run and this is known, it is returned.

        Raises InputError or SimulationError as for `pmr.simulation.Simulator`.
        """
        if self._known is not None and stepping == self.given:
            return self._known
        return run_from_start(self._form, self.excitation.on_grid(stepping))

    def displacements(self, run: SystemTrajectory, numbers: list[int] | None = None) -> Array:
        """Displacements (T, o) in m in a run: all, or those with the given `numbers`."""
        chosen = self.moved if numbers is None else self.moved[numbers]
        return np.hstack(list(systems.displacements(self.system, run, chosen.tolist()).values()))

    def simulate_displacements(self, stepping: TimeStepping, numbers: list[int] | None = None) -> Array:
        """Displacements (T, o) in m on a time grid: all, or those with the given `numbers`; nothing else is recorded.

        Raises InputError or SimulationError as for `pmr.simulation.Simulator`.
        """
        chosen = self.moved if numbers is None else self.moved[numbers]
        return systems.observe(self._form, self.excitation.on_grid(stepping), chosen.tolist()).y

    def sample(self, stepping: TimeStepping, every: int, rates: bool = False) -> tuple[Sample, SystemTrajectory | None]:
        """Sample each `every`-th step of a run on a time grid; return the sample and the run (None if not recorded).

        Velocities are sampled if `rates` is true.  Displacements that are round-off are set to zero, and so are forces
        near kinks of extensions.  Raises InputError or SimulationError as for `pmr.simulation.Simulator`.
        """
        excitation, run, of_all = self.excitation.on_grid(stepping), None, ForceHistories()
        if rates or fits_in_memory(self.system, stepping):
            run = self.simulate(stepping)
            if rates:
                sampled = outputs_of_run(self.system, run, excitation, every)
            else:
                sampled = outputs_without_rates(self.system, run.select(slice(None, None, every)))
            of_all = self._forces(run.select(slice(None, None, every)))
        else:
            observation = systems.observe(self._form, excitation, every=every)
            sampled = outputs_from_columns(self.system, observation.y, observation.multipliers)
        sampled = without_kink_forces(self.system, sampled, excitation, excitation.times[::every], self.given.step)
        moves, _ = zero_round_off(sampled.displacement, sampled.displacement, self.round_off)
        return Sample(replace(sampled, displacement=moves), of_all), run

    def _forces(self, run: SystemTrajectory) -> ForceHistories:
        """All forces of a run at the times that are not near kinks; empty if `complete` is None."""
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

    def __init__(self, stepped: SteppedSystem, rates: bool = False) -> None:
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
        """Number of steps of the last run, in which a step counts as often as it has parts."""
        stepping = self.last_grid
        return sum(stepping.schedule) or stepping.steps * max(1, stepping.parts)

    @property
    def is_resolved(self) -> bool:
        """Whether no tone of path and loads is aliased at the steps of the last run."""
        return not any(is_aliased(signal, self.last_grid) for _, signal in self._stepped.excitation.signals)

    @property
    def can_afford_next(self) -> bool:
        """Whether one more run, with half the step, is within the limits on steps (`LONGEST` and the budget)."""
        steps = 2 * self._work
        return steps <= LONGEST and (self.halved < 2 or self.taken + steps <= self._budget)

    def sample_initial_run(self, first: Sample) -> Sample:
        """Sample of the run with the given step and the given rho_inf.

        `first` is the sample of the first run; it is returned if the first run has the given rho_inf too.
        """
        grid, stepping = self._stepped.given, self.last_grid
        if self._stepped.run is None and (stepping.rho_inf, stepping.parts) == (grid.rho_inf, grid.parts):
            return first
        if self._stepped.run is None:
            self.taken += self._work
        return self._stepped.sample(grid, self._stride, self._rates)[0]

    def next(self) -> Sample:
        """Sample of the next run, which has half the step of the last run, at the times of comparison.

        Raises InputError or SimulationError as for `pmr.simulation.Simulator`.
        """
        self.halved += 1
        try:
            sample, self._last = self._stepped.sample(self.last_grid, self._stride * 2**self.halved, self._rates)
        except SimulationError:
            self.halved -= 1
            raise
        self.taken += self._work
        return sample

    def band(self) -> float:
        """Frequency in Hz above which 1 % of the tip's motion lies in the last run, by its RMS; 0 if nothing moves.

        If the tip does not move, as on a support, it is the frequency for all displacements.
        """
        of, stepping = self._stepped, self.last_grid
        if self._last is None:
            y = self._without_round_off(of.simulate_displacements(stepping, of.tips))
            if not np.any(y):
                y = self._without_round_off(of.simulate_displacements(stepping))
            return band_limit(y, stepping.step)
        y = self._without_round_off(of.displacements(self._last, of.tips))
        return band_limit(y if np.any(y) else self._without_round_off(of.displacements(self._last)), stepping.step)

    def _without_round_off(self, y: Array) -> Array:
        """Signals y (T, o) with zeros in the columns that are only round-off."""
        return zero_round_off(y, y, self._stepped.round_off)[0]


class ConvergenceSeries(Generic[Compared]):
    """Differences between runs with ever smaller steps, and the error of a run that they show.

    `difference` measures the difference of a run to a finer run, as a fraction.  `first` is the run with the longest
    step.  The error is that of the run `initial` ("the given run"), or of `first` if `initial` is None.
    """

    def __init__(
        self, difference: Callable[[Compared, Compared], float], first: Compared, initial: Compared | None = None
    ) -> None:
        self._apart = difference
        self.first, self.last = first if initial is None else initial, first
        self.differences: list[float] = []

    def add(self, finer: Compared) -> None:
        """Add the sample of the next run, which has a smaller step."""
        self.differences.append(self._apart(self.last, finer))
        self.last = finer

    @property
    def difference_to_last(self) -> float:
        """Difference of the given run to the last run, a fraction."""
        return self._apart(self.first, self.last)

    @property
    def remainder(self) -> float:
        """Sum of all differences that further halvings would add, computed as a geometric series.

        It is infinite if the differences don't decrease, and if there are fewer than two differences.
        """
        if len(self.differences) < 2:
            return np.inf
        before, last = self.differences[-2:]
        if last <= NO_DIFFERENCE:
            return 0.0
        ratio = last / before if before > 0.0 else np.inf
        return last * ratio / (1.0 - ratio) if ratio <= ROUGH else np.inf

    @property
    def is_decreasing(self) -> bool:
        """Whether the differences decrease, or the last one is negligible."""
        return np.isfinite(self.remainder) or self.differences[-1] <= NEGLIGIBLE

    @property
    def error_bound(self) -> float:
        """Error of the given run with the last difference as largest remainder, even if differences don't decrease."""
        return self.difference_to_last + min(self.remainder, self.differences[-1])

    @property
    def is_settled(self) -> bool:
        """Whether the `remainder` is small: at most `SETTLED` times the given run's difference to the last run.

        It is true too if all differences are negligible: the sum of that difference and the last two is at most
        `NEGLIGIBLE`.
        """
        difference = self.difference_to_last
        small = len(self.differences) > 1 and difference + sum(self.differences[-2:]) <= NEGLIGIBLE
        return self.remainder <= SETTLED * difference or small

    def error(self, part: float | None = None) -> float:
        """Error of the given run: its difference to the last run, plus the `remainder`.

        `part` is the difference in only some of the outputs; the error of these outputs is then returned, with a
        proportional share of the remainder.  If differences don't decrease, the difference itself is returned, which is
        the least that the error may be.
        """
        difference, remainder = self.difference_to_last, self.remainder
        part = difference if part is None else part
        return part * (1.0 + remainder / difference) if np.isfinite(remainder) and difference > 0.0 else part

    def halvings_needed(self, limit: float) -> int | None:
        """How often the step has to be halved for an error below `limit`; None if the runs don't show it."""
        if not self.is_settled:
            return None
        remainder = self.remainder if np.isfinite(self.remainder) else self.differences[-1]
        errors = np.append(np.cumsum(self.differences[::-1])[::-1], 0.0) + remainder
        errors *= max(1.0, self.difference_to_last / errors[0]) if errors[0] > 0.0 else 1.0
        below = np.flatnonzero(errors <= limit)
        return int(below[0]) if len(below) else None


Array = NDArray[np.float64]

#: Share of the motion above which a step is called too coarse.
STEP_LIMIT = 0.02
#: Margin on errors of forces in completed responses: their differences decrease less evenly than those of
#: displacements.
MARGIN_OF_FORCES = 1.25


@dataclass(frozen=True)
class StepError:
    """Error of a model's displacements by the time step; fractions of the finest run's motion, which may exceed 1."""

    beam: float
    tip: float
    largest: float | None  # m: largest difference of an output at any time; None if `by` is ``mean``
    finest: float  # s: smallest step that was taken
    settled: bool  # whether the runs approach each other; if not, the error is at least of this size
    by: str  # ``motion``; or ``mean`` for RMS values, if contacts only push: motions diverge after an impact
    enough: float | None  # s: largest step of a run with an error below `STEP_LIMIT`; None if there is none
    band: float | None  # Hz: 1 % of the tip's motion lies above it, in the finest run; None until `with_band`
    seconds: float  # wall time of all runs
    further_errors: Mapping[str, float] = field(default_factory=dict)  # errors of further kinds of outputs and forces
    unsettled: tuple[str, ...] = ()  # further kinds in which the runs do not approach each other

    def error_of(self, kind: str) -> float:
        """Error of a kind of outputs or forces, a fraction; infinite if it was not computed."""
        return {"beam": self.beam, "tip": self.tip, **self.further_errors}.get(kind, np.inf)


def step_error(
    system: System,
    excitation: Excitation,
    run: SystemTrajectory | None = None,
    kinds: Sequence[str] = (),
    complete: Callable[[Response], Response] | None = None,
    band: bool = True,
) -> StepError:
    """Error of the time step in a simulation of the system from the start of the excitation.

    Runs are simulated by the compiled simulator (``march``); Exudyn's solver has the same scheme and start.  Steps are
    halved until the error of displacements, and that of further `kinds`, is settled.

    Parameters
    ----------
    system, excitation
        System that is simulated, and its paths, loads and time grid.
    run : SystemTrajectory, optional
        The run with the given step, if it is known; it must have chosen its own parts of steps.
    kinds : sequence of str
        Kinds of outputs (`pmr.compare.outputs`), besides displacements, whose errors are wanted.
    complete : callable, optional
        Function that adds to a response the forces that follow from other forces.  Then errors of all kinds of forces
        (`force_errors`) are returned, with the margin `MARGIN_OF_FORCES` and without steps near kinks; this takes no
        further runs.
    band : bool
        Whether to find the band of the motion, in Hz.

    Raises
    ------
    InputError
        As for `pmr.simulation.Simulator`.
    SimulationError
        If one of the first two runs fails, or the second would be too long.
    """
    begin, kinds = time.perf_counter(), [kind for kind in kinds if kind not in ("beam", "tip")]
    stepped = SteppedSystem(system, excitation, run, complete)
    runs = Runs(stepped, "velocity" in kinds)
    first_sample = runs.next()
    if not runs.can_afford_next:
        raise SimulationError("a run with half the step is too long to be made only to estimate this error")
    given_sample = runs.sample_initial_run(first_sample)
    displacement, given_displacement = first_sample.outputs.displacement, given_sample.outputs.displacement
    of_motion = ConvergenceSeries(relative_error, displacement, given_displacement)
    of_mean = ConvergenceSeries(relative_error, _rms(displacement), _rms(given_displacement))
    floors = RoundOffBounds.for_system(system, excitation, given_sample.outputs.force)
    output_ladders = {
        kind: ConvergenceSeries(partial(_difference, kind, floors), first_sample, given_sample) for kind in kinds
    }
    samples = [first_sample]
    while runs.can_afford_next and not (
        of_motion.halvings_needed(STEP_LIMIT) is not None
        and runs.is_resolved
        and all(steps.is_settled for steps in output_ladders.values())
    ):
        try:
            samples.append(runs.next())
        except SimulationError:
            if not of_motion.differences:
                raise
            break
        of_motion.add(samples[-1].outputs.displacement)
        of_mean.add(_rms(samples[-1].outputs.displacement))
        for output_ladder in output_ladders.values():
            output_ladder.add(samples[-1])
    ladder = of_mean if stepped.pushing and not of_motion.is_settled else of_motion
    halvings = ladder.halvings_needed(STEP_LIMIT) if runs.is_resolved else None
    force_ladders = _force_series(given_sample, samples, in_the_mean=ladder is of_mean)
    return StepError(
        beam=ladder.error(),
        tip=ladder.error(relative_error(ladder.first[:, stepped.tips], ladder.last[:, stepped.tips])),
        largest=float(np.abs(ladder.first - ladder.last).max()) if ladder is of_motion else None,
        finest=runs.last_grid.step,
        settled=ladder.is_settled and runs.is_resolved,
        by="motion" if ladder is of_motion else "mean",
        enough=None if halvings is None else stepped.given.step / 2**halvings,
        band=runs.band() if band else None,
        seconds=time.perf_counter() - begin,
        further_errors={kind: MARGIN_OF_FORCES * steps.error_bound for kind, steps in force_ladders.items()}
        | {kind: steps.error() for kind, steps in output_ladders.items()},
        unsettled=(
            *(kind for kind, steps in force_ladders.items() if not steps.is_decreasing),
            *(kind for kind, steps in output_ladders.items() if not steps.is_settled),
        ),
    )


def with_band(error: StepError, system: System, excitation: Excitation) -> StepError:
    """Return this error with the band of the motion; for that, the run with the finest step is simulated again."""
    runs = Runs(SteppedSystem(system, excitation))
    runs.halved = round(np.log2(excitation.stepping.step / error.finest))
    return replace(error, band=runs.band())


def _difference(kind: str, floors: RoundOffBounds, sampled: Sample, finer: Sample) -> float:
    """Difference of a run to a finer run in a kind of outputs, as a fraction of the finer run's size."""
    return differences(sampled.outputs, finer.outputs, floors, [kind])[kind]


def _force_series(
    initial_run: Sample, samples: Sequence[Sample], in_the_mean: bool
) -> dict[str, ConvergenceSeries[ForceHistories]]:
    """A series of differences for each kind of forces of completed responses, by kind.

    The differences are those of RMS values over time if `in_the_mean` is true.  `initial_run` is the given run,
    `samples` are those of runs with smaller and smaller steps.
    """
    forces_of_run, *finer_forces = (
        _rms_forces(run.forces) if in_the_mean else run.forces for run in (initial_run, *samples)
    )
    ladders = dict[str, ConvergenceSeries[ForceHistories]]()
    for kind in force_errors(forces_of_run, finer_forces[-1]):
        ladders[kind] = ConvergenceSeries(partial(_force_difference, kind), finer_forces[0], forces_of_run)
        for sampled in finer_forces[1:]:
            ladders[kind].add(sampled)
    return ladders


def _force_difference(kind: str, histories: ForceHistories, finer: ForceHistories) -> float:
    """Difference of a run to a finer run in a kind of forces, as a fraction of the finer run's; 0 without forces."""
    return force_errors(histories, finer).get(kind, 0.0)


def _rms_forces(histories: ForceHistories) -> ForceHistories:
    """RMS of each force over time, (1,), by kind and name."""
    return {kind: {name: _rms(force) for name, force in named.items()} for kind, named in histories.items()}


def _rms(y: Array) -> Array:
    """RMS of each output over time, (1, o), for y (T, o)."""
    return np.asarray(np.sqrt(np.mean(y**2, axis=0, keepdims=True)))


def step_summary(error: StepError | None, reason: str | None = None, not_covered: Sequence[str] = ()) -> dict[str, Any]:
    """Contents of ``step`` in summary.json: the fields of `StepError`, further kinds, ``limit`` and ``reason``.

    ``not_covered`` lists in words the quantities without an error.  If `error` is None, all fields are None, and
    ``reason`` says why.
    """
    names = [name for name in StepError.__annotations__ if name not in ("further_errors", "unsettled")]
    figures = dict.fromkeys(names) if error is None else {name: getattr(error, name) for name in names}
    more = {"not_covered": list(not_covered), "limit": STEP_LIMIT, "reason": reason}
    return figures | dict(error.further_errors if error else {}) | more


def step_warnings(
    step_error_of_run: StepError, stepping: TimeStepping, signals: Sequence[tuple[str, SignalBase]], natural: Array
) -> list[str]:
    """A warning if the step's error is not settled or exceeds `STEP_LIMIT`, in other outputs `FAR`; else nothing.

    `signals` are pairs (name, signal) of path and loads; `natural` (S, f) in Hz are f frequencies in S positions on the
    way, ascending.
    """
    h = stepping.step
    if step_error_of_run.beam <= STEP_LIMIT and step_error_of_run.settled:
        far = [
            f"{percent(error, 'the motion')} in {QUANTITIES[kind].label}"
            for kind, error in step_error_of_run.further_errors.items()
            if error > FAR
        ]
        return [
            f"the time step of {h:.4g} s is off by {', '.join(far)}, as steps of {step_error_of_run.finest:.2g} s show"
        ] * any(far)
    beam, tip = (percent(error, "the motion") for error in (step_error_of_run.beam, step_error_of_run.tip))
    size = f"{beam} along the beam, {tip} at the tip"
    if step_error_of_run.by == "mean":
        size += " in the mean (motions part after an impact, so they can't be compared instant by instant)"
    judged = (
        "is too coarse: its own error"
        if step_error_of_run.beam > STEP_LIMIT
        else "has an error that is not settled: it"
    )
    at_least = "" if step_error_of_run.settled else "at least "
    parts = [
        f"the time step of {h:.4g} s {judged} is {at_least}{size}, as steps of {step_error_of_run.finest:.2g} s show"
    ]
    parts += [
        _load_clause(name, signal, stepping) for name, signal in signals if signal.highest_frequency(0.0, stepping.end)
    ]
    if step_error_of_run.band is not None:
        parts.append(_motion_clause(step_error_of_run.band, h, natural))
    if not step_error_of_run.settled:
        parts.append(f"even steps of {step_error_of_run.finest:.2g} s don't settle it")
    elif step_error_of_run.enough is not None:
        parts.append(f"steps of {step_error_of_run.enough:.2g} s bring the error below {100.0 * STEP_LIMIT:g} %")
    return ["; ".join(parts)]


def _load_clause(name: str, signal: SignalBase, stepping: TimeStepping) -> str:
    """Clause about the highest frequency of a signal and the number of steps in a period of it."""
    f = signal.highest_frequency(0.0, stepping.end)
    return f"{name} goes up to {f:.4g} Hz, {_steps_per_period(f, stepping.step)}"


def _motion_clause(band: float, h: float, natural: Array) -> str:
    """Clause about the highest frequency of the motion, `band` in Hz, and the highest mode that it excites.

    `h` is the step in s, `natural` (S, f) in Hz are f natural frequencies in S positions.
    """
    frequencies = natural[:, ~np.isnan(natural).all(axis=0)]  # reduced models may have fewer modes than columns
    lowest = np.sort(np.nanmin(frequencies, axis=0)) if frequencies.size else np.empty(0)
    sentence = f"the motion goes up to {band:.3g} Hz, {_steps_per_period(band, h)}"
    excited = int(np.count_nonzero(lowest <= band))
    if not excited:
        return sentence
    more = " or more" if excited == len(lowest) else ""
    number = f"number {excited}{more}"
    return f"{sentence}; the highest mode that it excites is {number}, {lowest[excited - 1]:.3g} Hz and above"


def _steps_per_period(frequency: float, h: float) -> str:
    """How many steps of h in s a period takes, in words."""
    return f"{two_digits(1.0 / (frequency * h))} steps a period" if frequency > 0.0 else "no period"
