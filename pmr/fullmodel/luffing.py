r"""The row of a luffing cylinder that holds a base: how far its lug moves along it, over the luffing angle.

With the unit vector :math:`d(\varphi)` from foot to lug in the axes of the boom, and the lug z above the axis,

.. math:: c(\varphi)\, q = d_x(\varphi)\, (u_x + z\, \theta_y) + d_z(\varphi)\, u_z

is what the cylinder gets longer by.  Between two breaks d is the polynomial of fifth degree that has its values and
first two derivatives there.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.interpolate import BPoly, PPoly

from pmr.constraints.rows import Row
from pmr.models import StructuralModel
from pmr.scene.frame import LuffingCylinder
from pmr.scene.keys import LUFFING_CYLINDER

Array = NDArray[np.float64]

#: Intervals of a turn to begin with; error of a direction between two breaks; shortest interval, in rad.
INTERVALS, ACCURACY, SHORTEST = 16, 1e-9, 1e-3


def cylinder_row(
    cylinder: LuffingCylinder,
    tail: tuple[float, float, float],
    model: StructuralModel,
    T: sp.csr_matrix,
    travel: tuple[float, float],
) -> Row:
    """Row on the coordinates z, q = T z, of a base whose tail is so far from the pivot, (3,) m.

    A turn of the luffing angle, from -pi to pi, is stretched over `travel`, where other rows of the body are defined.
    """
    place, z = cylinder.lug[0] - tail[0], cylinder.lug[1] - tail[2]
    along = model.displacement(place)
    turned = model.motion(place)[model.directions.index("ry")]
    measured = [z * turned, along[model.directions.index("z")]]
    if "x" in model.directions:
        measured[0] = measured[0] + along[model.directions.index("x")]
    directions = direction_polynomial(cylinder)
    low, high = travel
    breaks = low + (high - low) * (directions.x + np.pi) / (2.0 * np.pi)
    scale = (2.0 * np.pi / (high - low)) ** np.arange(5, -1, -1)
    return Row(
        LUFFING_CYLINDER,
        breaks,
        sp.csr_matrix(sp.vstack(measured) @ T),
        np.tile([0, 1], (len(breaks) - 1, 1)),
        directions.c * scale[:, None, None],
        0.0 if cylinder.stiffness is None else 1.0 / cylinder.stiffness,
    )


def direction_polynomial(cylinder: LuffingCylinder) -> PPoly:
    """Direction (2,) from foot to lug in the axes of the boom over a turn of the luffing angle."""
    breaks = np.linspace(-np.pi, np.pi, INTERVALS + 1)
    while True:
        polynomial = BPoly.from_derivatives(breaks, _with_derivatives(cylinder, breaks))
        halves = (breaks[1:] + breaks[:-1]) / 2.0
        quarters = (halves + breaks[:-1]) / 2.0
        off = np.maximum(*(np.abs(polynomial(x) - cylinder.direction(x)).max(axis=1) for x in (halves, quarters)))
        coarse = (off > ACCURACY) & (np.diff(breaks) > SHORTEST)
        if not coarse.any():
            return PPoly.from_bernstein_basis(polynomial)
        breaks = np.sort(np.concatenate([breaks, halves[coarse]]))


def _with_derivatives(cylinder: LuffingCylinder, angle: Array) -> Array:
    r"""Direction and its first two derivatives by the angles (n,), (n, 3, 2).

    The direction is :math:`e^{i \beta}`, x + i z, with :math:`\beta = \arg(r_1 - r_0 e^{-i \varphi})`.
    """
    foot, lug = complex(*cylinder.foot), complex(*cylinder.lug)
    turned = foot * np.exp(-1j * angle)
    reach = lug - turned
    first = 1j * turned / reach
    second = (turned / reach) + (turned / reach) ** 2
    of_angle, of_second = first.imag, second.imag
    direction = reach / np.abs(reach)
    derivatives = [direction, 1j * of_angle * direction, (1j * of_second - of_angle**2) * direction]
    complete = np.stack(derivatives, axis=1)
    return np.stack([complete.real, complete.imag], axis=2)
