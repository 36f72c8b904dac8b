r"""Cardinal B-splines: weights that move smoothly.

The centred spline b of degree 3 with knots :math:`-2H, -H, 0, H, 2H` is C2, and for any s

.. math:: \sum_k b(x_k - s) = 1, \qquad \sum_k b(x_k - s)\, x_k = s, \qquad x_k = x_0 + k H / p,\; p = 1, 2, \dots

after division by p: sums of it over a lattice move as a rigid body does.  De Boor: A Practical Guide to Splines, rev.
ed., 2001, chapter IX (Marsden's identity).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, PPoly

Array = NDArray[np.float64]

DEGREE = 3


def bump(degree: int, knot: float) -> PPoly:
    """Centred cardinal B-spline with knots `knot` apart, its integral `knot`; zero outside its knots."""
    knots = (np.arange(degree + 2) - (degree + 1) / 2.0) * knot
    spline = PPoly.from_spline(BSpline.basis_element(knots, extrapolate=False).tck)
    inside = slice(degree, 2 * degree + 1)  # `from_spline` pads with empty intervals
    return PPoly(spline.c[:, inside], spline.x[degree : 2 * degree + 2])


def value(spline: PPoly, x: Array) -> Array:
    """The spline at x of any shape."""
    within = (x > spline.x[0]) & (x < spline.x[-1])
    return np.where(within, spline(np.where(within, x, 0.0)), 0.0)
