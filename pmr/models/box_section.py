r"""The box section of a beam: its properties from the dimensions of its mid-surface, and the stresses at its corners.

Area and second moments are those of the hollow rectangle, exactly, its corners sharp or quarters of a ring.  The
torsion constant is Bredt's for one closed cell, :math:`4 A_m^2 / \oint ds / t` (Young, Budynas, Sadegh: Roark's
Formulas for Stress and Strain, 8th ed., 2012, section 10.3).  Warping is free and neglected: a box of unequal walls
warps a little.

The shear areas are kappa A with Cowper's coefficient of the thin-walled box, :math:`m = b t_f / (h t_w)`,
:math:`n = b / h`, h along the force:

.. math::
    \kappa = \frac{10 (1 + \nu) (1 + 3 m)^2}{12 + 72 m + 150 m^2 + 90 m^3 + \nu (11 + 66 m + 135 m^2 + 90 m^3)
             + 10 n^2 ((3 + \nu) m + 3 m^2)}

Cowper: The shear coefficient in Timoshenko's beam theory, Journal of Applied Mechanics 33, 1966, 335-340, table 1.
Corners of radius r change it as they change the share of the energy of a force's shear flow S / I in the wall,

.. math:: I_l^2 \Big/ \Bigl(l \oint S^2 ds\Bigr), \qquad S = \int z\, ds, \qquad I_l = \oint z^2 ds

with l the length of the mid-line: exact within 2 % for the circular tube that is left of a square box in the end.

Stresses in space, at both ends of each element, follow from stretching, bending and torsion:

.. math::
    \sigma = E\, (u' - y\, \psi_v' - z\, \psi_w'), \qquad \tau = \frac{G J \phi'}{2 A_m t}

with the section's rotations psi (slopes without shear), y and z of the outer corners, and Bredt's shear flow around the
area A_m within the wall's mid-line.  Moments are linear in an element, so its ends hold the largest ones.  Left out:
shear stresses of transverse forces, largest in the middle of a wall; warping; and all that a beam does not know of, as
walls that bend under pads.  Outer corners that are rounded have the stresses of sharp ones, which are larger.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from pmr.fields.series import Grid
from pmr.fields.stress import FIBRE, StressRows
from pmr.models.tabulation import CellValues, as_rows
from pmr.scene.structures import Beam3DBody, BeamSection, BoxProfile

#: Corners of the section by the signs of y and z.
CORNERS = {"bottom right": (-1, -1), "bottom left": (1, -1), "top left": (1, 1), "top right": (-1, 1)}


def box_section(profile: BoxProfile, poisson: float) -> BeamSection:
    """Properties of the tube, walls of one thickness; width along y, height along z."""
    b, h, t, r = profile.width, profile.height, profile.wall, profile.radius
    around = _around(b, h, r)
    area = around * t
    return BeamSection(
        area=area,
        second_moment_y=_second_moment(b, h, t, r),
        second_moment_z=_second_moment(h, b, t, r),
        torsion_constant=4.0 * _enclosed(profile) ** 2 * t / around,
        shear_area_y=_shear_coefficient(h, b, poisson) * _rounding(h, b, r) * area,
        shear_area_z=_shear_coefficient(b, h, poisson) * _rounding(b, h, r) * area,
    )


def _around(b: float, h: float, r: float) -> float:
    """Length of the wall's mid-line, m."""
    return 2.0 * (b + h) - (8.0 - 2.0 * np.pi) * r


def _enclosed(profile: BoxProfile) -> float:
    """Area within the wall's mid-line, m^2."""
    return profile.width * profile.height - (4.0 - np.pi) * profile.radius**2


def _second_moment(across: float, along: float, t: float, r: float) -> float:
    """Of a hollow rectangle, less its corners and with those of a hollow rectangle of rings."""
    sharp = ((across + t) * (along + t) ** 3 - (across - t) * (along - t) ** 3) / 12.0
    return float(sharp - _outside(along + t, r + t / 2.0) + _outside(along - t, r - t / 2.0)) if r else float(sharp)


def _outside(along: float, r: float) -> float:
    """Second moment of what a rectangle loses as its four corners are rounded: squares less quarters of a circle."""
    middle = along / 2.0 - r  # of the circles; the centroid of a quarter is 4 r / (3 pi) from it
    square = r**2 * (middle + r / 2.0) ** 2 + r**4 / 12.0
    quarter = np.pi * r**4 / 16.0 + np.pi * r**2 / 4.0 * (middle**2 + 2.0 * middle * 4.0 * r / (3.0 * np.pi))
    return float(4.0 * (square - quarter))


def _rounding(across: float, along: float, r: float) -> float:
    """The energy's share over that of sharp corners; 1 for r = 0."""
    return _flow_share(across, along, r) / _flow_share(across, along, 0.0)


def _flow_share(across: float, along: float, r: float) -> float:
    """I_l^2 / (l times the integral of S^2), by Gauss' rule over a quarter of the mid-line: flat, corner, web."""
    x, w = np.polynomial.legendre.leggauss(12)
    x, w = (x + 1.0) / 2.0, w / 2.0
    flat, web, top = across / 2.0 - r, along / 2.0 - r, along / 2.0
    angle, at = np.pi / 2.0 * x, flat * top
    corner = at + web * r * angle + r**2 * np.sin(angle)
    at += web * r * np.pi / 2.0 + r**2
    z = web * (1.0 - x)
    squares = flat * w @ (flat * x * top) ** 2 + np.pi / 2.0 * r * w @ corner**2
    squares += web * w @ (at + (web**2 - z**2) / 2.0) ** 2
    moment = flat * top**2 + np.pi / 2.0 * r * w @ (web + r * np.cos(angle)) ** 2 + web**3 / 3.0
    return float((4.0 * moment) ** 2 / (_around(across, along, r) * 4.0 * squares))


def _shear_coefficient(across: float, along: float, nu: float) -> float:
    m = n = across / along
    return (
        10.0 * (1.0 + nu) * (1.0 + 3.0 * m) ** 2
        / (
            12.0 + 72.0 * m + 150.0 * m**2 + 90.0 * m**3
            + nu * (11.0 + 66.0 * m + 135.0 * m**2 + 90.0 * m**3)
            + 10.0 * n**2 * ((3.0 + nu) * m + 3.0 * m**2)
        )
    )  # fmt: skip


def stress_rows(axis: Grid, T: sp.csr_matrix, body: Beam3DBody, strains: CellValues) -> StressRows:
    """Axial stress and that of torsion of a body with a profile, on coordinates that T (n', n) takes to the space's.

    `strains` are u', psi_v', psi_w' and phi' at both ends of each element.
    """
    profile, material, elements = body.profile, body.material, np.repeat(np.arange(len(axis.cells)), 2)
    assert profile is not None
    stretch, along_y, along_z, twist = strains.entries.reshape(len(elements), 4, -1).transpose(1, 0, 2)
    half = np.array([profile.width + profile.wall, profile.height + profile.wall]) / 2.0
    J, area = box_section(profile, material.poisson).torsion_constant, _enclosed(profile)
    shear = material.shear_modulus * J / (2.0 * area * profile.wall) * twist
    signs = np.array(list(CORNERS.values()))
    axial = [material.young * (stretch - y * along_y - z * along_z) for y, z in signs * half]
    entries = np.concatenate([np.stack([a, shear], axis=1) for a in axial])
    coordinates = np.tile(strains.coordinates[elements], (len(CORNERS), 1))
    local = as_rows(entries, coordinates, T.shape[0])
    places = [axis.points[axis.cells.ravel()] + [0.0, *(corner * half)] for corner in signs]
    return StressRows(
        rows=sp.csr_matrix(local @ T),
        mises=FIBRE,
        components=("axial", "torsion"),
        points=np.concatenate(places),
        cell=np.tile(elements, len(CORNERS)),
        faces=tuple(CORNERS),
        face=np.repeat(np.arange(len(CORNERS)), len(elements)),
    )
