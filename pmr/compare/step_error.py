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

Reduced and full model take the same steps, so no comparison of the two shows this error.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Generic, TypeVar

import numpy as np

from pmr.compare.errors import ForceHistories, force_errors, relative_error
from pmr.compare.outputs import RoundOffBounds, differences
from pmr.compare.stepped_runs import Runs, Sample, SteppedSystem
from pmr.errors import SimulationError
from pmr.files.arrays import Array
from pmr.results import Response
from pmr.simulation import Excitation
from pmr.simulation.native.form import SystemForm
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


class ConvergenceSeries(Generic[Compared]):
    """Differences between runs with ever smaller steps, and the error of a run by these differences.

    `difference` measures the difference of a run to a finer run, as a fraction.  `first` is the run with the longest
    step.  "The given run", whose error is estimated, is `initial`, or `first` if `initial` is None.
    """

    def __init__(
        self, difference: Callable[[Compared, Compared], float], first: Compared, initial: Compared | None = None
    ) -> None:
        """Begin the series with the run with the longest step, `first`, and no differences.

        `difference` returns the difference of a run to a finer run, as a fraction.  `initial` is the run whose error is
        asked for; None stands for `first`.
        """
        self._apart = difference
        self.first, self.last = first if initial is None else initial, first
        self.differences: list[float] = []

    def add(self, finer: Compared) -> None:
        """Add `finer`, the sample of the next run, which has a smaller step."""
        self.differences.append(self._apart(self.last, finer))
        self.last = finer

    @property
    def difference_to_last(self) -> float:
        """Difference of the given run to the last run, a fraction."""
        return self._apart(self.first, self.last)

    @property
    def remainder(self) -> float:
        """Sum of all differences that further halvings would add, computed as a geometric series.

        The sum is a fraction, as the differences are.  With fewer than two differences it is infinite.  Otherwise it is
        0 if the last difference is at most `NO_DIFFERENCE`.  It is infinite if the last difference is more than `ROUGH`
        times the one before.
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
        """Error of the given run, a fraction: its difference to the last run, plus the `remainder`.

        If the difference of the last two runs is smaller than the remainder, that difference is added instead.
        """
        return self.difference_to_last + min(self.remainder, self.differences[-1])

    @property
    def is_settled(self) -> bool:
        """Whether the `remainder` is small: at most `SETTLED` times the given run's difference to the last run.

        The result is true too if all differences are negligible.  This means: that difference, plus the last two
        differences of the series, is at most `NEGLIGIBLE`.
        """
        difference = self.difference_to_last
        small = len(self.differences) > 1 and difference + sum(self.differences[-2:]) <= NEGLIGIBLE
        return self.remainder <= SETTLED * difference or small

    def error(self, part: float | None = None) -> float:
        """Error of the given run: its difference to the last run, plus the `remainder`.

        `part` is the difference in only some of the outputs; the error of these outputs is then returned, with a
        proportional share of the remainder.  None stands for all outputs.  If differences don't decrease, the
        difference to the last run is returned alone; the error is at least as large.
        """
        difference, remainder = self.difference_to_last, self.remainder
        part = difference if part is None else part
        return part * (1.0 + remainder / difference) if np.isfinite(remainder) and difference > 0.0 else part

    def halvings_needed(self, limit: float) -> int | None:
        """Number of halvings of the first run's step after which the estimated error, a fraction, is at most `limit`.

        The number is 0 if the first run's error is at most `limit`.  It is None if the differences have not settled, or
        if no run of the series has so small an error.
        """
        if not self.is_settled:
            return None
        remainder = self.remainder if np.isfinite(self.remainder) else self.differences[-1]
        errors = np.append(np.cumsum(self.differences[::-1])[::-1], 0.0) + remainder
        errors *= max(1.0, self.difference_to_last / errors[0]) if errors[0] > 0.0 else 1.0
        below = np.flatnonzero(errors <= limit)
        return int(below[0]) if len(below) else None


#: Share of the motion above which a step is called too coarse.
STEP_LIMIT = 0.02
#: Margin on errors of forces in completed responses: their differences decrease less evenly than those of
#: displacements.
MARGIN_OF_FORCES = 1.25


@dataclass(frozen=True)
class StepError:
    """Error of a model's run by the time step: `errors` by kind of outputs or forces, and how far they are known.

    Errors are fractions of the finest run's motion or forces, which may exceed 1; ``beam`` and ``tip`` are among them.
    """

    errors: Mapping[str, float]
    largest: float | None  # m: largest difference of an output at any time; None if `by` is ``mean``
    finest: float  # s: smallest step that was taken
    settled: bool  # whether the runs approach each other; if not, the error is at least of this size
    by: str  # ``motion``; or ``mean`` for RMS values, if contacts only push: motions diverge after an impact
    enough: float | None  # s: largest step of a run with an error below `STEP_LIMIT`; None if there is none
    band: float  # Hz: 1 % of the tip's motion lies above it, in the finest run
    seconds: float  # wall time of all runs
    unsettled: tuple[str, ...] = ()  # kinds but displacements in which the runs do not approach each other

    def error_of(self, kind: str) -> float:
        """Error of a kind of outputs or forces, a fraction; infinite for a kind whose error was not computed."""
        return self.errors.get(kind, np.inf)


def step_error(
    system: System | SystemForm,
    excitation: Excitation,
    run: SystemTrajectory | None = None,
    kinds: Sequence[str] = (),
    complete: Callable[[Response], Response] | None = None,
) -> StepError:
    """Error of the time step in a simulation of the system from the start of the excitation.

    Runs are simulated by the compiled simulator (``march``); Exudyn's solver has the same scheme and start.  Steps are
    halved until the error of displacements, and that of further `kinds`, is settled.

    Parameters
    ----------
    system, excitation
        System that is simulated, and its paths, loads and time grid.
    run : SystemTrajectory, optional
        The run with the given step, if it is known; the numbers of parts of its steps must not
        come from another run.
    kinds : sequence of str
        Kinds of outputs (`pmr.compare.outputs`), besides displacements, whose errors are wanted.
    complete : callable, optional
        Function that adds to a response the forces that follow from other forces.  Then errors of all kinds of forces
        (`force_errors`) are returned too.  They are multiplied by `MARGIN_OF_FORCES`, and steps near kinks do not
        count.  This takes no further runs.

    Raises
    ------
    InputError
        As for `pmr.simulation.SystemSimulator`.
    SimulationError
        If one of the first two runs fails, or the second would be too long.
    """
    begin, kinds = time.perf_counter(), [kind for kind in kinds if kind not in ("beam", "tip")]
    stepped = SteppedSystem(system, excitation, run, complete)
    runs = Runs(stepped, "velocity" in kinds)
    samples = [runs.simulate_next()]
    if not runs.can_afford_next:
        raise SimulationError("a run with half the step is too long to be made only to estimate this error")
    initial = runs.sample_initial_run(samples[0])
    floors = RoundOffBounds.for_system(stepped.system, excitation, initial.outputs.force)
    of_motion, of_mean = (
        ConvergenceSeries(partial(_motion_difference, mean), samples[0], initial) for mean in (False, True)
    )
    of_kinds = {kind: ConvergenceSeries(partial(_difference, kind, floors), samples[0], initial) for kind in kinds}
    while runs.can_afford_next and not (
        of_motion.halvings_needed(STEP_LIMIT) is not None
        and runs.is_resolved
        and all(series.is_settled for series in of_kinds.values())
    ):
        try:
            samples.append(runs.simulate_next())
        except SimulationError:
            if len(samples) == 1:
                raise
            break
        for series in (of_motion, of_mean, *of_kinds.values()):
            series.add(samples[-1])
    in_the_mean = stepped.pushing and not of_motion.is_settled
    motion = of_mean if in_the_mean else of_motion
    y, finest = (_motion(in_the_mean, sample) for sample in (initial, samples[-1]))
    halvings = motion.halvings_needed(STEP_LIMIT) if runs.is_resolved else None
    of_forces = _force_series(initial, samples, in_the_mean)
    return StepError(
        errors={
            "beam": motion.error(),
            "tip": motion.error(relative_error(y[:, stepped.tips], finest[:, stepped.tips])),
            **{kind: MARGIN_OF_FORCES * series.error_bound for kind, series in of_forces.items()},
            **{kind: series.error() for kind, series in of_kinds.items()},
        },
        largest=None if in_the_mean else float(np.abs(y - finest).max()),
        finest=runs.last_grid.step,
        settled=motion.is_settled and runs.is_resolved,
        by="mean" if in_the_mean else "motion",
        enough=None if halvings is None else stepped.given.step / 2**halvings,
        band=runs.band(),
        seconds=time.perf_counter() - begin,
        unsettled=(
            *(kind for kind, series in of_forces.items() if not series.is_decreasing),
            *(kind for kind, series in of_kinds.items() if not series.is_settled),
        ),
    )


def _motion(in_the_mean: bool, sample: Sample) -> Array:
    """Displacements (T, o) in m of the run `sample`, or their RMS over time, (1, o), if `in_the_mean` is true."""
    return _rms(sample.outputs.displacement) if in_the_mean else sample.outputs.displacement


def _motion_difference(in_the_mean: bool, sample: Sample, finer: Sample) -> float:
    """Difference of a run's displacements, or of their RMS if `in_the_mean`, to those of a finer run.

    The result is a fraction of the displacements of the run `finer`.
    """
    return relative_error(_motion(in_the_mean, sample), _motion(in_the_mean, finer))


def _difference(kind: str, floors: RoundOffBounds, sample: Sample, finer: Sample) -> float:
    """Difference of a run to a finer run in a kind of outputs, as a fraction of the finer run's size.

    `sample` and `finer` are the samples of both runs, and `floors` are bounds of round-off.
    """
    return differences(sample.outputs, finer.outputs, floors, [kind])[kind]


def _force_series(
    initial: Sample, samples: Sequence[Sample], in_the_mean: bool
) -> dict[str, ConvergenceSeries[ForceHistories]]:
    """Series of differences between the forces of runs with smaller and smaller steps, by kind of force.

    The kinds are those of `force_errors`.  `initial` is the run whose error is asked for, and `samples` are those of
    all runs, that with the longest step first.  If `in_the_mean` is true, the RMS values over time are compared.
    """
    of_given, first, *finer = (_rms_forces(run.forces) if in_the_mean else run.forces for run in (initial, *samples))
    by_kind = dict[str, ConvergenceSeries[ForceHistories]]()
    for kind in force_errors(of_given, finer[-1] if finer else first):
        by_kind[kind] = ConvergenceSeries(partial(_force_difference, kind), first, of_given)
        for forces in finer:
            by_kind[kind].add(forces)
    return by_kind


def _force_difference(kind: str, histories: ForceHistories, finer: ForceHistories) -> float:
    """Difference of a run to a finer run in a kind of forces, as a fraction of the finer run's; 0 without forces.

    `histories` and `finer` are the forces of the two runs.
    """
    return force_errors(histories, finer).get(kind, 0.0)


def _rms_forces(histories: ForceHistories) -> ForceHistories:
    """RMS over time of each force, as an array (1,), by kind and name."""
    return {kind: {name: _rms(force) for name, force in named.items()} for kind, named in histories.items()}


def _rms(y: Array) -> Array:
    """RMS over time of each of o outputs y (T, o), as an array (1, o)."""
    return np.asarray(np.sqrt(np.mean(y**2, axis=0, keepdims=True)))
