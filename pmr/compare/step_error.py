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
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare import forces
from pmr.compare.covered import FAR, FIGURES
from pmr.compare.halved_steps import NEGLIGIBLE, ROUGH, Ladder, Runs, Seen, Stepped
from pmr.errors import SimulationError
from pmr.errors.text import rounded
from pmr.results import Response
from pmr.scene.signals import SignalBase
from pmr.simulation.excitation import Excitation
from pmr.simulation.stepping import TimeStepping
from pmr.system.system import System, SystemTrajectory

Array = NDArray[np.float64]

#: Share of the motion above which a step is called too coarse.
LIMIT = 0.02
#: Margin of errors of forces, whose differences fall less evenly than those of displacements.
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
    band: float  # Hz, above which 1 % of the tip's motion lies, as the finest run has it
    seconds: float  # wall time of all runs
    forces: Mapping[str, float] = field(default_factory=dict)  # by kind (`pmr.compare.forces`), not beside kinks
    unsettled: Sequence[str] = ()  # kinds of forces in which the runs do not approach each other


def step_error(
    system: System,
    excitation: Excitation,
    run: SystemTrajectory | None = None,
    complete: Callable[[Response], Response] | None = None,
) -> StepError:
    """Error of the time step, from the start of the excitation.

    Errors of forces are found where responses are to be completed: `complete` adds forces that follow from others.

    `march` makes the runs; Exudyn's solver has the same scheme and start.  That with the given step may be known,
    a `run` that chose its parts.  Raises InputError as for
    `pmr.simulation.Simulator`; SimulationError if one of the first two runs fails, or the second would be too long.
    """
    begin = time.perf_counter()
    stepped = Stepped(system, excitation, run, complete)
    runs = Runs(stepped)
    first = runs.next()
    if not runs.affordable:
        raise SimulationError("a run with half the step is too long to be made only to estimate this error")
    given = runs.given(first)
    moving, mean = Ladder(first.moved, given.moved), Ladder(_rms(first.moved), _rms(given.moved))
    seen = [first]
    while runs.affordable and not (moving.halvings(LIMIT) is not None and runs.resolved):
        try:
            seen = [*seen[-2:], runs.next()]
        except SimulationError:
            if not moving.differences:
                raise
            break
        moving.add(seen[-1].moved)
        mean.add(_rms(seen[-1].moved))
    ladder = mean if stepped.pushing and not moving.settled else moving
    halvings = ladder.halvings(LIMIT) if runs.resolved else None
    of_forces, unsettled = _force_errors(given, seen, by_mean=ladder is mean)
    return StepError(
        beam=ladder.error(slice(None)),
        tip=ladder.error(stepped.tips),
        largest=float(np.abs(ladder.first - ladder.last).max()) if ladder is moving else None,
        finest=runs.stepping.step,
        settled=ladder.settled and runs.resolved,
        by="motion" if ladder is moving else "mean",
        enough=None if halvings is None else stepped.given.step / 2**halvings,
        band=runs.band(),
        seconds=time.perf_counter() - begin,
        forces=of_forces,
        unsettled=unsettled,
    )


def _rms(y: Array) -> Array:
    """Of each output over time, (1, o)."""
    return np.asarray(np.sqrt(np.mean(y**2, axis=0, keepdims=True)))


def _force_errors(given: Seen, seen: Sequence[Seen], by_mean: bool) -> tuple[dict[str, float], list[str]]:
    """Errors of the `given` run's forces by kind, and kinds in which the last three runs don't approach each other.

    What runs beyond the last one would add is that of a geometric series, as for displacements.
    """
    every = [one.forces for one in (given, *seen)]
    if any(one is None for one in every):
        return {}, []
    known = [one for one in every if one is not None]
    if by_mean:
        known = [{key: {name: _rms(f) for name, f in kind.items()} for key, kind in one.items()} for one in known]
    errors, unsettled = forces.differences(known[0], known[-1]), list[str]()
    apart = [forces.differences(*pair) for pair in zip(known[1:], known[2:], strict=False)]
    for kind, error in errors.items():
        before, last = (apart[-2][kind], apart[-1][kind]) if len(apart) > 1 else (0.0, np.inf)
        ratio = last / before if before > 0.0 else np.inf
        if last > NEGLIGIBLE and ratio > ROUGH:
            unsettled.append(kind)
        errors[kind] = MARGIN * (error + last * min(1.0, ratio / (1.0 - min(ratio, ROUGH))))
    return errors, unsettled


def summary(found: StepError | None, reason: str | None = None, not_covered: Sequence[str] = ()) -> dict[str, Any]:
    """What summary.json holds under ``step``: the fields of `StepError`, kinds of forces, ``limit`` and ``reason``.

    ``not_covered`` lists in words what has no error.  Without a figure all are None, and ``reason`` says why.
    """
    figures = dict.fromkeys(StepError.__annotations__) if found is None else dict(vars(found))
    of_forces = figures.pop("forces") or {}
    del figures["unsettled"]
    return figures | dict(of_forces) | {"not_covered": list(not_covered), "limit": LIMIT, "reason": reason}


def warnings(
    found: StepError, stepping: TimeStepping, signals: Sequence[tuple[str, SignalBase]], natural: Array
) -> list[str]:
    """A line where the step's error exceeds `LIMIT`, of forces `FAR`, or is unknown; signals with their names.

    `natural` (S, f) in Hz are frequencies at S places on the way, ascending.
    """
    h = stepping.step
    if found.beam <= LIMIT and found.settled:
        far = {kind: error for kind, error in found.forces.items() if error > FAR}
        said = ", ".join(f"{_percent(error)} in {FIGURES[kind]}" for kind, error in far.items())
        return [f"the time step of {h:.4g} s is off by {said}, as steps of {found.finest:.2g} s show"] if far else []
    size = f"{_percent(found.beam)} along the beam, {_percent(found.tip)} at the tip"
    if found.by == "mean":
        size += " in the mean (motions part after an impact, so they can't be compared instant by instant)"
    judged = "is too coarse: its own error" if found.beam > LIMIT else "has an error that is not settled: it"
    at_least = "" if found.settled else "at least "
    parts = [f"the time step of {h:.4g} s {judged} is {at_least}{size}, as steps of {found.finest:.2g} s show"]
    parts += [_load(name, signal, stepping) for name, signal in signals if signal.highest_frequency(0.0, stepping.end)]
    parts.append(_motion(found.band, h, natural))
    if not found.settled:
        parts.append(f"even steps of {found.finest:.2g} s don't settle it")
    elif found.enough is not None:
        parts.append(f"steps of {found.enough:.2g} s bring the error below {100.0 * LIMIT:g} %")
    return ["; ".join(parts)]


def _load(name: str, signal: SignalBase, stepping: TimeStepping) -> str:
    f = signal.highest_frequency(0.0, stepping.end)
    return f"{name} goes up to {f:.4g} Hz, {_steps(f, stepping.step)}"


def _motion(band: float, h: float, natural: Array) -> str:
    """How far the motion's band reaches, by itself and in modes."""
    known = natural[:, ~np.isnan(natural).all(axis=0)]  # some reduced models have fewer modes than are drawn
    lowest = np.sort(np.nanmin(known, axis=0)) if known.size else np.empty(0)
    said = f"the motion goes up to {band:.3g} Hz, {_steps(band, h)}"
    excited = int(np.count_nonzero(lowest <= band))
    if not excited:
        return said
    more = " or more" if excited == len(lowest) else ""
    return f"{said}; the highest mode that it excites is number {excited}{more}, {lowest[excited - 1]:.3g} Hz and above"


def _steps(frequency: float, h: float) -> str:
    return f"{rounded(1.0 / (frequency * h))} steps a period" if frequency > 0.0 else "no period"


def _percent(fraction: float) -> str:
    return f"{rounded(100.0 * fraction)} %" if fraction < 10.0 else f"{rounded(fraction)} times the motion"
