r"""What bends between two places of a beam, as rows: nothing does while they are zero.

With the row w(x) of a point that slides, a fixed place p and the other one at x,

.. math:: (x - p)\, w'(p) + w(p) - w(x) = 0 \qquad \text{and} \qquad (x - p)\, w'(x) + w(p) - w(x) = 0

both ends have the slope of the line through them.  A rigid motion is measured as none, so that what holds these rows
pushes with no force and no moment in all; their multipliers are in N, times x - p moments.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmr.constraints.rows import Row

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Straight:
    """That a planar beam stays straight between `end` (m) and where s is: two rows by these names."""

    end: float
    names: tuple[str, str]

    def rows(self, point: Row) -> tuple[Row, Row]:
        """From the row of a point that slides along a beam: piecewise polynomials in s of its degree, exact."""
        j = max(int(np.searchsorted(point.breaks, self.end, side="right")) - 1, 0)
        j = min(j, len(point.breaks) - 2)
        w, slope = (_at(point.coefficients[:, j], self.end - point.breaks[j], nu) for nu in (0, 1))
        powers, count, d = point.coefficients.shape
        ahead = point.breaks[:-1] - self.end  # x - p where an interval begins
        there = np.zeros((powers, count, len(w)))
        there[-1] = w
        sloping = there.copy()
        sloping[-2] += slope
        sloping[-1] += ahead[:, None] * slope
        changing = np.zeros_like(point.coefficients)  # (x - p) w'(x)
        for p in range(powers - 1):
            exponent = powers - 1 - p
            changing[p] += exponent * point.coefficients[p]
            changing[p + 1] += exponent * ahead[:, None] * point.coefficients[p]
        touched = np.hstack([point.touched, np.broadcast_to(point.touched[j], (count, d))])
        parts = [(-point.coefficients, sloping), (changing - point.coefficients, there)]
        first, second = (
            replace(point, name=name, touched=touched, coefficients=np.concatenate(part, axis=2))
            for name, part in zip(self.names, parts, strict=True)
        )
        return first, second


def _at(coefficients: Array, x: float, derivative: int) -> Array:
    """Values (d,) of polynomials (powers, d) at x, or of their derivatives."""
    return np.array([np.polyval(np.polyder(c, derivative), x) for c in coefficients.T])
