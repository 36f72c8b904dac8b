r"""Cubics :math:`u + u' t + u'' t^2 / 2 + u''' t^3 / 6` that lead from one instant to the next, h later."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def by_rates(begun: Array, ended: Array, begun_rate: Array, ended_rate: Array, h: float) -> Array:
    """(4, ...): Hermite's, with values and rates (...) at both ends."""
    mean = (ended - begun) / h
    second = (6.0 * mean - 4.0 * begun_rate - 2.0 * ended_rate) / h
    return np.array([begun, begun_rate, second, 6.0 * (begun_rate + ended_rate - 2.0 * mean) / h**2])


def by_second_rates(begun: Array, ended: Array, begun_second: Array, ended_second: Array, h: float) -> Array:
    """(4, ...): with values and second rates (...) at both ends."""
    third = (ended_second - begun_second) / h
    rate = (ended - begun) / h - h / 2.0 * begun_second - h**2 / 6.0 * third
    return np.array([begun, rate, begun_second, third])


def by_lines(begun: Array, ended: Array, h: float) -> Array:
    """(4, ...): straight lines through values (...) at both ends."""
    rate = (ended - begun) / h
    return np.array([begun, rate, 0.0 * rate, 0.0 * rate])


def after(cubics: Array, t: Array | float) -> Array:
    """(3, ...): values, rates and second rates of cubics (4, ...), t later."""
    x, x1, x2, x3 = cubics
    return np.array([x + t * (x1 + t / 2.0 * (x2 + t / 3.0 * x3)), x1 + t * (x2 + t / 2.0 * x3), x2 + t * x3])
