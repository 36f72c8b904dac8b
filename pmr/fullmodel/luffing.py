r"""Constraint row of a luffing cylinder that holds a base: the cylinder's elongation over the luffing angle.

The cylinder goes from the foot on the machine to the lug on the boom.  At the luffing angle :math:`\varphi` the unit
vector from foot to lug, in the boom's axes, is :math:`d(\varphi)`.  The section of the boom at the lug is displaced by
u and turns by :math:`\theta`, and the lug is the height z above the boom's axis.  The cylinder then gets longer by

.. math:: c(\varphi)\, q = d_x(\varphi)\, (u_x + z\, \theta_y) + d_z(\varphi)\, u_z

with the row c on the coordinates q of the boom.  Between two breaks d is the polynomial of fifth degree that has the
exact values and first two derivatives at both.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.interpolate import BPoly, PPoly

from pmr.files.arrays import Array
from pmr.models import StructuralModel
from pmr.scene.cylinder import LuffingCylinder
from pmr.scene.keys import LUFFING_CYLINDER
from pmr.system.rows import Row

#: Intervals of a turn to begin with; error of a direction between two breaks; shortest interval, in rad.
INTERVALS, ACCURACY, SHORTEST = 16, 1e-9, 1e-3


def cylinder_row(
    cylinder: LuffingCylinder,
    tail: tuple[float, float, float],
    model: StructuralModel,
    T: sp.csr_matrix,
    travel: tuple[float, float],
) -> Row:
    """Constraint row of a luffing cylinder, a function of the luffing angle from -pi to pi.

    Parameters
    ----------
    tail : (3,) m
        Position of the base's tail relative to the pivot.
    model : StructuralModel
        Model of the base, with n coordinates q.
    T : (n, n') sparse matrix
        Gives q = T z from the n' coordinates z on which the row acts.
    travel : (2,) m
        Range of the path coordinate on which the other rows of the body are defined.  The angles -pi to pi are mapped
        linearly to this range, so that the breaks of the row are path coordinates in m.
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
    """Piecewise polynomial of the unit vector (2,) from foot to lug, its components along x and z in the boom's axes.

    Its argument is the luffing angle in rad from -pi to pi.  Intervals are halved until the error is at most `ACCURACY`
    or the length of the interval at most `SHORTEST`.
    """
    breaks = np.linspace(-np.pi, np.pi, INTERVALS + 1)
    while True:
        polynomial = BPoly.from_derivatives(breaks, _direction_derivatives(cylinder, breaks))
        halves = (breaks[1:] + breaks[:-1]) / 2.0
        quarters = (halves + breaks[:-1]) / 2.0
        off = np.maximum(*(np.abs(polynomial(x) - cylinder.direction(x)).max(axis=1) for x in (halves, quarters)))
        coarse = (off > ACCURACY) & (np.diff(breaks) > SHORTEST)
        if not coarse.any():
            return PPoly.from_bernstein_basis(polynomial)
        breaks = np.sort(np.concatenate([breaks, halves[coarse]]))


def _direction_derivatives(cylinder: LuffingCylinder, angle: Array) -> Array:
    r"""Unit vector from foot to lug and its first two derivatives by the luffing angle, (n, 3, 2), at `angle` (n,) rad.

    With the foot :math:`r_0` and the lug :math:`r_1` as complex numbers x + i z, and the luffing angle :math:`\varphi`,
    the unit vector is :math:`e^{i \beta}` with :math:`\beta = \arg(r_1 - r_0 e^{-i \varphi})`.
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
