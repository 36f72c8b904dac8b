"""Errors of the reduction and of the time step that a run estimates without a reference, as parts of its summary."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter1d

from pmr.compare.attachment_loads import reason_without_estimate
from pmr.compare.estimate import MARGIN, Estimate, UnsettledError, estimate_by_other_model, estimate_error
from pmr.compare.model_part import FREQUENCIES, evenly_spaced_steps, frequency_error
from pmr.compare.outputs import OUTPUT_KINDS, run_from_start, tip_columns
from pmr.compare.responses import Simulations
from pmr.compare.trust import (
    AWAY_FROM_PROBES,
    MACHINE_MOTION,
    RIGID_REACTIONS,
    SECOND_ORDER_EFFECTS,
    coverage_warnings,
    effects_not_covered,
)
from pmr.errors import InputError, SimulationError
from pmr.errors.environment import Clock
from pmr.errors.text import two_digits
from pmr.files.arrays import Array
from pmr.results import Response
from pmr.results.run import SummaryPart
from pmr.scene import Reduction, Scene
from pmr.scene.keys import ALONE
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.excitation import side_positions
from pmr.simulation.frame_motion import has_computed_motion
from pmr.simulation.modal import modal_form
from pmr.system.assembly import Assembly
from pmr.system.attachment import has_frame_matrices
from pmr.system.reduced_model import ReducedModel
from pmr.system.states import SystemTrajectory
from pmr.system.system import System
from pmr.system.truncation import extend

#: Least number of coordinates of a model that serves to estimate the error of another model.
FEWEST = 6
#: A warning asks for more modes if more than this share of the first truncated mode's motion is not quasi-static.
REACHED = 0.5
#: Largest product of step and highest circular frequency with which a moving slider was stable with rho_inf = 1.
RESOLVED = 2.0
#: Keys of every estimate in summary.json that are not kinds of outputs.
_FIGURES = ("probes", "by", "chi", "largest", "seconds", "not_covered")


@dataclass(frozen=True)
class ReductionError:
    """Part of a summary with the estimated error of the reduction (``estimate``), its band, and its sections."""

    part: SummaryPart
    band: Array | None = None  # (T, d) m: error over time of each of the tip's d displacements, with margin
    sections: Mapping[str, float] = field(default_factory=dict)  # by section of a boom: error along it, a fraction

    def of_section(self, name: str) -> dict[str, Any]:
        """Contents of summary.json for the section `name`: ``estimate``, the error along it; empty if there is none."""
        return {"estimate": self.sections[name]} if name in self.sections else {}


def needs_other_model(scene: Scene, reduced: ReducedModel) -> bool:
    """Whether the scene asks for an estimate that needs another model of the body (`estimate_by_other_model`)."""
    return scene.reduction.estimate and reason_without_estimate({ALONE: reduced}) is not None


def other_model_scene(scene: Scene, reduced: ReducedModel) -> Scene:
    """The scene with the reduction of the other model: free modes with residual flexibility, and enough coordinates.

    It has at least as many coordinates as `reduced`.
    """
    choice = scene.reduction
    other = Reduction(basis="free_modes", coordinates=max(FEWEST, reduced.size), solver=choice.solver)
    return scene.model_copy(update={"reduction": other})


def reduction_error(
    scene: Scene,
    simulated: SimulatedSystem,
    clock: Clock,
    other: ReducedModel | None = None,
    estimated: Estimate | None = None,
) -> ReductionError:
    """Estimate the error of the reduction by enrichment modes, or for a single body by the `other` model.

    The result lists the effects that the error does not cover.  If the estimate is known already, it is passed as
    `estimated` and not computed again.
    """
    system, excitation = simulated.system, simulated.excitation
    models = system.modal
    is_wanted = all(part.reduction.estimate for part in scene.sections)
    telling = models if other is None else {ALONE: other}

    def make() -> Estimate:
        """Compute the estimate, or return the one that is known."""
        if other is not None:
            return estimate_by_other_model(system, other, excitation)
        return estimated or estimate_error(models, system, excitation, simulated.run, simulated.response)

    failed, scattered = "", list[str]()
    if is_wanted and reason_without_estimate(telling) is None:
        estimated, failed, scattered = _try_estimate(clock, make)
    if estimated is None:
        figures = dict.fromkeys((*OUTPUT_KINDS, *_FIGURES)) | {"reason": failed or reason_without_estimate(models)}
        messages = estimate_warnings(models, excitation.stepping, None) + scattered
        return ReductionError(SummaryPart({"estimate": figures} if is_wanted else {}, messages))
    held = any(body.reactions is not None for body in system.bodies.values())
    left_out = [*_effects_left_out(telling, system, excitation, estimated.enrichment), *[RIGID_REACTIONS] * held]
    left_out += [*[MACHINE_MOTION] * has_computed_motion(scene), *estimated.unknown.values()]
    messages = estimate_warnings(models, excitation.stepping, estimated) + coverage_warnings(left_out)
    messages += [estimated.scatter] if estimated.scatter else []
    figures = estimate_summary(estimated, left_out) | {"frequency": _frequency_error(models, system, excitation)}
    part = SummaryPart({"estimate": figures} if is_wanted else {}, messages)
    return ReductionError(part, error_envelope(MARGIN * estimated.error[:, tip_columns(system)]), estimated.bodies)


def _frequency_error(models: Mapping[str, ReducedModel], system: System, excitation: Excitation) -> float | None:
    """Error of the two lowest natural frequencies on the way, a fraction with margin, by the enrichment modes.

    None if errors can't be estimated (`reason_without_estimate`) or if nothing vibrates.
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
    """Clauses about effects that an estimate with up to `count` enrichment modes (None: all) leaves out."""
    stressed = [SECOND_ORDER_EFFECTS] * (bool(system.terms) and not all(map(has_frame_matrices, models.values())))
    if ALONE in models:
        return [*stressed, *effects_not_covered(models[ALONE], excitation.signals, excitation.stepping, count)]
    damped = any(body.rayleigh is None and body.D.any() for body in system.reduced.values())
    return [AWAY_FROM_PROBES, *["the damping of what the modes leave out, which is not Rayleigh's"] * damped, *stressed]


@dataclass(frozen=True)
class SimulatedSystem:
    """A system of reduced bodies, its excitation, and its motion.

    If the motion was not kept, `recorded_run` is None, and the motion is simulated again when it is needed.
    """

    system: System
    excitation: Excitation
    recorded_run: SystemTrajectory | None = None
    response: Response | None = None  # response to that motion, if known

    @classmethod
    def from_simulations(cls, system: System, excitation: Excitation, simulations: Simulations) -> SimulatedSystem:
        """The system with motion and response of the scene's first simulator, and the parts of each of its steps."""
        run = simulations.first.run
        if run is None:
            return cls(system, excitation)
        return cls(system, excitation.with_stepping(simulations.time_grid), run, simulations.first.own_response)

    @cached_property
    def run(self) -> SystemTrajectory:
        """Motion of the system at all steps."""
        return self.recorded_run or run_from_start(self.system, self.excitation)


def _try_estimate(clock: Clock, make: Callable[[], Estimate]) -> tuple[Estimate | None, str, list[str]]:
    """Estimate that `make` returns, with an empty reason and no warnings.

    If it fails: None, the reason, and warnings about forces that differ much between nearly equal models.
    """
    try:
        with clock.stage("estimate"):
            return make(), "", []
    except (SimulationError, InputError) as error:  # other simulators may run systems that march refuses
        messages = [error.warning] if isinstance(error, UnsettledError) and error.warning else []
        return None, str(error).removeprefix("estimate: "), messages  # the prefix is the name of the clock's stage


def estimate_summary(estimated: Estimate, not_covered: Sequence[str] = ()) -> dict[str, Any]:
    """Contents of ``estimate`` in summary.json: fractions by kind of output, ``probes`` by name, ``chi`` and more.

    Kinds of outputs without an estimate are None; ``not_covered`` lists the effects that the estimate leaves out.
    """
    figures = {name: getattr(estimated, name) for name in _FIGURES if name != "not_covered"}
    return dict.fromkeys(OUTPUT_KINDS) | dict(estimated.errors) | figures | {"not_covered": list(not_covered)}


def estimate_warnings(
    models: Mapping[str, ReducedModel], stepping: TimeStepping, estimated: Estimate | None
) -> list[str]:
    """Warnings about too few coordinates, and about a step that is too long for an estimate without damping.

    `models` are by name of the body; `estimated` is None if there is no estimate.
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
    """Largest absolute value (T, o) of `error` (T, o), around each time, within two periods of its oscillation."""
    signs = np.signbit(error)
    crossings = np.count_nonzero(signs[1:] != signs[:-1], axis=0)
    width = np.empty_like(error)
    for k, count in enumerate(crossings):
        size = min(len(error), 4 * len(error) // max(int(count), 1))
        width[:, k] = maximum_filter1d(np.abs(error[:, k]), size)
    return width
