r"""Damage by load cycles, summed after Palmgren and Miner on an S-N line.

.. math::
    D = \sum_i \frac{n_i}{N_i}, \qquad N_i = N_{ref} \Bigl(\frac{\Delta\sigma_{ref}}{\Delta\sigma_i}\Bigr)^m,
    \qquad N_{ref} = 2 \cdot 10^6

over the ranges of rainflow cycles (`pmr.results.extremes.cycles`); those below the cut-off do none.  Miner: Cumulative
damage in fatigue, Journal of Applied Mechanics 12, 1945.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmr.errors import InputError
from pmr.results.extremes import cycles

Array = NDArray[np.float64]

#: Cycles at which an S-N line has its reference range.
REFERENCE_CYCLES = 2e6


@dataclass(frozen=True)
class SNLine:
    """Cycles to failure over the range of a stress; an InputError is raised where a number is none that is allowed."""

    slope: float  # m of the line, in logarithms
    reference: float  # range in Pa that is endured 2e6 times
    cut_off: float = 0.0  # range in Pa below which cycles do no damage

    def __post_init__(self) -> None:
        for key, low in (("slope", 0.0), ("reference", 0.0)):
            if not low < getattr(self, key) < np.inf:
                raise InputError("S-N line", key, getattr(self, key), "a number above 0 is allowed")
        if not 0.0 <= self.cut_off < np.inf:
            raise InputError("S-N line", "cut_off", self.cut_off, "a range of 0 or more is allowed")

    def damage(self, ranges: Array, counts: Array) -> float:
        """Damage by ranges (C,) Pa that come so many times (C,)."""
        share = (np.where(ranges < self.cut_off, 0.0, ranges) / self.reference) ** self.slope
        return float(counts @ share) / REFERENCE_CYCLES


def damage(t: Array, stress: Array, line: SNLine, times: float = 1.0) -> float:
    """Damage by a stress (T,) Pa over t (T,) s that is repeated so many times; 1 is failure.

    Cycles of less than a hundredth of the largest range are left out, as `pmr.results.extremes.cycles` does.
    """
    loops = cycles(t, stress)
    return times * line.damage(loops[:, 0], loops[:, 2])
