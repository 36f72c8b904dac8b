"""Part of a summary about the error of the time step, with warnings."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from pmr.compare.error_parts import SimulatedSystem
from pmr.compare.evaluation import evaluate_motion
from pmr.compare.outputs import fits_in_memory, has_impulsive_force
from pmr.compare.step_error import STEP_LIMIT, StepError, step_error, with_band
from pmr.compare.trust import FAR, SLIDER_IMPACTS, quantities_not_covered, unsettled_force_clauses
from pmr.errors import InputError, SimulationError
from pmr.errors.text import percent, two_digits
from pmr.files.arrays import Array
from pmr.results.quantities import QUANTITIES
from pmr.results.run import SummaryPart
from pmr.scene import Scene
from pmr.scene.keys import ALONE
from pmr.scene.signals import SignalBase
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.reactions import with_forces_on_machine

#: Fields of `StepError` that are entries of ``step`` in summary.json.
_FIGURES = ("largest", "finest", "settled", "by", "enough", "band", "seconds")


def step_part(
    scene: Scene, simulated: SimulatedSystem, natural: Array, step_estimate: StepError | None = None
) -> SummaryPart:
    """Entry ``step`` of summary.json, the error of the time step, with warnings.

    `natural` (S, f) in Hz are f natural frequencies in S positions on the way.  If the error is known already, it is
    passed as `step_estimate` and not computed again.  If the step was chosen by its error, as with `[accuracy]`, there
    is no warning about the size of the error.
    """
    system, excitation = simulated.system, simulated.excitation
    if scene.simulation.simulators[0] != "march":
        simulated = SimulatedSystem(system, excitation := Excitation.from_scene(scene))
    impacts = ALONE in system.reduced and has_impulsive_force(system.reduced[ALONE], excitation)
    complete = None if impacts else partial(with_forces_on_machine, scene)
    try:
        run = simulated.run if step_estimate is None and fits_in_memory(system, excitation.stepping) else None
        step_estimate = step_estimate or step_error(system, excitation, run, complete=complete)
        if step_estimate.band is None:
            step_estimate = with_band(step_estimate, system, excitation)
    except (SimulationError, InputError) as error:
        messages = [f"the error of the time step is not known: {error}"]
        return SummaryPart({"step": step_summary(None, str(error))}, messages)
    searched = scene.accuracy is not None
    messages = [] if searched else step_warnings(step_estimate, excitation.stepping, excitation.signals, natural)
    response = simulated.response or evaluate_motion(system, simulated.run)
    exact = ("frequency", *["pad_force"] * impacts)  # frequencies have no step; impacts have their own line
    lacking = quantities_not_covered(scene, with_forces_on_machine(scene, response), step_estimate.errors, exact)
    lacking = [SLIDER_IMPACTS] * impacts + lacking + unsettled_force_clauses(step_estimate.unsettled)
    return SummaryPart({"step": step_summary(step_estimate, not_covered=lacking)}, messages)


def step_summary(error: StepError | None, reason: str | None = None, not_covered: Sequence[str] = ()) -> dict[str, Any]:
    """Contents of ``step`` in summary.json: errors by kind, fields of `StepError`, ``limit`` and ``reason``.

    ``not_covered`` lists in words the quantities without an error.  If `error` is None, all fields are None, and
    ``reason`` says why.
    """
    errors = dict(error.errors) if error else {}
    figures = {kind: errors.get(kind) for kind in ("beam", "tip")} | {
        name: getattr(error, name, None) for name in _FIGURES
    }
    return figures | errors | {"not_covered": list(not_covered), "limit": STEP_LIMIT, "reason": reason}


def step_warnings(
    error: StepError, stepping: TimeStepping, signals: Sequence[tuple[str, SignalBase]], natural: Array
) -> list[str]:
    """A warning if the step's error is not settled or exceeds `STEP_LIMIT`, in other outputs `FAR`; else nothing.

    `signals` are pairs (name, signal) of path and loads; `natural` (S, f) in Hz are f frequencies in S positions on the
    way, ascending.
    """
    h, of_motion = stepping.step, error.error_of("beam")
    if of_motion <= STEP_LIMIT and error.settled:
        sizes = {kind: size for kind, size in error.errors.items() if size > FAR and kind not in ("beam", "tip")}
        far = [f"{percent(size, 'the motion')} in {QUANTITIES[kind].label}" for kind, size in sizes.items()]
        return [f"the time step of {h:.4g} s is off by {', '.join(far)}, as steps of {error.finest:.2g} s show"] * any(
            far
        )
    beam, tip = (percent(error.error_of(kind), "the motion") for kind in ("beam", "tip"))
    size = f"{beam} along the beam, {tip} at the tip"
    if error.by == "mean":
        size += " in the mean (motions part after an impact, so they can't be compared instant by instant)"
    judged = "is too coarse: its own error" if of_motion > STEP_LIMIT else "has an error that is not settled: it"
    at_least = "" if error.settled else "at least "
    parts = [f"the time step of {h:.4g} s {judged} is {at_least}{size}, as steps of {error.finest:.2g} s show"]
    parts += [
        _load_clause(name, signal, stepping) for name, signal in signals if signal.highest_frequency(0.0, stepping.end)
    ]
    if error.band is not None:
        parts.append(_motion_clause(error.band, h, natural))
    if not error.settled:
        parts.append(f"even steps of {error.finest:.2g} s don't settle it")
    elif error.enough is not None:
        parts.append(f"steps of {error.enough:.2g} s bring the error below {100.0 * STEP_LIMIT:g} %")
    return ["; ".join(parts)]


def _load_clause(name: str, signal: SignalBase, stepping: TimeStepping) -> str:
    """Clause about the highest frequency of the signal `name` and the number of steps in a period of it."""
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
    """How many steps of h in s a period of `frequency` in Hz takes, in words; "no period" for 0."""
    return f"{two_digits(1.0 / (frequency * h))} steps a period" if frequency > 0.0 else "no period"
