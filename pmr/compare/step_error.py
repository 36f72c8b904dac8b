r"""How far the time step itself is off: the same model once more with half the step, a quarter, and so on.

.. math::
    d_k = \lVert y_{h/2^k} - y_{h/2^{k+1}} \rVert, \qquad
    \lVert y_h - y \rVert \approx \lVert y_h - y_{h/2^n} \rVert + d_{n-1} \frac{\rho}{1 - \rho}, \qquad
    \rho = d_{n-1} / d_{n-2}

Generalized-alpha is of second order, so rho tends to 1/4 (Richardson's extrapolation) for motions that the steps
resolve, and to about 1/2 behind kinks and jumps.  Where it is above 0.6, the steps don't resolve the motion yet and
are halved again: two runs of which both miss it may agree.  Runs with shorter steps have a rho_inf of at least 0.95,
for with less all of them damp what they don't resolve, and agree on that, too.  Halving is what tells, doubling would
not: a tone that h can't tell from a slower one is none that 2 h can.

Reduced and full model take the same steps, so no comparison of the two shows this error.  What a user should know of it
is said in words here, too.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare import forces
from pmr.compare.covered import FAR
from pmr.compare.errors import relative_error
from pmr.compare.halved_steps import Ladder, Runs, Sampled, Stepped
from pmr.compare.outputs import Floors, differences
from pmr.errors import SimulationError
from pmr.errors.text import rounded
from pmr.results import Response
from pmr.results.quantities import QUANTITIES
from pmr.scene.signals import SignalBase
from pmr.simulation.excitation import Excitation
from pmr.simulation.stepping import TimeStepping
from pmr.system.states import SystemTrajectory
from pmr.system.system import System

Array = NDArray[np.float64]

#: Share of the motion above which a step is called too coarse.
LIMIT = 0.02
#: Margin of errors of forces of completed responses, whose differences fall less evenly than those of displacements.
MARGIN = 1.25


@dataclass(frozen=True)
class StepError:
    """Error that the time step leaves in a model's displacements; fractions of the finest run's motion, not capped."""

    beam: float
    tip: float
    largest: float | None  # m: largest difference of any output at any time; None by ``mean``
    finest: float  # s: smallest step that was taken
    settled: bool  # whether the runs approach each other; if not, the error is at least of this size
    by: str  # ``motion``; or ``mean``, of RMS values: rows only push, and the runs part after an impact
    enough: float | None  # s: largest of the steps taken with an error below `LIMIT`
    band: float | None  # Hz, above which 1 % of the tip's motion lies, as the finest run has it; None until `with_band`
    seconds: float  # wall time of all runs
    others: Mapping[str, float] = field(default_factory=dict)  # of further kinds of outputs and forces
    unsettled: tuple[str, ...] = ()  # those of the further kinds in which the runs do not approach each other

    def of(self, kind: str) -> float:
        """Error of a kind of outputs, a fraction; infinite where it was not wanted."""
        return {"beam": self.beam, "tip": self.tip, **self.others}.get(kind, np.inf)


def step_error(
    system: System,
    excitation: Excitation,
    run: SystemTrajectory | None = None,
    kinds: Sequence[str] = (),
    complete: Callable[[Response], Response] | None = None,
    band: bool = True,
) -> StepError:
    """Error of the time step, from the start of the excitation, with the `band` of the motion if it is wanted.

    `march` makes the runs; Exudyn's solver has the same scheme and start.  That with the given step may be known,
    a `run` that chose its parts.  The error of displacements is always found, that of further `kinds` of outputs
    (`pmr.compare.outputs`) on request: steps are halved until these are settled, too.  Where `complete` adds to a
    response the forces that follow from others, errors of all kinds of forces (`pmr.compare.forces`) come along, with
    a `MARGIN` and without steps beside kinks; they take no further runs.  Raises InputError as for
    `pmr.simulation.Simulator`; SimulationError if one of the first two runs fails, or the second would be too long.
    """
    begin, kinds = time.perf_counter(), [kind for kind in kinds if kind not in ("beam", "tip")]
    stepped = Stepped(system, excitation, run, complete)
    runs = Runs(stepped, "velocity" in kinds)
    first = runs.next()
    if not runs.affordable:
        raise SimulationError("a run with half the step is too long to be made only to estimate this error")
    of_run = runs.given(first)
    y, displacement_of_run = first.outputs.displacement, of_run.outputs.displacement
    moving, mean = (
        Ladder(relative_error, y, displacement_of_run),
        Ladder(relative_error, _rms(y), _rms(displacement_of_run)),
    )
    floors = Floors.of(system, excitation, of_run.outputs.force)
    ladders = {kind: Ladder(partial(_difference, kind, floors), first, of_run) for kind in kinds}
    samples = [first]
    while runs.affordable and not (
        moving.halvings(LIMIT) is not None and runs.resolved and all(steps.settled for steps in ladders.values())
    ):
        try:
            samples.append(runs.next())
        except SimulationError:
            if not moving.differences:
                raise
            break
        moving.add(samples[-1].outputs.displacement)
        mean.add(_rms(samples[-1].outputs.displacement))
        for force_ladder in ladders.values():
            force_ladder.add(samples[-1])
    ladder = mean if stepped.pushing and not moving.settled else moving
    halvings = ladder.halvings(LIMIT) if runs.resolved else None
    of_forces = _force_ladders(of_run, samples, in_the_mean=ladder is mean)
    return StepError(
        beam=ladder.error(),
        tip=ladder.error(relative_error(ladder.first[:, stepped.tips], ladder.last[:, stepped.tips])),
        largest=float(np.abs(ladder.first - ladder.last).max()) if ladder is moving else None,
        finest=runs.stepping.step,
        settled=ladder.settled and runs.resolved,
        by="motion" if ladder is moving else "mean",
        enough=None if halvings is None else stepped.given.step / 2**halvings,
        band=runs.band() if band else None,
        seconds=time.perf_counter() - begin,
        others={kind: MARGIN * steps.most for kind, steps in of_forces.items()}
        | {kind: steps.error() for kind, steps in ladders.items()},
        unsettled=(
            *(kind for kind, steps in of_forces.items() if not steps.is_decreasing),
            *(kind for kind, steps in ladders.items() if not steps.settled),
        ),
    )


def with_band(error: StepError, system: System, excitation: Excitation) -> StepError:
    """Return this error with the band of the motion, for which the run with the finest step is made once more."""
    runs = Runs(Stepped(system, excitation))
    runs.halved = round(np.log2(excitation.stepping.step / error.finest))
    return replace(error, band=runs.band())


def _difference(kind: str, floors: Floors, sampled: Sampled, finer: Sampled) -> float:
    """Difference of two runs in a kind of outputs, as a fraction of the finer run's."""
    return differences(sampled.outputs, finer.outputs, floors, [kind])[kind]


def _force_ladders(
    of_run: Sampled, samples: Sequence[Sampled], in_the_mean: bool
) -> dict[str, Ladder[forces.Histories]]:
    """Ladders of each kind of completed forces, of their RMS values where `in_the_mean`."""
    forces_of_run, *finer_forces = (_mean(run.forces) if in_the_mean else run.forces for run in (of_run, *samples))
    ladders = dict[str, Ladder[forces.Histories]]()
    for kind in forces.differences(forces_of_run, finer_forces[-1]):
        ladders[kind] = Ladder(partial(_forces_apart, kind), finer_forces[0], forces_of_run)
        for sampled in finer_forces[1:]:
            ladders[kind].add(sampled)
    return ladders


def _forces_apart(kind: str, histories: forces.Histories, finer: forces.Histories) -> float:
    """Difference of two runs in a kind of forces, as a fraction of the finer run's; 0 where they have none."""
    return forces.differences(histories, finer).get(kind, 0.0)


def _mean(of: forces.Histories) -> forces.Histories:
    """RMS values over time, (1,) each."""
    return {kind: {name: _rms(force) for name, force in named.items()} for kind, named in of.items()}


def _rms(y: Array) -> Array:
    """RMS of each output over time, (1, o)."""
    return np.asarray(np.sqrt(np.mean(y**2, axis=0, keepdims=True)))


def summary(error: StepError | None, reason: str | None = None, not_covered: Sequence[str] = ()) -> dict[str, Any]:
    """Figures of ``step`` in summary.json: the fields of `StepError`, further kinds, ``limit`` and ``reason``.

    ``not_covered`` lists in words what has no error.  Without a figure all are None, and ``reason`` says why.
    """
    names = [name for name in StepError.__annotations__ if name not in ("others", "unsettled")]
    figures = dict.fromkeys(names) if error is None else {name: getattr(error, name) for name in names}
    more = {"not_covered": list(not_covered), "limit": LIMIT, "reason": reason}
    return figures | dict(error.others if error else {}) | more


def warnings(
    step_error_of_run: StepError, stepping: TimeStepping, signals: Sequence[tuple[str, SignalBase]], natural: Array
) -> list[str]:
    """A line where the step's error exceeds `LIMIT`, of other outputs `FAR`, or is unknown; signals with their names.

    `natural` (S, f) in Hz are frequencies at S places on the way, ascending.
    """
    h = stepping.step
    if step_error_of_run.beam <= LIMIT and step_error_of_run.settled:
        far = [
            f"{_percent(error)} in {QUANTITIES[kind].label}"
            for kind, error in step_error_of_run.others.items()
            if error > FAR
        ]
        return [
            f"the time step of {h:.4g} s is off by {', '.join(far)}, as steps of {step_error_of_run.finest:.2g} s show"
        ] * any(far)
    size = f"{_percent(step_error_of_run.beam)} along the beam, {_percent(step_error_of_run.tip)} at the tip"
    if step_error_of_run.by == "mean":
        size += " in the mean (motions part after an impact, so they can't be compared instant by instant)"
    judged = (
        "is too coarse: its own error" if step_error_of_run.beam > LIMIT else "has an error that is not settled: it"
    )
    at_least = "" if step_error_of_run.settled else "at least "
    parts = [
        f"the time step of {h:.4g} s {judged} is {at_least}{size}, as steps of {step_error_of_run.finest:.2g} s show"
    ]
    parts += [_load(name, signal, stepping) for name, signal in signals if signal.highest_frequency(0.0, stepping.end)]
    if step_error_of_run.band is not None:
        parts.append(_motion(step_error_of_run.band, h, natural))
    if not step_error_of_run.settled:
        parts.append(f"even steps of {step_error_of_run.finest:.2g} s don't settle it")
    elif step_error_of_run.enough is not None:
        parts.append(f"steps of {step_error_of_run.enough:.2g} s bring the error below {100.0 * LIMIT:g} %")
    return ["; ".join(parts)]


def _load(name: str, signal: SignalBase, stepping: TimeStepping) -> str:
    f = signal.highest_frequency(0.0, stepping.end)
    return f"{name} goes up to {f:.4g} Hz, {_steps(f, stepping.step)}"


def _motion(band: float, h: float, natural: Array) -> str:
    """How far the motion's band reaches, by itself and in modes."""
    frequencies = natural[:, ~np.isnan(natural).all(axis=0)]  # some reduced models have fewer modes than are drawn
    lowest = np.sort(np.nanmin(frequencies, axis=0)) if frequencies.size else np.empty(0)
    sentence = f"the motion goes up to {band:.3g} Hz, {_steps(band, h)}"
    excited = int(np.count_nonzero(lowest <= band))
    if not excited:
        return sentence
    more = " or more" if excited == len(lowest) else ""
    number = f"number {excited}{more}"
    return f"{sentence}; the highest mode that it excites is {number}, {lowest[excited - 1]:.3g} Hz and above"


def _steps(frequency: float, h: float) -> str:
    return f"{rounded(1.0 / (frequency * h))} steps a period" if frequency > 0.0 else "no period"


def _percent(fraction: float) -> str:
    return f"{rounded(100.0 * fraction)} %" if fraction < 10.0 else f"{rounded(fraction)} times the motion"
