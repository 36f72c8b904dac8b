r"""Load cycles of a history, and the damage by them, summed after Palmgren and Miner with an S-N line.

A history has cycles of the ranges :math:`\Delta\sigma_i`, each of which occurs :math:`n_i` times (`rainflow_cycles`).
An S-N line has the slope m and the reference range :math:`\Delta\sigma_{ref}`, which is endured :math:`N_{ref}` times.
The damage D is the sum over i of the cycles as shares of the endured cycles :math:`N_i`:

.. math::
    D = \sum_i \frac{n_i}{N_i}, \qquad N_i = N_{ref} \Bigl(\frac{\Delta\sigma_{ref}}{\Delta\sigma_i}\Bigr)^m,
    \qquad N_{ref} = 2 \cdot 10^6

Ranges below the cut-off of the line do no damage.  A history that is repeated closes its cycles: 1e5 loads from 0 to
:math:`\sigma` are 1e5 cycles of this range, though the load of one history is half a cycle.  Miner: Cumulative damage
in fatigue, Journal of Applied Mechanics 12, 1945.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import rainflow

from pmr.errors import InputError
from pmr.files.arrays import Array

#: Number of cycles at which the reference range of an S-N line leads to failure.
REFERENCE_CYCLES = 2e6


def rainflow_cycles(t: Array, x: Array) -> Array:
    """Return the rainflow cycles of a history x (T,) at times t (T,) in s, the largest first (ASTM E1049-85).

    A cycle that does not close counts as half a cycle, and cycles of the range 0 are left out.

    Returns
    -------
    (C, 5) array
        Range and mean in the unit of x, count (1 or 0.5), and the times in s at which a cycle begins and ends.
    """
    loops = [(size, mean, count, t[i], t[k]) for size, mean, count, i, k in rainflow.extract_cycles(x) if size > 0.0]
    table = np.array(loops, dtype=float).reshape(-1, 5)
    return np.asarray(table[np.argsort(-table[:, 0], kind="stable")])


@dataclass(frozen=True)
class SNLine:
    """S-N line: the number of cycles to failure, depending on the range of a stress.

    Raises InputError for a number that is not allowed.
    """

    slope: float  # exponent m of the line, its slope with logarithmic axes
    reference: float  # range in Pa that leads to failure after 2e6 cycles
    cut_off: float = 0.0  # range in Pa below which cycles do no damage

    def __post_init__(self) -> None:
        for key, low in (("slope", 0.0), ("reference", 0.0)):
            if not low < getattr(self, key) < np.inf:
                raise InputError("S-N line", key, getattr(self, key), "a number above 0 is allowed")
        if not 0.0 <= self.cut_off < np.inf:
            raise InputError("S-N line", "cut_off", self.cut_off, "a range of 0 or more is allowed")

    def damage(self, ranges: Array, counts: Array) -> float:
        """Return the damage by C stress ranges (C,) in Pa that occur `counts` (C,) times; 1 is failure."""
        share = (np.where(ranges < self.cut_off, 0.0, ranges) / self.reference) ** self.slope
        return float(counts @ share) / REFERENCE_CYCLES


class Damage(NamedTuple):
    """Damage by one occurrence of a history, and by each further repetition, as numbers: 1 is failure."""

    once: float  # by the first occurrence
    further: float  # by each repetition after it

    def after(self, times: float) -> float:
        """Return the damage by a history that occurs `times` times, which may be a fraction.

        A history that occurs half a time does half of its damage `once`; after the first time, half of `further`.
        """
        return min(times, 1.0) * self.once + max(times - 1.0, 0.0) * self.further


@dataclass(frozen=True)
class RepeatedCycles:
    """Rainflow cycles of a history, and of two such histories one after the other (`rainflow_cycles`)."""

    once: Array  # (C, 5): cycles of the history
    twice: Array  # (C', 5): cycles of the history followed by itself

    @classmethod
    def count(cls, t: Array, x: Array) -> RepeatedCycles:
        """Count the cycles of a history x (T,) at times t (T,) in s."""
        return cls(rainflow_cycles(t, x), rainflow_cycles(np.tile(t, 2), np.tile(x, 2)))

    def damage(self, line: SNLine, factor: float = 1.0) -> Damage:
        """Return the damage by the stresses in Pa times a `factor`, with the S-N curve `line`.

        A further repetition does the damage by which two histories, one after the other, exceed one: it closes the
        cycles that the history leaves open.
        """
        once, twice = (line.damage(factor * cycles[:, 0], cycles[:, 2]) for cycles in (self.once, self.twice))
        return Damage(once, twice - once)


def damage(t: Array, stress: Array, line: SNLine, times: float = 1.0) -> float:
    """Return the damage by a stress (T,) in Pa at times t (T,) in s that occurs `times` times; 1 is failure.

    `line` is the S-N curve of the material or weld.
    """
    return RepeatedCycles.count(t, stress).damage(line).after(times)
