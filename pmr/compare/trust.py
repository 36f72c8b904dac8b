"""Whether a response can be trusted: references, and where the theory ends."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pmr.compare.ringing import ALTERNATES, RINGING, alternating, causes, remedy, ringing_share
from pmr.errors.text import rounded
from pmr.results import Response
from pmr.simulation.balance import NOTABLE, describe_surplus

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


def absent(missing: Mapping[str, str]) -> list[str]:
    """A line for each reference that is `missing`, with the reason."""
    return [f"no reference by {_CALLED.get(name, name)}: {reason}" for name, reason in missing.items()]


def doubts(reduced: Response, rigid: Sequence[str] = ()) -> list[str]:
    """A line for each reason why the reduced motion is not to be trusted; names as for `distrust`."""
    lines = []
    if reduced.surplus > NOTABLE:
        lines.append(f"the reduced model's motion is not to be trusted: {distrust(reduced, rigid)}")
    if (share := ringing_share(reduced.slider_force)) > RINGING:
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
