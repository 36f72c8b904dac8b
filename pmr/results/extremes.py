"""Where a history is smallest and largest, and its load cycles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import rainflow
from numpy.typing import NDArray

Array = NDArray[np.float64]
#: Cycles below this share of the largest range are left out: of damage, which grows with the third power of the range
#: or faster, each has less than a millionth of that of the largest.
SMALLEST = 0.01


@dataclass(frozen=True)
class Extreme:
    """Value of a history with the time in s and the path coordinate in m at which it has it."""

    value: float
    t: float
    s: float


@dataclass(frozen=True)
class Extremes:
    """Smallest and largest value of a history, the times in s and the path coordinates in m at which it has them."""

    least: float
    t_least: float
    s_least: float
    most: float
    t_most: float
    s_most: float

    @classmethod
    def of(cls, values: Array, t: Array, s: Array) -> Extremes:
        """Extremes of values (T,) at times t (T,) and path coordinates s (T,)."""
        first, last = int(np.argmin(values)), int(np.argmax(values))
        low, high = float(values[first]), float(values[last])
        return cls(low, float(t[first]), float(s[first]), high, float(t[last]), float(s[last]))

    @property
    def lowest(self) -> Extreme:
        """The smallest value."""
        return Extreme(self.least, self.t_least, self.s_least)

    @property
    def highest(self) -> Extreme:
        """The largest value."""
        return Extreme(self.most, self.t_most, self.s_most)

    @property
    def largest(self) -> Extreme:
        """The value of the largest size, with its sign."""
        return self.highest if self.most >= -self.least else self.lowest

    @property
    def size(self) -> float:
        """The largest absolute value."""
        return abs(self.largest.value)

    @classmethod
    def from_summary(cls, summary: Mapping[str, float]) -> Extremes:
        """Extremes as `summary` has written them."""
        return cls(*(float(summary[f"{what}{end}"]) for end in ("min", "max") for what in ("", "t_", "s_")))

    def summary(self) -> dict[str, float]:
        """By the names that summaries and tables give them."""
        return {
            "min": self.least, "t_min": self.t_least, "s_min": self.s_least,
            "max": self.most, "t_max": self.t_most, "s_max": self.s_most,
        }  # fmt: skip


def cycles(t: Array, x: Array) -> Array:
    """Rainflow cycles of a history x (T,) at times t (T,) in s, the largest first (ASTM E1049-85).

    Half ones are those that do not close.

    Returns
    -------
    (C, 5) array
        Range and mean in the unit of x, count (1 or 0.5), and the times in s at which a cycle begins and ends.
    """
    loops = [(size, mean, count, t[i], t[k]) for size, mean, count, i, k in rainflow.extract_cycles(x) if size > 0.0]
    table = np.array(loops, dtype=float).reshape(-1, 5)
    table = table[table[:, 0] >= SMALLEST * table[:, 0].max(initial=0.0)]
    return np.asarray(table[np.argsort(-table[:, 0], kind="stable")])
