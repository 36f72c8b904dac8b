"""Whether results of a run can be trusted: motions that grow, ring or are large, effects that no error covers."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pmr.compare.errors import Pair, band_of_response, error_below_frequency, force_histories, relative_error
from pmr.compare.model_part import largest_model_error
from pmr.errors import percent, two_digits
from pmr.files.arrays import Array, Summary
from pmr.results import Response
from pmr.results.quantities import QUANTITIES, UNSETTLED_KINDS, error_label, reduction_error
from pmr.results.response import ROUND_OFF
from pmr.scene import Scene
from pmr.scene.choice import has_walls_that_could_give
from pmr.scene.members import members
from pmr.scene.model_traits import model_traits
from pmr.scene.signals import SignalBase
from pmr.simulation import TimeStepping
from pmr.simulation.native.watched import SMALL
from pmr.simulation.stepping import NOTABLE, describe_surplus
from pmr.system.reduced_model import ReducedModel
from pmr.system.system import AnyBody, BodySystem

_CALLED = {"full": "the full model", "ancf": "the ANCF cable"}


def reason_for_distrust(response: Response, rigid: Sequence[str] = ()) -> str | None:
    """Reason, in words, why nothing should be compared with a response; None if there is no reason.

    `rigid` are the names of rigid contacts, which the reason mentions.

    There is a reason if displacements are not finite, or if energy of the response comes from neither loads nor
    contacts that travel (`Response.surplus` above `pmr.simulation.stepping.NOTABLE`).  A response without an energy
    balance, such as that of the ANCF cable, is distrusted if its displacements alternate from step to step.
    """
    if not np.isfinite(response.displacement).all():
        return "its displacements are not finite"
    if np.isnan(response.surplus):
        share = alternating_share(response.displacement)
        if share <= ALTERNATING:
            return None
        of_motion = f"{two_digits(100.0 * share)} % of its motion"
        return f"{of_motion} changes its sign with every step: {alternation_cause(rigid)}"
    if response.surplus <= NOTABLE:
        return None
    return f"{describe_surplus(response.surplus)}: {alternation_cause(rigid)}"


def missing_reference_warnings(reasons: Mapping[str, str]) -> list[str]:
    """List a warning for each reference that is missing; `reasons` maps the name of a reference to the reason."""
    return [f"no reference by {_CALLED.get(name, name)}: {reason}" for name, reason in reasons.items()]


def distrust_warnings(reduced: Response, rigid: Sequence[str] = ()) -> list[str]:
    """List up to two warnings: of a reduced motion that gains energy, and of contact forces that ring.

    `rigid` are the names of rigid contacts, which the warnings name as a possible cause.
    """
    lines = []
    if reduced.surplus > NOTABLE:
        lines.append(f"the reduced model's motion is not to be trusted: {reason_for_distrust(reduced, rigid)}")
    if (share := ringing_share(reduced.slider_force)) > RINGING_SHARE:
        lines.append(
            f"of the forces of sliders and pads {two_digits(100.0 * share)} % {ALTERNATES} in the reduced model: "
            f"{alternation_cause(rigid)}; {alternation_remedy(rigid)}"
        )
    return lines


def large_motion_warnings(length: float, responses: Iterable[Response]) -> list[str]:
    """List a warning if a body of `length` in m moves by more than `SMALL` of its length, too far for a linear model.

    `responses` are all responses to check; the list is empty if no motion is too large.
    """
    largest = max(float(np.abs(response.displacement).max(initial=0.0)) for response in responses)
    if not largest > SMALL * length:
        return []
    return [
        f"the largest displacement, {largest:.3g} m, is {largest / length:.2g} times the body's length: "
        f"beyond {SMALL:g} times the theory of small motions does not hold"
    ]


#: Effects that no estimate covers; the error of the time step is in ``step`` of summary.json.
STRESSES, AWAY_FROM_PROBES = "stresses", "stresses away from probes"
#: Reactions that an estimate lacks where it lacks forces of pads, which supports bear.
RIGID_REACTIONS = "reactions of rigid supports"
#: Effect that neither an estimate nor a full model covers if the machine's motion was computed with the reduced model.
MACHINE_MOTION = "the motion of frame.machine or of what is free, which is found with the reduced model and its step"
#: Effect that no estimate covers with second order if a body has too many carriers
#: (`pmr.system.attachment.has_frame_matrices`).
SECOND_ORDER_EFFECTS = "effects of axial forces and the frame on the residual part, most of all on pad forces"
#: Effect that no estimate covers if the vectors of a basis don't move some rows, which are then left out of the model.
ROWS_LEFT_OUT = "motions that no vector of the basis has: {}"
#: Reasons why there is no estimate of forces of sliders.
SLIDER_IMPACTS = (
    "forces of sliders: a kink of the path is an impact of a rigid slider, with a larger force in a shorter step"
)
SLIDER_RINGING = (
    "forces of sliders: most of their difference to a richer model alternates with every step; "
    "time.rho_inf = 0.8 or less damps it"
)
LOAD_JUMPS = (
    "forces of sliders: where a load jumps, damping of the modes that are left out carries a part of it at first, "
    "which no reduced model has"
)
#: Damping ratio of the first truncated mode above which truncated modes bear a notable part of a load's jump.
DAMPED = 0.05
#: Largest share of a load's changes, by RMS, that may lie above the frequencies of the enrichment modes.
BEYOND = 0.05


def highest_mode_frequency(model: ReducedModel, stepping: TimeStepping, count: int | None = None) -> float:
    """Frequency in Hz with which time stepping shows the highest of the first `count` enrichment modes (None: of all).

    The frequency is arctan(omega h / 2) / (pi h), with the step h of `stepping` and the mode's circular frequency
    omega.  It is less than the natural frequency (`effects_not_covered`).  The model must have enrichment modes.
    """
    assert model.enrichment is not None
    omega = float(np.sqrt(model.enrichment.stiffness[:count][-1]))
    return float(np.arctan(omega * stepping.step / 2.0) / (np.pi * stepping.step))


def has_damped_jump(model: ReducedModel, signals: Sequence[tuple[str, SignalBase]], end: float) -> bool:
    """Whether a load jumps within the run, and truncated modes have enough damping to bear much of the jump at first.

    With damping proportional to stiffness the highest modes give way last, so the contact force starts from another
    value than with any number of modes.  `signals` are pairs (name, signal), `end` is the end of the run in s.
    """
    modes = model.enrichment
    if modes is None or modes.damping[0] <= 2.0 * DAMPED * np.sqrt(modes.stiffness[0]):
        return False
    at = [(signal, t) for _, signal in signals for t in signal.breaks if 0.0 < t < end]
    return any(abs(float(signal.value(t) - signal.value(np.nextafter(t, 0.0)))) > 1e-6 for signal, t in at)


def effects_not_covered(
    model: ReducedModel, signals: Sequence[tuple[str, SignalBase]], stepping: TimeStepping, count: int | None = None
) -> list[str]:
    r"""Clauses about effects that an estimate with the first `count` enrichment modes (None: all) leaves out.

    `signals` are pairs (name, signal) of loads and path.  For modes beyond the enrichment modes, the estimate contains
    the quasi-static motion and the next term of a series in frequency, which converges below the lowest of these modes
    (docs/moving_residual_flexibility.md, section 10).  So it leaves out motions that a load excites beyond the
    enrichment modes.  Time steps h turn a natural frequency :math:`\omega` into :math:`\Omega`,
    :math:`\tan(\Omega h / 2) = \omega h / 2`; this is exact for rho_inf = 1 and nearly so for other values.  The
    highest :math:`\Omega` is compared with each signal as the steps sample it.  Another clause names damping of modes
    beyond the enrichment modes that is not Rayleigh's.

    Callers add `stress_clauses` and, if an estimate lacks a kind of output, `SLIDER_IMPACTS`, `SLIDER_RINGING`,
    `LOAD_JUMPS` or one of `UNSETTLED_KINDS`.
    """
    top = highest_mode_frequency(model, stepping, count)
    beyond = [what for name, signal in signals for what in _clause_above(name, signal, stepping, top)]
    coupled = model.rayleigh is None and bool(model.D.any())  # else the estimate has the damping of all modes
    damped = ["the damping of modes beyond the enrichment modes, which is not Rayleigh's"] * coupled
    return [*beyond, *damped]


def stress_clauses(scene: Scene) -> list[str]:
    """Clause about the stresses of a scene that have no estimate; none if the scene does not ask for stresses."""
    if scene.recovery is None or not scene.recovery.stress:
        return []
    probed = any("stress" in probe.measures for part in scene.sections for probe in part.probes)
    return [AWAY_FROM_PROBES if probed else STRESSES]


def coverage_warnings(clauses: Sequence[str]) -> list[str]:
    """List a warning for each of the `clauses` whose effect may make the estimate too small by an unknown factor."""
    without = {STRESSES, AWAY_FROM_PROBES, RIGID_REACTIONS, MACHINE_MOTION, SLIDER_IMPACTS, SLIDER_RINGING, LOAD_JUMPS}
    without |= set(UNSETTLED_KINDS.values())
    return [f"the error may be larger than its estimate: {clause}" for clause in clauses if clause not in without]


def _clause_above(name: str, signal: SignalBase, stepping: TimeStepping, top: float) -> Iterator[str]:
    """Yield a clause on the part of the signal `name` that excites modes above `top` in Hz, unless it is small."""
    tones = [part.highest_frequency(0.0, stepping.end) for part in signal.parts]
    aliased_tone = max((abs(tone - round(tone * stepping.step) / stepping.step) for tone in tones), default=0.0)
    if aliased_tone > top:
        yield f"what {name}, {max(tones):.4g} Hz, excites beyond the highest enrichment mode, {top:.4g} Hz"
    elif (share := _share_above(signal, stepping, top)) > BEYOND:
        above = f"{two_digits(100.0 * share)} % of it above the highest enrichment mode, {top:.4g} Hz"
        yield f"what {name}, {above}, excites there"


def _share_above(signal: SignalBase, stepping: TimeStepping, top: float) -> float:
    """Share of the signal's changes above the frequency `top` in Hz, by RMS, sampled at the steps.

    The straight line between the signal's ends is subtracted first; otherwise it would count as a jump from the end to
    the start.  The share is 0 if nothing is left.
    """
    x = signal.value(stepping.times)
    x = x - np.linspace(x[0], x[-1], len(x))
    power = np.abs(np.fft.rfft(x)) ** 2
    total = float(power.sum())
    above = np.fft.rfftfreq(len(x), stepping.step) > top
    return float(np.sqrt(power[above].sum() / total)) if total > 0.0 else 0.0


#: Error of a reduction, or of forces by the time step, above which there is a warning.
FAR = 0.1


def stated_quantities(scene: Scene, response: Response) -> list[str]:
    """Keys of the quantities, other than displacements, that a run's results state.

    The keys are the kinds of forces and reactions in the response, such as ``pad_force``.  A kind is left out if all of
    its forces are zero, or round-off compared with the largest of all kinds.  ``frequency`` is always among the keys,
    ``stress`` if the scene recovers stresses, and ``probe`` if there are probes.
    """
    histories = force_histories(response)
    sizes = {key: float(np.max([np.abs(f).max(initial=0.0) for f in each.values()])) for key, each in histories.items()}
    bearing = {kind for (kind, _), size in sizes.items() if size > ROUND_OFF * max(sizes.values())}
    stated = [kind for kind in QUANTITIES if kind in bearing] + ["frequency"]
    stated += ["stress"] * (scene.recovery is not None and scene.recovery.stress)
    return stated + ["probe"] * any(output.kind == "probe" for output in response.outputs)


def quantities_not_covered(
    scene: Scene, response: Response, part: Mapping[str, object], exact: Collection[str] = ()
) -> list[str]:
    """Labels of the quantities in a run's results for which `part`, one part of the error budget, has no error.

    `part` maps keys of quantities to errors, None for an error that is not known.  Quantities with a key in `exact`
    need no error, and displacements are not looked at.
    """
    stated = stated_quantities(scene, response)
    return [QUANTITIES[kind].label for kind in stated if part.get(kind) is None and kind not in exact]


def reduction_warnings(summary: Summary) -> list[str]:
    """List a warning if the reduced model's error in the summary is above `FAR`; empty otherwise.

    The error is the difference to the full model, or an estimate.
    """
    source, errors = reduction_error(summary)
    far = {kind: error for kind, error in errors.items() if error > FAR}
    if not far:
        return []
    errors_text = ", ".join(f"{percent(error)} in {QUANTITIES[kind].label}" for kind, error in far.items())
    return [f"the reduced model is off by {errors_text} ({source}): it has too few coordinates, or its motion grows"]


def budget_warnings(scene: Scene, budget: Summary) -> Iterator[str]:
    """Yield a warning for each part of the error budget, ``model`` and ``mesh``, above `compare.model_tolerance`.

    A further warning says if the stress in walls at pads is above the yield stress.

    With `[accuracy]` or `[budget]`, warnings about the mesh come from `pmr.compare.accuracy.accuracy_warnings`.
    """
    allowed = scene.compare.model_tolerance
    model, mesh = budget.get("model") or {}, budget.get("mesh")
    beyond = f"more than compare.model_tolerance = {allowed:g}"
    if model.get("beside") is not None and (most := largest_model_error(model)) > allowed:
        giving = model_traits(model["beside"]).has_cells and any(map(has_walls_that_could_give, members(scene)))
        better = 'set body.walls = "give" to add the compliance of walls under pads'
        better = better if giving else "a richer model is closer"
        off = f"the model is off by up to {two_digits(100.0 * most)} %"
        yield f"{off} compared with a {model['beside']}, {beyond}; {better}"
    walls = model.get("wall_stress") or {}
    if "yield" in walls and (used := walls["value"] / walls["yield"]) > 1.0:
        of = f" of {walls['section']}" if walls["section"] else ""
        yield (
            f"the stress in walls{of} at pads is about {used:.3g} times the yield stress, but the model stays elastic"
        )
    if scene.goal is None and isinstance(mesh, Mapping) and mesh:
        kind, most = max(((kind, mesh[kind]) for kind in mesh if kind in QUANTITIES), key=lambda item: item[1])
        if most > allowed:
            where = QUANTITIES[kind].label
            yield f"the mesh is off by up to {two_digits(100.0 * most)} % in {where}, {beyond}; a finer one is closer"


#: Largest share of a motion that may change its sign with every step, if there is no energy balance that shows growth.
#: Displacements alternate by such a share only after multipliers (of equations of index 3) have spoilt them.
ALTERNATING = 1e-3
#: Share of ringing in a force above which there is a warning, and above which an error may be due to the reference.
RINGING_SHARE = 0.02
ALTERNATES = "change their sign with every step"


def alternation_cause(rigid: Sequence[str]) -> str:
    """Clause on the cause of forces and motions that alternate from step to step.

    `rigid` are the names of rigid contacts.  These contacts are the cause; if `rigid` is empty, modes that the step
    does not resolve are.
    """
    if not rigid:
        return "modes that the step does not resolve ring behind kinks and jumps where time.rho_inf is near 1"
    several = f"{rigid[0]} and {len(rigid) - 1} more are rigid" if len(rigid) > 1 else f"{rigid[0]} is rigid"
    return (
        f"{several}: such a force (index 3) rings behind kinks and grows where time.rho_inf is near 1, or the step is "
        "too long for the motion"
    )


def alternation_remedy(rigid: Sequence[str]) -> str:
    """Clause on what damps alternating forces and motions; `rigid` are the names of rigid contacts."""
    return f"time.rho_inf = 0.8 or less, a smooth path or {'a stiffness in N/m' if rigid else 'a smaller step'} damp it"


def rigid_contacts(system: BodySystem[AnyBody]) -> list[str]:
    """Names of the contacts without compliance of their own, supports left out.

    If all bodies are reduced and have residual flexibility, only cylinders count: at all other contacts the residual
    flexibility gives way.
    """
    flexible = all(getattr(body, "flexibility", None) is not None for body in system.bodies.values())
    rigid = [contact for contact in system.contacts if contact.compliance == 0.0 and contact.kind != "support"]
    return [contact.name for contact in rigid if contact.kind == "cylinder" or not flexible]


def alternating_share(signal: Array) -> float:
    r"""Share of a signal (T, ...) that changes its sign with every step, for all columns of the signal together.

    .. math:: \mathrm{rms}(\delta^8 y / 2^8) / \mathrm{rms}(y)

    with the signal y and its central difference :math:`\delta` over a step.  For a tone with n steps a period, the
    share is :math:`\sin^8(\pi / n)`: 1e-4 for ten steps, 1 for two.  Such a part comes from the time integration:
    forces of rigid contacts that travel alternate from step to step (docs/time_integration.md), long before
    displacements or energies show it.  The share is 0 for fewer than nine steps, and for a signal of zeros.
    """
    size = float(np.sqrt(np.mean(signal**2)))
    if size == 0.0 or len(signal) < 9:
        return 0.0
    return float(np.sqrt(np.mean(_alternating_part(signal) ** 2))) / size


def ringing_share(signal: Array, reference: Array | None = None) -> float:
    """RMS of the part of a signal (T, o) that alternates from step to step, divided by the RMS of `reference` (T, o).

    If `reference` is None, the divisor is the RMS of the signal itself.  With several columns, the share is a mean over
    all columns that move in the reference, as in `relative_error`.  A signal of at most eight steps has the share 0.
    """
    reference = signal if reference is None else reference
    return relative_error(reference + signal - _without_alternation(signal), reference)


def is_ringing(signal: Array, reference: Array) -> bool:
    """Whether the error of a signal (T, o) against a reference is due to ringing of the reference.

    Ringing is the cause if the error is above `RINGING_SHARE`, and if two shares (`ringing_share`) are each more than
    half of the error: that of the reference, and that of the difference between signal and reference.
    """
    error = relative_error(signal, reference)
    alternating = min(ringing_share(reference), ringing_share(signal - reference, reference))
    return error > RINGING_SHARE and alternating > error / 2.0


@dataclass(frozen=True)
class RingingReference:
    """Verdict that an error says nothing about the reduced model, because the reference rings (`is_ringing`)."""

    alternating: float  # share of the reference that changes its sign with every step
    band: float  # Hz: frequency above which the full model's motion has 1 % of its RMS
    below: float  # error of the signal at frequencies up to `band`, a fraction

    @classmethod
    def judge(cls, pair: Pair, full: Response) -> RingingReference | None:
        """Judge the error of a pair (signal, reference), each (T, o), whose reference is part of the response `full`.

        None is returned if the error is not due to ringing of the reference (`is_ringing`).
        """
        if not is_ringing(*pair):
            return None
        step, highest = float(full.t[1] - full.t[0]), band_of_response(full)
        signal, reference = map(_without_alternation, pair)
        return cls(ringing_share(pair[1]), highest, error_below_frequency(signal, reference, step, highest))


def ringing_warnings(not_judged: Mapping[str, RingingReference], rigid: Sequence[str]) -> list[str]:
    """List one warning that names all quantities in `not_judged`; the list is empty if there are none.

    `not_judged` is by the names of quantities in summary.json.  `rigid` are the names of the full model's rigid
    contacts, which the warning names as the cause if there are any.
    """
    if not not_judged:
        return []
    named = [
        f"{error_label(name)}, of which {two_digits(100.0 * unjudged.alternating)} % {ALTERNATES} "
        f"(below {two_digits(unjudged.band)} Hz, where the body moves, "
        f"the error is {two_digits(100.0 * unjudged.below)} %)"
        for name, unjudged in not_judged.items()
    ]
    return [
        f"the full model is no reference of {'; nor of '.join(named)}: {alternation_cause(rigid)}; "
        f"{alternation_remedy(rigid)}"
    ]


def _without_alternation(signal: Array) -> Array:
    """Return `signal` (T, o) without the part that alternates from step to step.

    Its first and last four steps are unchanged, and so is a signal of at most eight steps.
    """
    steady = np.copy(signal)
    if len(signal) > 8:
        steady[4:-4] -= _alternating_part(signal)
    return steady


def _alternating_part(signal: Array) -> Array:
    r"""Central difference :math:`\delta^8 y / 2^8` (T - 8, ...) of a signal y (T, ...)."""
    for _ in range(4):
        signal = (signal[:-2] - 2.0 * signal[1:-1] + signal[2:]) / 4.0
    return signal
