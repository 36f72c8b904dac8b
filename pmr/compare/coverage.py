r"""What the error estimate of a scene does not cover, in words.

The estimate knows of modes beyond its enrichment modes what is quasi-static and the next term of that series, which
converges below the lowest of them (docs/moving_residual_flexibility.md, section 10).  So a load that drives modes
beyond the enrichment modes is not in it.  Time stepping moves natural frequencies, :math:`\tan(\Omega h / 2) = \omega
h / 2` with rho_inf = 1 and hardly less with other values, so these are compared with the load as the steps see it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from pmr.errors.text import rounded
from pmr.reduced.model import ReducedModel
from pmr.results.quantities import QUANTITIES
from pmr.scene.signals import SignalBase
from pmr.simulation import TimeStepping

Array = NDArray[np.float64]

#: What no estimate covers; a run's ``step`` has the figure of the time step.
NEVER = "stresses away from probes"
#: What no estimate covers where a rigid support holds a body: its force is not among the rows that give way.
REACTIONS = "reactions of rigid supports"
#: What neither it nor a full model covers that follows a machine whose motion was found with the reduced model.
MACHINE = "the motion of frame.machine, which is found with the reduced model and its step"
#: What it does not cover with second order of a body with too many carriers (`pmr.reduced.attachment.knows_matrices`).
SECOND_ORDER = "effects of axial forces and the frame on the residual part, most of all on pad forces"
#: What it does not cover of a basis whose vectors don't move some rows, which are left out of the model.
LEFT_OUT = "what the basis does not move and leaves out: {}"
#: Why there is no estimate of forces.
IMPACTS = "forces of sliders: a kink of the path is an impact of a rigid slider, with a larger force in a shorter step"
RINGING = (
    "forces of sliders: most of their difference to a richer model alternates with every step; "
    "time.rho_inf = 0.8 or less damps it"
)
JUMPS = (
    "forces of sliders: where a load jumps, damping of the modes that are left out carries a part of it at first, "
    "which no reduced model has"
)
#: Share of critical damping of the first mode that is left out above which that share counts.
DAMPED = 0.05
#: Why there is none of what richer models disagree on, by kind of output.
UNSETTLED = {
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


def not_covered(
    model: ReducedModel, signals: Sequence[tuple[str, SignalBase]], stepping: TimeStepping, count: int | None = None
) -> list[str]:
    """Effects that the estimate with all enrichment modes, or the first `count`, leaves out, a clause each.

    Signals come with their names.

    `IMPACTS`, `RINGING`, `JUMPS` and `UNSETTLED` join it where an estimate lacks a kind of output.
    """
    top = highest_known(model, stepping, count)
    beyond = [what for name, signal in signals for what in _beyond(name, signal, stepping, top)]
    coupled = ["the damping of modes beyond the enrichment modes, which is not Rayleigh's"] * (not _classical(model))
    return [*beyond, *coupled, NEVER]


def warnings(clauses: Sequence[str]) -> list[str]:
    """The clauses that make the estimate too small by an unknown factor, a line each."""
    without = (NEVER, REACTIONS, MACHINE, IMPACTS, RINGING, JUMPS, *UNSETTLED.values())
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
