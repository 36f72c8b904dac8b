"""Why a step of a simulation fails, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pmr.constraints.dependence import of_rows
from pmr.system.contacts import Contact
from pmr.system.friction import joints_of
from pmr.system.terms import first_few

Array = NDArray[np.float64]


def describe_dependence(C: Array, names: Sequence[str]) -> str:
    """Which of the rows C (m, n) depend on each other; `names` begin with theirs."""
    involved = of_rows(C, names[: len(C)]).names
    if len(involved) == 1:
        return f"the row {involved[0]} vanishes"
    return f"the rows {', '.join(involved)} depend on each other"


def describe_unsettled(names: Sequence[str], pushes: NDArray[np.bool_]) -> str:
    """Which contacts are neither open nor closed after as many solves as the kernel takes."""
    pushing = ", ".join(name for name, only_pushes in zip(names, pushes, strict=True) if only_pushes)
    return f"which of the rows {pushing} are closed was not settled in 1000 solves"


def describe_divergence(term_names: Sequence[str], contacts: Sequence[Contact], iterations: int) -> str:
    """Forces of terms and friction that do not converge in so many iterations of a step."""
    names = first_few([*term_names, *(f"friction of {joint}" for joint in joints_of(contacts))])
    return (
        f"the forces of {names} do not converge in {iterations} iterations of a step; shorter steps help where terms "
        "change the stiffness of a step by some hundred times, or pads stick and slide, close and open again and again"
    )
