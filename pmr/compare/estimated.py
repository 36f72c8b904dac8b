"""Errors that a run estimates without a reference, of the reduction and of the time step, as parts of its summary."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d

from pmr.compare import boom_estimate, coverage, estimate, step_error
from pmr.compare.attached import UnsettledError
from pmr.compare.boom_estimate import BoomEstimate
from pmr.compare.halved_steps import Stepped
from pmr.compare.summary import Part
from pmr.errors import InputError, SimulationError
from pmr.errors.environment import Clock
from pmr.errors.text import rounded
from pmr.reduced.model import ReducedModel
from pmr.scene import Reduction, Scene
from pmr.scene.choice import transverse
from pmr.scene.members import member_at
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.modal import modal_form
from pmr.system.system import System, SystemTrajectory

Array = NDArray[np.float64]
Found = TypeVar("Found")

#: Coordinates of the model that tells the error of another one.
FEWEST = 6
#: Share of the first truncated mode's motion that is not quasi-static, above which more modes are called for.
REACHED = 0.5
#: Step times highest circular frequency up to which a moving slider was seen to be stable with rho_inf = 1.
RESOLVED = 2.0
_FIGURES = ("beam", "tip", "pad_force", "velocity", "probe", "probes", "kappa", "by", "chi", "largest", "seconds")


@dataclass(frozen=True)
class ReductionError:
    """``estimate`` of a summary, and what else is known of it."""

    part: Part
    band: Array | None = None  # how far off the tip may be over time, (T, d) in m
    sections: Mapping[str, float] = field(default_factory=dict)  # along each section of a boom, fractions


def asks_for_other(scene: Scene, reduced: ReducedModel) -> bool:
    """Whether it takes another model of the same body to tell the error (`pmr.compare.estimate.by_other`)."""
    return scene.reduction.estimate and estimate.no_estimate(reduced) is not None


def other_of(scene: Scene, reduced: ReducedModel) -> Scene:
    """The scene that has it: free modes with residual flexibility, no fewer coordinates."""
    choice = scene.reduction
    other = Reduction(basis="free_modes", coordinates=max(FEWEST, reduced.size), solver=choice.solver)
    return scene.model_copy(update={"reduction": other})


def reduction_error(
    scene: Scene,
    reduced: ReducedModel,
    clock: Clock,
    other: ReducedModel | None = None,
    found: estimate.Estimate | None = None,
) -> ReductionError:
    """The reduction's error as the enrichment modes tell it, or an `other` model, and what is not in it.

    One that is `found` already is not computed again.
    """
    excitation, left_out = Excitation.of(scene), list[str]()
    telling, tips, failed, scattered = other or reduced, len(transverse(member_at(scene))), "", list[str]()

    def make() -> estimate.Estimate:
        if other is not None:
            return estimate.by_other(reduced, other, excitation, tips)
        return found or estimate.estimate(reduced, excitation, tips)

    if scene.reduction.estimate and estimate.no_estimate(telling) is None:
        found, failed, scattered = _made(clock, make)
    if found is not None:
        left_out = [*coverage.not_covered(telling, excitation.signals, excitation.stepping), *found.unknown.values()]
        scattered = [found.scatter] if found.scatter else []
    figures: dict[str, Any] = {}
    if scene.reduction.estimate:
        figures = {"estimate": summary(reduced, found, left_out, failed)}
    said = warnings(reduced, excitation.stepping, found) + coverage.warnings(left_out) + scattered
    band = None if found is None else envelope(estimate.MARGIN * found.error[:, -tips:])
    return ReductionError(Part(figures, said), band)


def sections_error(
    boom: Scene,
    modal: Mapping[str, ReducedModel],
    run: SimulatedSystem,
    clock: Clock,
    found: BoomEstimate | None = None,
) -> ReductionError:
    """That of all sections of a boom, whose models on free modes are `modal`, from a run of them."""
    if not all(part.reduction.estimate for part in boom.sections):
        return ReductionError(Part())
    failed, said = boom_estimate.no_estimate(modal) or "", list[str]()
    if not failed:
        found, failed, said = _made(clock, lambda: found or boom_estimate.estimate(boom, modal, *run))
    if found is None:
        nothing = dict.fromkeys(("tip", "beam", "pad_force", "cylinder_force", "largest", "seconds", "not_covered"))
        return ReductionError(Part({"estimate": nothing | {"reason": failed}}, said))
    damped = any(body.rayleigh is None and body.D.any() for body in run.system.reduced.values())
    left_out = [coverage.NEVER, *["the damping of what the modes leave out, which is not Rayleigh's"] * damped]
    figures = {"largest": found.largest, "seconds": found.seconds, "not_covered": left_out}
    part = Part({"estimate": {**found.errors, **figures}}, _beyond(found.of("beam")))
    return ReductionError(part, envelope(estimate.MARGIN * found.error), found.sections)


class SimulatedSystem(NamedTuple):
    """A system of reduced bodies, what drove it, and the motion."""

    system: System
    excitation: Excitation
    run: SystemTrajectory


def _made(clock: Clock, make: Callable[[], Found]) -> tuple[Found | None, str, list[str]]:
    """An estimate; or None, with the reason, and what is said of forces that scatter."""
    try:
        with clock.stage("estimate"):
            return make(), "", []
    except (SimulationError, InputError) as error:  # other simulators may do what march refuses
        said = [error.warning] if isinstance(error, UnsettledError) and error.warning else []
        return None, str(error).removeprefix("estimate: "), said  # the clock's stage


def _beyond(beam: float) -> list[str]:
    """A line where an error along the beam is larger than the motion."""
    if beam <= 1.0:
        return []
    return [f"the estimated error is {rounded(beam)} times the motion: too few coordinates, or a motion that grows"]


def summary(
    model: ReducedModel, estimated: estimate.Estimate | None, not_covered: Sequence[str] = (), failed: str | None = None
) -> dict[str, float | str | list[str] | None]:
    """What summary.json holds: ``beam``, ``tip``, ``pad_force``, ``velocity`` and ``probe`` (fractions), ``probes`` by
    their names, ``kappa``, ``chi``, ``largest`` (m), ``seconds``.

    ``not_covered`` lists in words what the estimate leaves out.  All are None where there is no estimate, and
    ``reason`` says why: what `failed`, or `no_estimate`.
    """
    if estimated is None:
        return dict.fromkeys((*_FIGURES, "not_covered")) | {"reason": failed or estimate.no_estimate(model)}
    return {name: getattr(estimated, name) for name in _FIGURES} | {"not_covered": list(not_covered)}


def warnings(model: ReducedModel, stepping: TimeStepping, estimated: estimate.Estimate | None) -> list[str]:
    """What a user should know about a run, a line each."""
    found = _beyond(0.0 if estimated is None else estimated.beam)
    if estimated is not None and estimated.beam > 0.0 and (estimated.chi or 0.0) > REACHED:
        found.append(
            f"load or slide reach the first truncated mode (chi = {estimated.chi:.2f}): more coordinates are worth most"
        )
    fastest = stepping.step * float(np.sqrt(np.max(modal_form(model).omega2, initial=0.0)))
    if stepping.rho_inf == 1.0 and fastest > RESOLVED and model.moving:
        found.append(
            f"the step does not resolve the highest mode (h omega = {rounded(fastest)}) and rho_inf = 1 damps nothing: "
            f"with a moving slider this can grow; a smaller step, rho_inf < 1 or fewer coordinates help"
        )
    return found


def envelope(error: Array) -> Array:
    """What signals (T, o) stay within for two periods of their oscillation around each time."""
    signs = np.signbit(error)
    crossings = np.count_nonzero(signs[1:] != signs[:-1], axis=0)
    found = np.empty_like(error)
    for k, count in enumerate(crossings):
        size = min(len(error), 4 * len(error) // max(int(count), 1))
        found[:, k] = maximum_filter1d(np.abs(error[:, k]), size)
    return found


def step_part(
    stepped: Stepped, natural: Array, clock: Clock, searched: bool, found: step_error.StepError | None = None
) -> Part:
    """``step``: the time step's error; `natural` (S, f) in Hz are frequencies along the way.

    One that is `found` already is not computed again.  Where the step was `searched` by its error, nothing is said.
    """
    with clock.stage("step"):
        try:
            found = found or step_error.step_error_of(stepped)
        except (SimulationError, InputError) as error:
            said = [f"the error of the time step is not known: {error}"]
            return Part({"step": step_error.summary(None, str(error))}, said)
    excitation = stepped.excitation
    said = [] if searched else step_error.warnings(found, excitation.stepping, excitation.signals, natural)
    return Part({"step": step_error.summary(found)}, said)
