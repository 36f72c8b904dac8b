"""Ringing: parts of motions and forces that change their sign with every step, as multipliers of rigid rows may."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pmr.compare.errors import band_of_response, error_below_frequency, relative_error
from pmr.compare.round_off import Pair
from pmr.errors.text import two_digits
from pmr.files.arrays import Array
from pmr.results import Response
from pmr.results.quantities import error_label
from pmr.system.system import AnyBody, BodySystem

#: Largest share of a motion that may change its sign with every step, if there is no energy balance that shows growth.
#: Displacements alternate by such a share only after multipliers (of equations of index 3) have spoilt them.
ALTERNATING = 1e-3
#: Share of ringing in a force above which there is a warning, and above which an error may be due to the reference.
RINGING_SHARE = 0.02
ALTERNATES = "change their sign with every step"


def alternation_cause(rigid: Sequence[str]) -> str:
    """Clause that says why forces and motions alternate; `rigid` are the names of rigid contacts."""
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
    """Names of the contacts without compliance of their own, without rigid supports.

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
    share is :math:`\sin^8(\pi / n)`: 1e-4 for ten steps, 1 for two.  Such a part comes from the time integration: the
    multipliers of rigid rows that move ring in this way (docs/time_integration.md), long before displacements or
    energies show it.  The share is 0 for fewer than nine steps.
    """
    size = float(np.sqrt(np.mean(signal**2)))
    if size == 0.0 or len(signal) < 9:
        return 0.0
    return float(np.sqrt(np.mean(_alternating_part(signal) ** 2))) / size


def ringing_share(signal: Array, reference: Array | None = None) -> float:
    """RMS of the alternating part of a signal (T, o), over the RMS of the signal, or of `reference` (T, o) if given.

    It is averaged over the columns as in `relative_error`.
    """
    reference = signal if reference is None else reference
    return relative_error(reference + signal - _without_alternation(signal), reference)


def is_ringing(signal: Array, reference: Array) -> bool:
    """Whether the error of a signal (T, o) against a reference is due to ringing of the reference.

    It is if the error is above `RINGING_SHARE`, and if the alternating part of the difference and that of the reference
    are each more than half of the error.
    """
    error = relative_error(signal, reference)
    alternating = min(ringing_share(reference), ringing_share(signal - reference, reference))
    return error > RINGING_SHARE and alternating > error / 2.0


@dataclass(frozen=True)
class RingingReference:
    """An error that says nothing about the reduced model, because the reference rings (`is_ringing`)."""

    alternating: float  # share of the reference that changes its sign with every step
    band: float  # Hz: 1 % of the full model's motion lies above it
    below: float  # error of the signal at frequencies up to `band`, a fraction

    @classmethod
    def judge(cls, pair: Pair, full: Response) -> RingingReference | None:
        """Return the error of a pair (signal, reference), each (T, o), with the reference from the response `full`.

        None is returned if the error is not due to ringing of the reference (`is_ringing`).
        """
        if not is_ringing(*pair):
            return None
        step, highest = float(full.t[1] - full.t[0]), band_of_response(full)
        signal, reference = map(_without_alternation, pair)
        return cls(ringing_share(pair[1]), highest, error_below_frequency(signal, reference, step, highest))


def ringing_warnings(not_judged: Mapping[str, RingingReference], rigid: Sequence[str] = ()) -> list[str]:
    """One warning that names all quantities whose errors are in `not_judged`; nothing if that is empty.

    `not_judged` is by the names of quantities in summary.json.  If the full model has `rigid` contacts, the warning
    names them as the cause.
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
    """The signal (T, o) without its alternating part; its first and last four steps are unchanged."""
    steady = np.copy(signal)
    if len(signal) > 8:
        steady[4:-4] -= _alternating_part(signal)
    return steady


def _alternating_part(signal: Array) -> Array:
    r"""Central difference :math:`\delta^8 y / 2^8` (T - 8, ...) of a signal y (T, ...)."""
    for _ in range(4):
        signal = (signal[:-2] - 2.0 * signal[1:-1] + signal[2:]) / 4.0
    return signal
