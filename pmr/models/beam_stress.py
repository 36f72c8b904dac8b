r"""Stresses of a beam in space at the corners of its box section, at both ends of each element.

.. math::
    \sigma = E\, (u' - y\, \psi_v' - z\, \psi_w'), \qquad \tau = \frac{G J \phi'}{2 A_m t}

with the section's rotations psi (slopes without shear), y and z of the outer corners, and Bredt's shear flow around the
area A_m within the wall's mid-line (Young, Budynas, Sadegh: Roark's Formulas for Stress and Strain, 8th ed., 2012,
section 10.3).  Moments are linear in an element, so its ends hold the largest ones.  Left out: shear stresses of
transverse forces, largest in the middle of a wall; warping; and all that a beam does not know of, as walls that bend
under pads.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.fields.grid import Grid
from pmr.fields.stress import FIBRE, StressRows
from pmr.models.profile import box_section
from pmr.models.tabulation import CellValues, as_rows
from pmr.scene.structures import Beam3DBody

Array = NDArray[np.float64]

#: Corners of the section by the signs of y and z.
CORNERS = {"bottom right": (-1, -1), "bottom left": (1, -1), "top left": (1, 1), "top right": (-1, 1)}


def stress_rows(axis: Grid, T: sp.csr_matrix, body: Beam3DBody, strains: CellValues) -> StressRows:
    """Axial stress and that of torsion.

    Parameters
    ----------
    axis : Grid
        Of the beam.
    T : (n', n) sparse matrix
        What the strains are of, from the model's coordinates.
    body : Beam3DBody
        With a profile.
    strains : CellValues
        u', psi_v', psi_w' and phi' at both ends of each element.
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
