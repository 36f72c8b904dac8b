"""Errors of the reduction and of the time step that a run estimates without a reference, as parts of its summary."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter1d

from pmr.compare.estimate import MARGIN, Estimate, UnsettledError, estimate_by_other_model, estimate_error
from pmr.compare.evaluation import SimulatedSystem
from pmr.compare.model_part import FREQUENCIES, evenly_spaced_steps, frequency_error
from pmr.compare.motion import reason_without_estimate
from pmr.compare.outputs import OUTPUT_KINDS, fits_in_memory, has_impulsive_force, tip_columns
from pmr.compare.step_error import STEP_LIMIT, StepError, step_error
from pmr.compare.trust import (
    FAR,
    MACHINE_MOTION,
    RIGID_REACTIONS,
    SECOND_ORDER_EFFECTS,
    SLIDER_IMPACTS,
    coverage_warnings,
    effects_not_covered,
    quantities_not_covered,
    stress_clauses,
)
from pmr.errors import InputError, SimulationError, percent, two_digits
from pmr.files.arrays import Array
from pmr.results.quantities import QUANTITIES
from pmr.results.run import SummaryPart
from pmr.scene import Scene
from pmr.scene.keys import ALONE
from pmr.scene.signals import SignalBase
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.excitation import side_positions
from pmr.simulation.frame_motion import has_computed_motion
from pmr.simulation.modal import modal_form
from pmr.simulation.reactions import with_forces_on_machine
from pmr.system.assembly import Assembly
from pmr.system.attachment import has_frame_matrices
from pmr.system.reduced_model import ReducedModel
from pmr.system.system import System
from pmr.system.truncation import extend

#: A warning asks for more modes if more than this share of the first truncated mode's motion is not quasi-static.
REACHED = 0.5
#: Largest product of step and highest circular frequency with which a moving slider was stable with rho_inf = 1.
RESOLVED = 2.0
#: Keys of every estimate in summary.json that are not kinds of outputs.
_FIGURES = ("probes", "by", "chi", "largest", "seconds", "not_covered")


@dataclass(frozen=True)
class ReductionError:
    """Estimated error of the reduction: its part of a summary (``estimate``), its band over time, errors by section."""

    part: SummaryPart
    band: Array | None = None  # (T, d) m: error over time of each of the tip's d displacements, with margin
    sections: Mapping[str, float] = field(default_factory=dict)  # by section of a boom: error along it, a fraction

    def of_section(self, name: str) -> dict[str, Any]:
        """Return the part of summary.json on the section `name`, with its error as ``estimate``.

        The part is empty if the section has no estimate.
        """
        return {"estimate": self.sections[name]} if name in self.sections else {}


def estimate_reduction(
    scene: Scene,
    simulated: SimulatedSystem,
    other: ReducedModel | None = None,
    estimated: Estimate | None = None,
) -> ReductionError:
    """Estimate the error of the reduction by enrichment modes, or for a single body by the `other` model.

    Nothing is simulated unless all sections of the scene ask for an estimate.  The result lists the effects that the
    error does not cover, and warns of them; if there is no estimate, it has the reason.  The entry ``estimate`` is
    missing if a section of the scene asks for no estimate.  Further warnings are those of `estimate_warnings`.  `other`
    is None for booms of several sections.  If `estimated` is not None, it is taken as the estimate, which is then not
    computed.
    """
    system, excitation = simulated.system, simulated.excitation
    models = system.modal
    is_wanted = all(part.reduction.estimate for part in scene.sections)
    telling = models if other is None else {ALONE: other}

    failed, scattered = "", list[str]()
    if is_wanted and reason_without_estimate(telling) is None:
        try:
            if other is not None:
                estimated = estimate_by_other_model(system, other, excitation)
            elif estimated is None:
                estimated = estimate_error(models, simulated)
        except (SimulationError, InputError) as error:  # other simulators may run systems that march refuses
            # forces that differ much between nearly equal models
            scattered = [error.warning] if isinstance(error, UnsettledError) and error.warning else []
            estimated, failed = None, str(error)
    if estimated is None:
        figures = dict.fromkeys((*OUTPUT_KINDS, *_FIGURES)) | {"reason": failed or reason_without_estimate(models)}
        messages = estimate_warnings(models, excitation.stepping, None) + scattered
        return ReductionError(SummaryPart({"estimate": figures} if is_wanted else {}, messages))
    stated = {"reaction"} & {*estimated.errors, *estimated.unknown}
    held = not stated and any(body.reactions is not None for body in system.bodies.values())
    left_out = _effects_left_out(telling, system, excitation, estimated.enrichment)
    left_out += [*stress_clauses(scene), *[RIGID_REACTIONS] * held]
    left_out += [*[MACHINE_MOTION] * has_computed_motion(scene), *estimated.unknown.values()]
    messages = estimate_warnings(models, excitation.stepping, estimated) + coverage_warnings(left_out)
    messages += [estimated.scatter] if estimated.scatter else []
    figures = estimate_summary(estimated, left_out) | {"frequency": _frequency_error(models, system, excitation)}
    part = SummaryPart({"estimate": figures} if is_wanted else {}, messages)
    return ReductionError(part, error_envelope(MARGIN * estimated.error[:, tip_columns(system)]), estimated.bodies)


def _frequency_error(models: Mapping[str, ReducedModel], system: System, excitation: Excitation) -> float | None:
    """Error of the two lowest natural frequencies along the path, a fraction with margin, by the enrichment modes.

    `models` are the bodies by name.  None is returned if errors can't be estimated (`reason_without_estimate`) or if
    nothing vibrates.
    """
    if reason_without_estimate(models) is not None:
        return None
    steps = evenly_spaced_steps(excitation)
    x, c = side_positions(system, excitation)[steps], excitation.amplitudes(system.term_names)[steps]
    richer = system.with_bodies({name: extend(model) for name, model in models.items()})
    lowest, better = (Assembly(compared_system).frequencies(x, FREQUENCIES, c) for compared_system in (system, richer))
    apart = frequency_error(lowest, better)
    return None if apart is None else MARGIN * apart


def _effects_left_out(
    models: Mapping[str, ReducedModel], system: System, excitation: Excitation, count: int | None
) -> list[str]:
    """Clauses about effects that an estimate of the error leaves out.

    The estimate has up to `count` enrichment modes of each body, all if `count` is None.  `models` are the bodies by
    name.
    """
    stressed = [SECOND_ORDER_EFFECTS] * (bool(system.terms) and not all(map(has_frame_matrices, models.values())))
    if ALONE in models:
        return [*stressed, *effects_not_covered(models[ALONE], excitation.signals, excitation.stepping, count)]
    damped = any(body.rayleigh is None and body.D.any() for body in system.reduced.values())
    return [*["the damping of what the modes leave out, which is not Rayleigh's"] * damped, *stressed]


def estimate_summary(estimated: Estimate, not_covered: Sequence[str] = ()) -> dict[str, Any]:
    """Contents of ``estimate`` in summary.json: fractions by kind of output, ``probes`` by name, ``chi`` and more.

    Kinds of outputs without an estimate are None; ``not_covered`` lists the effects that the estimate leaves out.
    """
    figures = {name: getattr(estimated, name) for name in _FIGURES if name != "not_covered"}
    return dict.fromkeys(OUTPUT_KINDS) | dict(estimated.errors) | figures | {"not_covered": list(not_covered)}


def estimate_warnings(
    models: Mapping[str, ReducedModel], stepping: TimeStepping, estimated: Estimate | None
) -> list[str]:
    """Warnings about too few coordinates and, for a body alone with a moving slider, about too long a step.

    The step is too long if it does not resolve the highest mode although rho_inf is 1, so that nothing damps it.
    `models` are the reduced bodies by name; `estimated` is None if there is no estimate.
    """
    beam, chi = (0.0, 0.0) if estimated is None else (estimated.error_of("beam"), estimated.chi or 0.0)
    messages = []
    if beam > 0.0 and chi > REACHED:
        messages.append(f"load or slide excite the first truncated mode (chi = {chi:.2f}): more coordinates help most")
    for model in [models[ALONE]] if ALONE in models else []:
        fastest = stepping.step * float(np.sqrt(np.max(modal_form(model).omega2, initial=0.0)))
        if stepping.rho_inf == 1.0 and fastest > RESOLVED and model.moving:
            messages.append(
                f"the step does not resolve the highest mode (h omega = {two_digits(fastest)}) and rho_inf = 1 damps "
                "nothing: with a moving slider this can grow; a smaller step, rho_inf < 1 or fewer coordinates help"
            )
    return messages


def error_envelope(error: Array) -> Array:
    """Largest absolute value (T, o) of `error` (T, o) in a window around each step.

    For each output, the window has the width of two mean periods of the error, by its changes of sign.
    """
    signs = np.signbit(error)
    crossings = np.count_nonzero(signs[1:] != signs[:-1], axis=0)
    width = np.empty_like(error)
    for k, count in enumerate(crossings):
        size = min(len(error), 4 * len(error) // max(int(count), 1))
        width[:, k] = maximum_filter1d(np.abs(error[:, k]), size)
    return width


#: Fields of `StepError` that are entries of ``step`` in summary.json.
_STEP_FIGURES = ("largest", "finest", "settled", "by", "enough", "band", "seconds")


def step_part(
    scene: Scene, simulated: SimulatedSystem, natural: Array, step_estimate: StepError | None = None
) -> SummaryPart:
    """Entry ``step`` of summary.json, the error of the time step, with warnings.

    `natural` (S, f) in Hz are f natural frequencies in S positions on the way.  If `step_estimate` is not None, it is
    taken as the error and nothing is computed.  If the step was chosen by its error, as with `[accuracy]`, there is no
    warning about the size of the error.
    """
    system, excitation = simulated.system, simulated.excitation
    if scene.simulation.simulators[0] != "march":
        simulated = SimulatedSystem(system, excitation := Excitation.from_scene(scene))
    impacts = ALONE in system.reduced and has_impulsive_force(system.reduced[ALONE], excitation)
    complete = None if impacts else partial(with_forces_on_machine, scene)
    try:
        run = simulated.run if step_estimate is None and fits_in_memory(system, excitation.stepping) else None
        step_estimate = step_estimate or step_error(simulated.form or system, excitation, run, complete=complete)
    except (SimulationError, InputError) as error:
        messages = [f"the error of the time step is not known: {error}"]
        return SummaryPart({"step": step_summary(None, str(error))}, messages)
    searched = scene.accuracy is not None
    messages = [] if searched else step_warnings(step_estimate, excitation.stepping, excitation.signals, natural)
    exact = ("frequency", *["pad_force"] * impacts)  # frequencies have no step; impacts have their own line
    lacking = quantities_not_covered(
        scene, with_forces_on_machine(scene, simulated.response), step_estimate.errors, exact
    )
    lacking = [SLIDER_IMPACTS] * impacts + lacking
    return SummaryPart({"step": step_summary(step_estimate, not_covered=lacking)}, messages)


def step_summary(error: StepError | None, reason: str | None = None, not_covered: Sequence[str] = ()) -> dict[str, Any]:
    """Contents of ``step`` in summary.json: errors by kind, fields of `StepError`, ``limit`` and ``reason``.

    ``limit`` is always `STEP_LIMIT`, and ``not_covered`` lists in words the quantities without an error, and
    ``unsettled`` the kinds whose error is a lower bound, as even smaller steps still change them.  If `error` is
    None, the errors ``beam`` and ``tip`` and the fields of `StepError` are None, and ``reason`` says why.
    """
    errors = dict(error.errors) if error else {}
    figures = {kind: errors.get(kind) for kind in ("beam", "tip")} | {
        name: getattr(error, name, None) for name in _STEP_FIGURES
    }
    figures["unsettled"] = list(error.unsettled) if error else []
    return figures | errors | {"not_covered": list(not_covered), "limit": STEP_LIMIT, "reason": reason}


def step_warnings(
    error: StepError, stepping: TimeStepping, signals: Sequence[tuple[str, SignalBase]], natural: Array
) -> list[str]:
    """List a warning if the step's error is not settled or too large; empty otherwise.

    The error is too large above `STEP_LIMIT` in displacements, and above `FAR` in other outputs.  `signals` are pairs
    (name, signal) of path and loads; `natural` (S, f) in Hz are f frequencies in S positions on the way, ascending.
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
    fastest = max(((signal.highest_frequency(0.0, stepping.end), name) for name, signal in signals), default=(0.0, ""))
    parts += [f"{fastest[1]} goes up to {fastest[0]:.4g} Hz, {_steps_per_period(fastest[0], h)}"] if fastest[0] else []
    parts.append(_motion_clause(error.band, h, natural))
    if not error.settled:
        parts.append(f"even steps of {error.finest:.2g} s don't settle it")
    elif error.enough is not None:
        parts.append(f"steps of {error.enough:.2g} s bring the error below {100.0 * STEP_LIMIT:g} %")
    return ["; ".join(parts)]


def _motion_clause(band: float, h: float, natural: Array) -> str:
    """Clause about the highest frequency of the motion, `band` in Hz, and the highest mode that the motion excites.

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
    """Text with the number of steps of h in s in a period of `frequency` in Hz; "no period" for 0."""
    return f"{two_digits(1.0 / (frequency * h))} steps a period" if frequency > 0.0 else "no period"
