r"""What of a signal changes its sign with every step: the time integration's own, not the body's.

.. math:: \mathrm{rms}(\delta^8 y / 2^8) / \mathrm{rms}(y)

Of a tone with n steps a period it is :math:`\sin^8(\pi / n)`: 1e-4 for ten of them, 1 for two.  The multipliers of
rigid rows that move ring so (docs/time_integration.md), long before displacements or energies show it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmr.compare.errors import Pair, relative_error
from pmr.compare.spectrum import band_of, error_below
from pmr.errors.text import rounded
from pmr.results import Response
from pmr.results.quantities import label_of_error
from pmr.system.system import Joined

Array = NDArray[np.float64]

#: Share of a force from which on its ringing is said, and its error may be that of the reference.
RINGING = 0.02
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
    """The share of a signal (T, ...), of all its columns together."""
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
    return error > RINGING and min(ringing_share(reference), ringing_share(signal - reference, reference)) > error / 2.0


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


def warnings(not_judged: Mapping[str, NotJudged], rigid: Sequence[str] = ()) -> list[str]:
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
