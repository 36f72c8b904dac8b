"""Trials: runs of reduced models of several sizes with several steps, each with an estimate of its own errors.

One reduction of each body with all its enrichment modes contains every smaller model (`pmr.system.truncation`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pmr.compare.estimate import MARGIN, Estimate, estimate_error
from pmr.compare.evaluation import SimulatedSystem
from pmr.compare.motion import Models
from pmr.compare.outputs import (
    OUTPUT_KINDS,
    Outputs,
    RoundOffBounds,
    differences,
    divide_steps,
    fits_in_memory,
    force_kinds_of_system,
    has_impulsive_force,
    outputs_of_run,
    run_from_start,
    without_kink_forces,
)
from pmr.compare.step_error import StepError, step_error
from pmr.compare.stepped_runs import reference_rho
from pmr.errors import InputError, SimulationError
from pmr.scene.keys import ALONE, qualified_name
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.native import systems
from pmr.simulation.native.form import SystemForm
from pmr.simulation.stepping import describe_lost_features
from pmr.system.body import length_outputs, names_of, other_outputs
from pmr.system.reduced_model import ReducedModel
from pmr.system.states import SystemTrajectory
from pmr.system.system import System
from pmr.system.truncation import extend, truncate

Sizes = tuple[int, ...]  # modes of each body

#: Errors of a run after which its model or step is not considered.  A run is refused, for example, if rho_inf is 1 and
#: its model keeps all modes, so that no residual flexibility is left in its rows.
FAILURES = (SimulationError, InputError)
#: Number of enrichment modes that every model keeps for its estimate; at most a quarter of all modes.
ENRICHMENT = 4
#: Largest number of steps of a run: for a single body; and for several bodies, whose steps take ten times as long.
LONGEST, LONGEST_OF_SEVERAL = 512_000, 64_000
#: A run may always have this many times the scene's number of steps.  If contacts only push, this is also the limit:
#: impacts divide steps into equally short parts with any number of steps.
FINER = 4
#: Largest error of a step, a fraction of the motion, with which the error of the reduction can be estimated.
RESOLVED = 0.05
#: Largest number of times that the scene's step is doubled, and least number of steps of a run.
COARSER, FEWEST = 6, 20
#: Number of steps of the runs by which a step is timed, and number of these runs.
TIMED, TIMES = 4096, 3


@dataclass(frozen=True)
class Trial:
    """Model sizes and a step, with errors of their run by kind of output: fractions with margin, inf if unknown."""

    sizes: Sizes
    coordinates: int  # number for all bodies, with modes of cylinders
    steps: int
    reduction: Mapping[str, float]  # errors of the reduction
    step: Mapping[str, float]  # errors of the time step
    settled: bool  # whether runs with shorter steps approach each other; if not, the step's error may be larger
    estimate: Estimate | None  # estimated error of the run's reduction; None if the estimate failed
    step_error: StepError | None  # error of the run's step; None if it could not be computed

    @property
    def total(self) -> dict[str, float]:
        """Sum of the errors of reduction and step, a fraction, by kind of output."""
        return {kind: size + self.step[kind] for kind, size in self.reduction.items()}


class Trials:
    """Runs of a system for any number of modes of each body and any number of steps; each run is made only once.

    `models` are reductions on free modes, by name of the body, whose errors can be estimated
    (`pmr.compare.motion.reason_without_estimate` returns None).  `join` makes the system that is simulated from models
    of any size.  Errors are given for the `kinds` of outputs, which are stored as `wanted`.  `sizes` are always numbers
    of modes, one for each body.
    """

    def __init__(
        self,
        models: Models,
        join: Callable[[Models], System],
        excitation: Excitation,
        kinds: Sequence[str] = ("beam", "tip"),
    ) -> None:
        """Prepare runs of the system that `join` makes of `models`, the bodies' reductions by name.

        Errors are computed for the `kinds` of outputs.  Nothing is simulated yet.
        """
        self.excitation, self.wanted = excitation, tuple(kinds)
        self._join = join
        self._wholes = {name: model if model.enrichment is None else extend(model) for name, model in models.items()}
        self.own: Sizes = tuple(model.size for model in models.values())
        self._rigid = [_rigid(model) for model in self._wholes.values()]
        #: Least number of elastic modes of any body, and largest number of modes of each.
        self.least = int(min(self._rigid) == 0)
        wholes = [model.size for model in self._wholes.values()]
        self.most: Sizes = tuple(
            max(rigid + self.least, scene_size, full_size - max(1, min(ENRICHMENT, full_size // 4)))
            for rigid, scene_size, full_size in zip(self._rigid, self.own, wholes, strict=True)
        )
        self._systems, self._last = dict[Sizes, System](), dict[tuple[Sizes, int], SystemTrajectory]()
        self._estimates = dict[tuple[Sizes, int], Estimate | None]()
        self._step_errors = dict[tuple[Sizes, int], StepError | None]()
        self._differences = dict[tuple[Sizes, int, Sizes, int], dict[str, float]]()

    @cached_property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of the system's outputs, in a fixed order.

        The first two are of displacements, ``beam`` and ``tip``; the kinds of the system's forces and ``velocity``
        follow.  A single body has the force ``pad_force`` alone.  ``probe`` comes last if a body has probes or
        rotations.
        """
        alone, system = ALONE in self._wholes, self.system(self.own)
        forces = dict.fromkeys(["pad_force"] if alone else force_kinds_of_system(system))
        probes = ["probe"] * any(np.any(other_outputs(model)) for model in self._wholes.values())
        return tuple(dict.fromkeys((*OUTPUT_KINDS[:2], *forces, "velocity", *probes)))

    @property
    def has_impulsive_forces(self) -> bool:
        """Whether forces of a single body have no limit, as those of rigid sliders at kinks of the path.

        The result is false for booms of sections, whose forces are compared between kinks only.
        """
        return ALONE in self._wholes and has_impulsive_force(self._wholes[ALONE], self.excitation)

    @property
    def has_pushing_contacts(self) -> bool:
        """Whether any contact of the system only pushes."""
        return not np.isnan(self.system(self.own).clearance).all()

    @property
    def most_steps(self) -> int:
        """Largest number of steps that a run may have."""
        least = FINER * self.excitation.stepping.steps
        return least if self.has_pushing_contacts else max(least, LONGEST if len(self.own) == 1 else LONGEST_OF_SEVERAL)

    @property
    def output_positions(self) -> list[tuple[str, float]]:
        """Name of each displacement output and its position along its body in m."""
        positions = list[tuple[str, float]]()
        for name, body in self._wholes.items():
            names = [qualified_name(name, output) for output in names_of(body)]
            places = zip(names, body.output_positions.tolist(), length_outputs(body), strict=True)
            positions += [(output, x) for output, x, is_length in places if is_length]
        return positions

    def fewest_steps(self, every: float | None = None) -> int:
        """Smallest number of steps that still follow path and loads, found by halving the scene's number.

        If `every` in s is not None, it remains a multiple of the step.  If contacts only push, the number is the
        scene's own: impacts divide steps into parts anyhow, so longer steps would save nothing.
        """
        steps = self.excitation.stepping.steps
        for _ in range(0 if self.has_pushing_contacts else COARSER):
            if steps % 2 or steps < 2 * FEWEST:
                break
            half = self.with_steps(steps // 2)
            share = 0.0 if every is None else every / half.stepping.step
            if abs(share - round(share)) > 1e-9 * share or describe_lost_features(half.signals, half.stepping):
                break
            steps //= 2
        return steps

    def with_steps(self, steps: int) -> Excitation:
        """The excitation on a time grid of `steps` equal steps, with the same end and rho_inf."""
        grid = self.excitation.stepping
        return self.excitation.on_grid(TimeStepping(grid.end, grid.end / steps, grid.rho_inf))

    def uniform_sizes(self, elastic: int) -> Sizes:
        """Sizes with `elastic` elastic modes of each body, or all elastic modes of bodies that have fewer."""
        return self.cap_sizes(self.most, elastic)

    def cap_sizes(self, sizes: Sizes, elastic: int) -> Sizes:
        """Return `sizes` with at most `elastic` elastic modes for each body."""
        return tuple(min(size, rigid + elastic) for size, rigid in zip(sizes, self._rigid, strict=True))

    def most_elastic_modes(self, sizes: Sizes) -> int:
        """Largest number of elastic modes that any body has with these sizes."""
        return max(size - rigid for size, rigid in zip(sizes, self._rigid, strict=True))

    def double_sizes(self, sizes: Sizes) -> Sizes:
        """Return `sizes` with twice the number of elastic modes of each body, or with all where a body has fewer.

        A body without elastic modes gets one.
        """
        of_bodies = zip(sizes, self._rigid, self.most, strict=True)
        return tuple(max(size, min(rigid + max(2 * (size - rigid), 1), most)) for size, rigid, most in of_bodies)

    def neighbouring_sizes(self, sizes: Sizes, step: int) -> list[Sizes]:
        """All possible sizes with `step` modes more in one body, and with those of `sizes` in the others.

        `step` is negative for fewer modes.
        """
        bounds = zip(sizes, self._rigid, self.most, strict=True)
        possible = [rigid + self.least <= size + step <= max(most, size) for size, rigid, most in bounds]
        return [(*sizes[:k], size + step, *sizes[k + 1 :]) for k, size in enumerate(sizes) if possible[k]]

    def models(self, sizes: Sizes) -> dict[str, ReducedModel]:
        """Models truncated to these sizes, by name of the body; models of sections have no modes of cylinders."""
        of_bodies = zip(self._wholes.items(), sizes, strict=True)
        return {name: truncate(model, size) if size < model.size else model for (name, model), size in of_bodies}

    def system(self, sizes: Sizes) -> System:
        """System that is simulated with models of these sizes; each system is joined only once."""
        if sizes not in self._systems:
            self._systems[sizes] = self._join(self.models(sizes))
        return self._systems[sizes]

    def coordinates(self, sizes: Sizes) -> int:
        """Number of coordinates of all bodies together, for models of these sizes; modes of cylinders are included."""
        return sum(body.size for body in self.system(sizes).bodies.values())

    def estimate_trial(self, sizes: Sizes, steps: int) -> Trial:
        """Run models of these sizes with `steps` steps and estimate the errors of the run."""
        reduction, step, at = self.reduction_errors(sizes, steps), self.step_errors(sizes, steps), (sizes, steps)
        of_run = self._estimates[at], self._step_errors[at]
        return Trial(sizes, self.coordinates(sizes), steps, reduction, step, self.is_settled(sizes, steps), *of_run)

    def is_resolved(self, sizes: Sizes, steps: int) -> bool:
        """Whether a run with this number of steps is accurate enough in time to tell the error of a reduction.

        The run is accurate enough if the error of the step is settled, and at most `RESOLVED` in every kind of output.
        `sizes` are those of the models.  Only to be called after `step_errors` for the same sizes and steps.
        """
        run_error = self._step_errors[sizes, steps]
        return run_error is not None and run_error.settled and max(self.step_errors(sizes, steps).values()) <= RESOLVED

    def fewest_resolving_steps(self, steps: int) -> int:
        """Smallest number of steps, at most `steps`, with which one of the runs so far has resolved the motion.

        If no run with fewer steps has resolved it, the result is `steps`.
        """
        return min(
            (count for sizes, count in self._step_errors if count < steps and self.is_resolved(sizes, count)),
            default=steps,
        )

    def difference_to_trial(self, trial: Trial, sizes: Sizes, steps: int) -> dict[str, float]:
        """Error, by kind of output, of models of these `sizes`, smaller than the trial's: the difference of two runs.

        Both runs have `steps` steps.  Modes that neither model has are not in this difference, so the trial's own error
        is added as the root of the sum of squares.  If contacts only push, both runs divide their steps alike, so that
        the difference is due to the reduction, not to the time of impacts.  All errors are inf if a run fails.
        """
        key = trial.sizes, trial.steps, sizes, steps
        if key not in self._differences:
            excitation = self.with_steps(steps)
            try:
                if self.has_pushing_contacts:
                    system = self.system(trial.sizes)
                    excitation = divide_steps(system, excitation, self._run(trial.sizes, steps))
                better, fewer = (self.motion(of_bodies, excitation) for of_bodies in (trial.sizes, sizes))
                floors = RoundOffBounds.for_system(self.system(trial.sizes), excitation, better.force)
                apart = differences(fewer, better, floors, self.wanted)
                errors = {kind: float(np.hypot(MARGIN * apart[kind], trial.reduction[kind])) for kind in self.wanted}
            except FAILURES:
                errors = dict.fromkeys(self.wanted, np.inf)
            self._differences[key] = errors
        return self._differences[key]

    def reduction_errors(self, sizes: Sizes, steps: int) -> dict[str, float]:
        """Estimated error of the reduction by kind, a fraction, in a run of `steps` steps with models of these sizes.

        The error is inf for kinds without an estimate, and for all kinds if the run or its estimate fails.  For forces
        of several sections it is the error between kinks, where that is estimated.
        """
        if (sizes, steps) not in self._estimates:
            try:
                run = self._run(sizes, steps)
                simulated = SimulatedSystem(self.system(sizes), self.with_steps(steps), run)
                run_estimate = estimate_error(self.models(sizes), simulated)
            except FAILURES:
                run_estimate = None
            self._estimates[sizes, steps] = run_estimate
        errors = {} if (of_run := self._estimates[sizes, steps]) is None else of_run.errors
        between = "" if ALONE in self._wholes else "_between_kinks"
        return {kind: errors.get(f"{kind}{between}", errors.get(kind, np.inf)) for kind in self.wanted}

    def step_errors(self, sizes: Sizes, steps: int) -> dict[str, float]:
        """Error of the step by kind, a fraction, in a run of `steps` steps with models of these `sizes`.

        The error is infinite if it could not be computed.
        """
        if (sizes, steps) not in self._step_errors:
            system, excitation = self.system(sizes), self.with_steps(steps)
            try:
                run = self._run(sizes, steps) if fits_in_memory(system, excitation.stepping) else None
                self._step_errors[sizes, steps] = step_error(system, excitation, run, self.wanted)
            except FAILURES:
                self._step_errors[sizes, steps] = None
        run_error = self._step_errors[sizes, steps]
        return {kind: np.inf if run_error is None else run_error.error_of(kind) for kind in self.wanted}

    def is_settled(self, sizes: Sizes, steps: int) -> bool:
        """Whether shorter and shorter steps bring runs with models of these `sizes` closer to each other.

        The first of these runs has `steps` steps.  The result is true if this holds in all wanted kinds of
        outputs, and False if the error of the step could not be computed.  Only to be called after `step_errors` for
        the same sizes and steps.
        """
        run_error = self._step_errors[sizes, steps]
        return run_error is not None and run_error.settled and not set(run_error.unsettled) & set(self.wanted)

    def motion(self, sizes: Sizes, excitation: Excitation) -> Outputs:
        """Outputs at all steps of a run with models of these `sizes`.

        Forces of sections are set to zero near kinks of their extensions.
        """
        system = self.system(sizes)
        run = run_from_start(system, excitation)
        run_outputs = outputs_of_run(system, run, excitation, rates="velocity" in self.wanted)
        return without_kink_forces(system, run_outputs, excitation, excitation.times, excitation.stepping.step)

    def run_undamped(self, sizes: Sizes, steps: int) -> Outputs:
        """Outputs of a run of `steps` steps, with models of these `sizes` and little numerical damping.

        The damping is that of `pmr.compare.stepped_runs.reference_rho`.
        """
        system, excitation = self.system(sizes), self.with_steps(steps)
        grid = excitation.stepping
        stepping = TimeStepping(grid.end, grid.step, reference_rho(system, grid.rho_inf))
        return self.motion(sizes, excitation.with_stepping(stepping))

    def seconds_per_step(self, sizes: Sizes) -> float:
        """Shortest time in s that a step of the compiled simulator takes here, with models of these `sizes`."""
        form, excitation = SystemForm.of(self.system(sizes)), self.with_steps(TIMED)
        return min(systems.observe(form, excitation, every=TIMED).seconds for _ in range(TIMES)) / TIMED

    def _run(self, sizes: Sizes, steps: int) -> SystemTrajectory:
        """Motion at all steps of a run of `steps` steps with models of these `sizes`; the last motion is stored."""
        if (sizes, steps) not in self._last:
            self._last = {(sizes, steps): run_from_start(self.system(sizes), self.with_steps(steps))}
        return self._last[sizes, steps]


def _rigid(model: ReducedModel) -> int:
    """Number of rigid-body modes of a model."""
    stiffness = np.diagonal(model.K)
    return int(np.count_nonzero(stiffness <= 1e-9 * stiffness[-1]))
