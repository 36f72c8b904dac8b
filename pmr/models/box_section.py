r"""The box section of a beam: its properties from the dimensions of its mid-surface, and the stresses at its corners.

Area and second moments are those of the hollow rectangle, exactly.  The torsion constant is Bredt's for one closed
cell, :math:`4 A_m^2 / \oint ds / t` (Young, Budynas, Sadegh: Roark's Formulas for Stress and Strain, 8th ed., 2012,
section 10.3).  Warping is free and neglected: a box of unequal walls warps a little.

The shear areas are kappa A with Cowper's coefficient of the thin-walled box, :math:`m = b t_f / (h t_w)`,
:math:`n = b / h`, h along the force:

.. math::
    \kappa = \frac{10 (1 + \nu) (1 + 3 m)^2}{12 + 72 m + 150 m^2 + 90 m^3 + \nu (11 + 66 m + 135 m^2 + 90 m^3)
             + 10 n^2 ((3 + \nu) m + 3 m^2)}

Cowper: The shear coefficient in Timoshenko's beam theory, Journal of Applied Mechanics 33, 1966, 335-340, table 1.

Stresses in space, at both ends of each element, follow from stretching, bending and torsion:

.. math::
    \sigma = E\, (u' - y\, \psi_v' - z\, \psi_w'), \qquad \tau = \frac{G J \phi'}{2 A_m t}

with the section's rotations psi (slopes without shear), y and z of the outer corners, and Bredt's shear flow around the
area A_m within the wall's mid-line.  Moments are linear in an element, so its ends hold the largest ones.  Left out:
shear stresses of transverse forces, largest in the middle of a wall; warping; and all that a beam does not know of, as
walls that bend under pads.
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
    b, h, t = profile.width, profile.height, profile.wall
    area = 2.0 * t * (b + h)
    return BeamSection(
        area=area,
        second_moment_y=_second_moment(b, h, t),
        second_moment_z=_second_moment(h, b, t),
        torsion_constant=2.0 * t * (b * h) ** 2 / (b + h),
        shear_area_y=_shear_coefficient(h, b, poisson) * area,
        shear_area_z=_shear_coefficient(b, h, poisson) * area,
    )


def _second_moment(across: float, along: float, t: float) -> float:
    return float(((across + t) * (along + t) ** 3 - (across - t) * (along - t) ** 3) / 12.0)


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
    J, area = box_section(profile, material.poisson).torsion_constant, profile.width * profile.height
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
