"""Rainflow cycles of a history: ranges, means and counts, as fatigue assessments take them (ASTM E1049-85)."""

from __future__ import annotations

import numpy as np
import rainflow
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Cycles below this share of the largest range are left out: of damage, which grows with the third power of the range
#: or faster, each has less than a millionth of that of the largest.
SMALLEST = 0.01


def cycles(t: Array, x: Array) -> Array:
    """Cycles of a history x (T,) at times t (T,) in s, the largest first; half ones are those that do not close.

    Returns
    -------
    (C, 5) array
        Range and mean in the unit of x, count (1 or 0.5), and the times in s at which a cycle begins and ends.
    """
    found = [(size, mean, count, t[i], t[k]) for size, mean, count, i, k in rainflow.extract_cycles(x) if size > 0.0]
    table = np.array(found, dtype=float).reshape(-1, 5)
    table = table[table[:, 0] >= SMALLEST * table[:, 0].max(initial=0.0)]
    return np.asarray(table[np.argsort(-table[:, 0], kind="stable")])
