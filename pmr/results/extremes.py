"""Where a history is smallest and largest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


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
        """Of values (T,) at times t (T,) and path coordinates s (T,)."""
        first, last = int(np.argmin(values)), int(np.argmax(values))
        low, high = float(values[first]), float(values[last])
        return cls(low, float(t[first]), float(s[first]), high, float(t[last]), float(s[last]))

    def summary(self) -> dict[str, float]:
        """By the names that summaries and tables give them."""
        return {
            "min": self.least, "t_min": self.t_least, "s_min": self.s_least,
            "max": self.most, "t_max": self.t_most, "s_max": self.s_most,
        }  # fmt: skip
