r"""Closed forms of the uniform Euler-Bernoulli beam: pinned at 0, supported at s, free at L.

The rotation of the beam over the support is the one unknown; the moments with which the two spans resist it must
cancel.  With a = beta s, b = beta (L - s) and beta^4 = rho A omega^2 / (E I) the spans' dynamic stiffnesses are

.. math::
    k_1 = EI \beta \frac{2 \sin a \sinh a}{\sin a \cosh a - \cos a \sinh a}, \qquad
    k_2 = EI \beta \frac{\cos b \sinh b - \sin b \cosh b}{1 + \cos b \cosh b}

(a pinned-pinned and a free span; the limits beta -> 0 are 3 EI / s and -rho A omega^2 (L - s)^3 / 3).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

Array = NDArray[np.float64]

_STEP = np.pi / 400.0  # of beta L; neighbouring roots are further apart than this
_AT_ONCE = 1000  # steps


def frequencies(s: float, length: float, bending_stiffness: float, mass_per_length: float, count: int) -> Array:
    """The `count` lowest circular frequencies in rad/s with the support at s, 0 < s <= length (m).

    Raises
    ------
    ValueError
        If s does not lie on the beam, or on the pin.
    """
    if not 0.0 < s <= length:
        raise ValueError(f"s = {s:g} m: allowed are 0 < s <= {length:g} m")
    share, first = s / length, 1
    roots: list[float] = []
    while len(roots) < count:
        x = _STEP * np.arange(first, first + _AT_ONCE + 1)
        values = _residual(x, share)
        found = np.flatnonzero((values[:-1] == 0.0) | (values[:-1] * values[1:] < 0.0))
        for i in found[: count - len(roots)]:
            root = x[i] if values[i] == 0.0 else brentq(_residual, x[i], x[i + 1], args=(share,), xtol=1e-14)
            roots.append(float(root))
        first += _AT_ONCE
    beta = np.array(roots) / length
    return beta**2 * np.sqrt(bending_stiffness / mass_per_length)


def axial_frequencies(length: float, axial_stiffness: float, mass_per_length: float, count: int) -> Array:
    """(2 n - 1) pi / (2 L) sqrt(EA / rho A) in rad/s: a bar held at one end (Blevins 1979, table 8-16)."""
    n = np.arange(1, count + 1)
    return (2 * n - 1) * np.pi / (2.0 * length) * np.sqrt(axial_stiffness / mass_per_length)


def _residual(x: Any, share: float) -> Any:
    """(k_1 + k_2) times both denominators over cosh a cosh b, at beta L = x and s / L = share: no overflow."""
    a, b = x * share, x * (1.0 - share)
    supported = 2.0 * np.sin(a) * np.tanh(a) * (1.0 / np.cosh(b) + np.cos(b))
    free = (np.cos(b) * np.tanh(b) - np.sin(b)) * (np.sin(a) - np.cos(a) * np.tanh(a))
    return supported + free
