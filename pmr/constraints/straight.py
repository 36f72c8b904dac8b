r"""What bends between two places of a beam, as rows: nothing does while they are zero.

With the row w(x) of a point that slides, a fixed place p and the other one at x,

.. math:: (x - p)\, w'(p) + w(p) - w(x) = 0 \qquad \text{and} \qquad (x - p)\, w'(x) + w(p) - w(x) = 0

both ends have the slope of the line through them.  A rigid motion is measured as none, so that what holds these rows
pushes with no force and no moment in all; their multipliers are in N, times x - p moments.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PPoly

from pmr.constraints.rows import Row


@dataclass(frozen=True)
class Straight:
    """That a planar beam stays straight between `end` (m) and where s is: two rows by these names."""

    end: float
    names: tuple[str, str]

    def rows(self, point: Row) -> tuple[Row, Row]:
        """From the row of a point that slides along a beam: piecewise polynomials in s of its degree, exact."""
        j = max(int(np.searchsorted(point.breaks, self.end, side="right")) - 1, 0)
        j = min(j, len(point.breaks) - 2)
        along = PPoly(point.coefficients, point.breaks)
        w, slope, rates = along(self.end), along(self.end, 1), along.derivative().c
        ahead = (point.breaks[:-1] - self.end)[:, None]  # x - p where an interval begins
        constant = np.zeros_like(point.coefficients)
        constant[-1] = w
        sloping = constant.copy()
        sloping[-2] += slope
        sloping[-1] += ahead * slope
        changing = np.zeros_like(point.coefficients)  # (x - p) w'(x)
        changing[:-1] += rates
        changing[1:] += ahead * rates
        touched = np.hstack([point.touched, np.broadcast_to(point.touched[j], point.touched.shape)])
        parts = [(-point.coefficients, sloping), (changing - point.coefficients, constant)]
        first, second = (
            replace(point, name=name, touched=touched, coefficients=np.concatenate(part, axis=2))
            for name, part in zip(self.names, parts, strict=True)
        )
        return first, second
