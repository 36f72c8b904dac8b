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

from pmr.fields.stress import FIBRE, StressRows
from pmr.models.beam2d import HERMITE
from pmr.models.polyline import Polyline
from pmr.scene.structures import BoxProfile, Material

Array = NDArray[np.float64]

#: Corners of the section by the signs of y and z.
CORNERS = {"bottom right": (-1, -1), "bottom left": (1, -1), "top left": (1, 1), "top right": (-1, 1)}


def stress_rows(
    axis: Polyline, profile: BoxProfile, material: Material, torsion_constant: float, softening: tuple[Array, Array]
) -> StressRows:
    """Axial stress and that of torsion.

    Parameters
    ----------
    axis, profile, material
    torsion_constant : float, m^4
    softening : two (N - 1,) arrays, m^2
        Of each element by shear, in the planes of y and z (`pmr.models.beam3d.Bending`).
    """
    elements = np.repeat(np.arange(len(axis.segment)), 2)
    X, h = np.tile([0.0, 1.0], len(axis.segment)), np.diff(axis.stations)[elements]
    stretch, twist = np.zeros((2, len(h), 12))
    for part, component in ((stretch, 0), (twist, 1)):
        part[:, component], part[:, 6 + component] = -1.0 / h, 1.0 / h
    curvatures = []
    for start, soft in zip((2, 4), softening, strict=True):
        part = np.zeros((len(h), 12))
        part[:, [start, start + 1, 6 + start, 7 + start]] = _curvature(h, X, soft[elements]).T
        curvatures.append(part)
    half = np.array([profile.width + profile.wall, profile.height + profile.wall]) / 2.0
    shear = material.shear_modulus * torsion_constant / (2.0 * profile.width * profile.height * profile.wall) * twist
    signs = np.array(list(CORNERS.values()))
    axial = [material.young * (stretch - y * curvatures[0] - z * curvatures[1]) for y, z in signs * half]
    entries = np.stack([np.stack([a, shear], axis=1) for a in axial])
    columns = np.broadcast_to(6 * axis.local_cells[elements, 0, None, None] + np.arange(12), entries.shape)
    ends = np.arange(0, entries.size + 1, 12)
    shape = (entries.size // 12, 6 * len(axis.local_stations))
    local = sp.csr_matrix((entries.ravel(), columns.ravel(), ends), shape)
    nodes = axis.nodes[elements + X.astype(int)]
    places = [nodes + np.einsum("a,eai->ei", corner * half, axis.frames[elements, 1:]) for corner in signs]
    return StressRows(
        rows=sp.csr_matrix(local @ axis.transformation()),
        mises=FIBRE,
        components=("axial", "torsion"),
        points=np.concatenate(places),
        cell=np.tile(elements, len(CORNERS)),
        faces=tuple(CORNERS),
        face=np.repeat(np.arange(len(CORNERS)), len(elements)),
    )


def _curvature(h: Array, X: Array, soft: Array) -> Array:
    """Psi' at X h of elements, (4, e) on w_1, psi_1, w_2, psi_2: w'' + gamma (12 X - 6) / h, gamma = -soft w'''."""
    scale = np.stack([np.ones_like(h), h, np.ones_like(h), h])
    second, third = (np.array([np.polyval(np.polyder(p, k), X) for p in HERMITE]) * scale / h**k for k in (2, 3))
    return np.asarray(second - soft * third * (12.0 * X - 6.0) / h)
