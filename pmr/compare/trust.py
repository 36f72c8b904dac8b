"""Whether figures of a run can be trusted: motions that ring or grow, the theory's end, and what no error covers.

An error is called what `pmr.results.quantities` calls its quantity.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare.errors import Pair, band_of, error_below, force_histories, relative_error
from pmr.compare.model_part import largest_model_error
from pmr.errors.text import rounded
from pmr.reduced.model import ReducedModel
from pmr.results import Response
from pmr.results.quantities import QUANTITIES, label_of_error, reduction_error
from pmr.results.response import ROUND_OFF
from pmr.scene import Scene
from pmr.scene.choice import has_walls_that_could_give
from pmr.scene.members import members
from pmr.scene.signals import SignalBase
from pmr.simulation import TimeStepping
from pmr.simulation.balance import NOTABLE, describe_surplus
from pmr.system.system import Joined

Array = NDArray[np.float64]

#: Share of a motion that may change its sign with every step where no energy balance tells whether it grows: index-3
#: multipliers that do have then spoilt the displacements by as much.
ALTERNATING = 1e-3
_CALLED = {"full": "the full model", "ancf": "the ANCF cable"}


def distrust(response: Response, rigid: Sequence[str] = ()) -> str | None:
    """Why nothing should be compared with a response, in words; None where nothing speaks against it.

    Names of contacts that are `rigid` stand in the reason.

    Its energy has to come from loads and moving rows (`pmr.simulation.balance`).  Of the ANCF cable, whose energy
    leaves out the axial strain, the displacements must not alternate from step to step instead.
    """
    if not np.isfinite(response.displacement).all():
        return "its displacements are not finite"
    if np.isnan(response.surplus):
        share = alternating(response.displacement)
        if share <= ALTERNATING:
            return None
        return f"{rounded(100.0 * share)} % of its motion changes its sign with every step: {causes(rigid)}"
    if response.surplus <= NOTABLE:
        return None
    return f"{describe_surplus(response.surplus)}: {causes(rigid)}"


def missing_references(missing: Mapping[str, str]) -> list[str]:
    """A line for each reference that is `missing`, with the reason."""
    return [f"no reference by {_CALLED.get(name, name)}: {reason}" for name, reason in missing.items()]


def doubts(reduced: Response, rigid: Sequence[str] = ()) -> list[str]:
    """A line for each reason why the reduced motion is not to be trusted; names as for `distrust`."""
    lines = []
    if reduced.surplus > NOTABLE:
        lines.append(f"the reduced model's motion is not to be trusted: {distrust(reduced, rigid)}")
    if (share := ringing_share(reduced.slider_force)) > RINGING_SHARE:
        lines.append(
            f"of the forces of sliders and pads {rounded(100.0 * share)} % {ALTERNATES} in the reduced model: "
            f"{causes(rigid)}; {remedy(rigid)}"
        )
    return lines


SMALL = 0.1  # of the body's length: a tip's path is then shortened by about half a per cent of it


def large_motion(length: float, responses: Iterable[Response]) -> list[str]:
    """A line where a body of this length in m moves by more than `SMALL` of it, which no linear model describes."""
    largest = max(float(np.abs(response.displacement).max(initial=0.0)) for response in responses)
    if not largest > SMALL * length:
        return []
    return [
        f"the largest displacement, {largest:.3g} m, is {largest / length:.2g} times the body's length: "
        f"beyond {SMALL:g} times the theory of small motions does not hold"
    ]


#: Share of a force from which on its ringing is said, and its error may be that of the reference.
RINGING_SHARE = 0.02
ALTERNATES = "change their sign with every step"


def causes(rigid: Sequence[str]) -> str:
    """Cause of forces and motions that alternate, where so many contacts are `rigid`, by their names."""
    if not rigid:
        return "modes that the step does not resolve ring behind kinks and jumps where time.rho_inf is near 1"
    several = f"{rigid[0]} and {len(rigid) - 1} more are rigid" if len(rigid) > 1 else f"{rigid[0]} is rigid"
    return (
        f"{several}: such a force (index 3) rings behind kinks and grows where time.rho_inf is near 1, or the step is "
        "too long for the motion"
    )


def remedy(rigid: Sequence[str]) -> str:
    """Remedy that damps it, with names likewise."""
    return f"time.rho_inf = 0.8 or less, a smooth path or {'a stiffness in N/m' if rigid else 'a smaller step'} damp it"


def rigid_contacts(system: Joined[Any]) -> list[str]:
    """Names of contacts that do not give way by themselves, but for rigid supports; of reduced bodies with residual
    flexibility only cylinders are rigid.
    """
    flexible = all(getattr(body, "flexibility", None) is not None for body in system.bodies.values())
    rigid = [contact for contact in system.contacts if contact.compliance == 0.0 and contact.kind != "support"]
    return [contact.name for contact in rigid if contact.kind == "cylinder" or not flexible]


def alternating(signal: Array) -> float:
    r"""Share of a signal (T, ...), of all its columns together, that changes its sign with every step.

    .. math:: \mathrm{rms}(\delta^8 y / 2^8) / \mathrm{rms}(y)

    Of a tone with n steps a period it is :math:`\sin^8(\pi / n)`: 1e-4 for ten of them, 1 for two.  It is the time
    integration's own: the multipliers of rigid rows that move ring so (docs/time_integration.md), long before
    displacements or energies show it.
    """
    size = float(np.sqrt(np.mean(signal**2)))
    if size == 0.0 or len(signal) < 9:
        return 0.0
    return float(np.sqrt(np.mean(_alternating_part(signal) ** 2))) / size


def ringing_share(signal: Array, of: Array | None = None) -> float:
    """The share of a signal (T, o), column by column as in errors; in parts of another one's size, if `of` is given."""
    of = signal if of is None else of
    return relative_error(of + signal - _steady(signal), of)


def rings(signal: Array, reference: Array) -> bool:
    """Whether an error is the reference's ringing: most of the difference alternates, and the reference by as much."""
    error = relative_error(signal, reference)
    return (
        error > RINGING_SHARE
        and min(ringing_share(reference), ringing_share(signal - reference, reference)) > error / 2.0
    )


@dataclass(frozen=True)
class NotJudged:
    """An error that no reduced model is to be blamed for, as the reference `rings`."""

    alternating: float  # share of the reference that changes its sign with every step
    band: float  # Hz, above which 1 % of the full model's motion lies
    below: float  # error up to that frequency

    @classmethod
    def of(cls, pair: Pair, full: Response) -> NotJudged | None:
        """Compare signal and reference (T, o) of the `full` model; None if the reference is smooth."""
        if not rings(*pair):
            return None
        step, highest = float(full.t[1] - full.t[0]), band_of(full)
        signal, reference = map(_steady, pair)
        return cls(ringing_share(pair[1]), highest, error_below(signal, reference, step, highest))


def ringing_warnings(not_judged: Mapping[str, NotJudged], rigid: Sequence[str] = ()) -> list[str]:
    """One line of all that is not judged, by the quantities' names in summary.json; none where everything is.

    Contacts that are `rigid` in the full model are the cause, if there are any.
    """
    if not not_judged:
        return []
    named = [
        f"{label_of_error(name)}, of which {rounded(100.0 * unjudged.alternating)} % {ALTERNATES} "
        f"(below {rounded(unjudged.band)} Hz, where the body moves, the error is {rounded(100.0 * unjudged.below)} %)"
        for name, unjudged in not_judged.items()
    ]
    return [f"the full model is no reference of {'; nor of '.join(named)}: {causes(rigid)}; {remedy(rigid)}"]


def _steady(signal: Array) -> Array:
    """The signal (T, o) without what alternates in it; its first and last four steps as they are."""
    steady = np.copy(signal)
    if len(signal) > 8:
        steady[4:-4] -= _alternating_part(signal)
    return steady


def _alternating_part(signal: Array) -> Array:
    """delta^8 y / 2^8, (T - 8, ...)."""
    for _ in range(4):
        signal = (signal[:-2] - 2.0 * signal[1:-1] + signal[2:]) / 4.0
    return signal


#: What no estimate covers; a run's ``step`` has the figure of the time step.
AWAY_FROM_PROBES = "stresses away from probes"
#: What no estimate covers where a rigid support holds a body: its force is not among the rows that give way.
RIGID_REACTIONS = "reactions of rigid supports"
#: What neither it nor a full model covers that follows a machine whose motion was found with the reduced model.
MACHINE_MOTION = "the motion of frame.machine, which is found with the reduced model and its step"
#: What it does not cover with second order of a body with too many carriers (`pmr.reduced.attachment.knows_matrices`).
SECOND_ORDER_EFFECTS = "effects of axial forces and the frame on the residual part, most of all on pad forces"
#: What it does not cover of a basis whose vectors don't move some rows, which are left out of the model.
ROWS_LEFT_OUT = "what the basis does not move and leaves out: {}"
#: Why there is no estimate of forces.
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
#: Share of critical damping of the first mode that is left out above which that share counts.
DAMPED = 0.05
#: Why there is none of what richer models disagree on, by kind of output.
UNSETTLED_KINDS = {
    kind: f"{QUANTITIES[kind].label}, because pads lift off and close again and the motion depends on the exact time "
    "of impacts"
    for kind in ("pad_force", "cylinder_force", "velocity", "probe")
}
#: Share of a load's changes, by RMS, that may lie above the enrichment modes.
BEYOND = 0.05


def highest_known(model: ReducedModel, stepping: TimeStepping, count: int | None = None) -> float:
    """Frequency in Hz of the highest of all enrichment modes, or the first `count`, as steps of this length have it."""
    assert model.enrichment is not None
    omega = float(np.sqrt(model.enrichment.stiffness[:count][-1]))
    return float(np.arctan(omega * stepping.step / 2.0) / (np.pi * stepping.step))


def jumps_damped(model: ReducedModel, signals: Sequence[tuple[str, SignalBase]], end: float) -> bool:
    """Whether a load sets in at once, and modes that are left out are damped enough to bear much of it.

    With damping proportional to stiffness the highest modes give way last, so a force begins as another one than that
    of any number of modes.
    """
    modes = model.enrichment
    if modes is None or modes.damping[0] <= 2.0 * DAMPED * np.sqrt(modes.stiffness[0]):
        return False
    at = [(signal, t) for _, signal in signals for t in signal.breaks if 0.0 < t < end]
    return any(abs(float(signal.value(t) - signal.value(np.nextafter(t, 0.0)))) > 1e-6 for signal, t in at)


def effects_not_covered(
    model: ReducedModel, signals: Sequence[tuple[str, SignalBase]], stepping: TimeStepping, count: int | None = None
) -> list[str]:
    r"""Effects that the estimate with all enrichment modes, or the first `count`, leaves out, a clause each.

    Signals come with their names.  The estimate knows of modes beyond its enrichment modes what is quasi-static and the
    next term of that series, which converges below the lowest of them (docs/moving_residual_flexibility.md, section
    10).  So a load that drives modes beyond the enrichment modes is not in it.  Time stepping moves natural
    frequencies, :math:`\tan(\Omega h / 2) = \omega h / 2` with rho_inf = 1 and hardly less with other values, so these
    are compared with the load as the steps see it.

    `IMPACTS`, `RINGING`, `JUMPS` and `UNSETTLED` join it where an estimate lacks a kind of output.
    """
    top = highest_known(model, stepping, count)
    beyond = [what for name, signal in signals for what in _beyond(name, signal, stepping, top)]
    coupled = ["the damping of modes beyond the enrichment modes, which is not Rayleigh's"] * (not _classical(model))
    return [*beyond, *coupled, AWAY_FROM_PROBES]


def coverage_warnings(clauses: Sequence[str]) -> list[str]:
    """The clauses that make the estimate too small by an unknown factor, a line each."""
    without = (
        AWAY_FROM_PROBES,
        RIGID_REACTIONS,
        MACHINE_MOTION,
        SLIDER_IMPACTS,
        SLIDER_RINGING,
        LOAD_JUMPS,
        *UNSETTLED_KINDS.values(),
    )
    return [f"the error may be larger than its estimate: {clause}" for clause in clauses if clause not in without]


def _classical(model: ReducedModel) -> bool:
    """Whether the estimate has the damping of all modes that are left out: it is Rayleigh's, or there is none."""
    return model.rayleigh is not None or not model.D.any()


def _beyond(name: str, signal: SignalBase, stepping: TimeStepping, top: float) -> Iterator[str]:
    tones = [part.highest_frequency(0.0, stepping.end) for part in signal.parts]
    aliased_tone = max((_at_the_steps(tone, stepping.step) for tone in tones), default=0.0)
    if aliased_tone > top:
        yield f"what {name}, {max(tones):.4g} Hz, excites beyond the highest enrichment mode, {top:.4g} Hz"
    elif (share := _share_above(signal, stepping, top)) > BEYOND:
        percent = rounded(100.0 * share)
        yield f"what {name}, {percent} % of it above the highest enrichment mode, {top:.4g} Hz, excites there"


def _at_the_steps(frequency: float, h: float) -> float:
    """The frequency in Hz that a tone has at the steps."""
    return abs(frequency - round(frequency * h) / h)


def _share_above(signal: SignalBase, stepping: TimeStepping, top: float) -> float:
    """Share of the signal's changes that lies above `top` Hz, by RMS, at the steps.

    The straight line between its ends is taken out first, which is what a jump between them would be.
    """
    x = signal.value(stepping.times)
    x = x - np.linspace(x[0], x[-1], len(x))
    power = np.abs(np.fft.rfft(x)) ** 2
    total = float(power.sum())
    above = np.fft.rfftfreq(len(x), stepping.step) > top
    return float(np.sqrt(power[above].sum() / total)) if total > 0.0 else 0.0


#: Error of a reduction, or of forces by the time step, from which a figure is far off.
FAR = 0.1


def stated_figures(scene: Scene, response: Response) -> list[str]:
    """Kinds of figures beside displacements that a run states; forces that are zero or round-off don't count."""
    histories = force_histories(response)
    sizes = {
        key: max(float(np.abs(history).max(initial=0.0)) for history in each.values())
        for key, each in histories.items()
    }
    bearing = {kind for (kind, _), size in sizes.items() if size > ROUND_OFF * max(sizes.values())}
    stated = [kind for kind in QUANTITIES if kind in bearing] + ["frequency"]
    stated += ["stress"] * (scene.recovery is not None and scene.recovery.stress)
    return stated + ["probe"] * any(output.kind == "probe" for output in response.outputs)


def figures_not_covered(
    scene: Scene, response: Response, part: Mapping[str, Any], exact: Collection[str] = ()
) -> list[str]:
    """Figures of a run of which a `part` of the budget has no error, in words; those that are `exact` need none."""
    stated = stated_figures(scene, response)
    return [QUANTITIES[kind].label for kind in stated if part.get(kind) is None and kind not in exact]


def unsettled_forces(kinds: Sequence[str]) -> list[str]:
    """Kinds of forces that go on changing with smaller steps, in words."""
    return [f"{QUANTITIES[kind].label} beyond the figure stated: smaller steps go on changing them" for kind in kinds]


def reduction_warnings(summary: Mapping[str, Any]) -> list[str]:
    """A line where the reduced model is off by more than `covered.FAR` beside the full one, or as it is estimated."""
    source, errors = reduction_error(summary)
    far = {kind: error for kind, error in errors.items() if error > FAR}
    if not far:
        return []
    errors_text = ", ".join(f"{_percent(error)} in {QUANTITIES[kind].label}" for kind, error in far.items())
    return [f"the reduced model is off by {errors_text} ({source}): it has too few coordinates, or its motion grows"]


def _percent(error: float) -> str:
    return f"{rounded(100.0 * error)} %"


def budget_warnings(scene: Scene, budget: Mapping[str, Any]) -> Iterator[str]:
    """A line for each part of ``budget`` above `compare.model_tolerance`; with `[accuracy]` the mesh has a line of its
    own (`pmr.compare.accuracy.order.warnings`).
    """
    allowed = scene.compare.model_tolerance
    model, mesh = budget.get("model") or {}, budget.get("mesh")
    beyond = f"more than compare.model_tolerance = {allowed:g}"
    if model.get("beside") is not None and (most := largest_model_error(model)) > allowed:
        giving = model["beside"].endswith("shell") and any(map(has_walls_that_could_give, members(scene)))
        better = 'body.walls = "give" adds the compliance of walls under pads' if giving else "a richer model is closer"
        yield f"the model is off by up to {rounded(100.0 * most)} % beside a {model['beside']}, {beyond}; {better}"
    if scene.goal is None and isinstance(mesh, Mapping) and mesh:
        kind, most = max(mesh.items(), key=lambda item: item[1])
        if most > allowed:
            where = QUANTITIES[kind].label
            yield f"the mesh is off by up to {rounded(100.0 * most)} % in {where}, {beyond}; a finer one is closer"
