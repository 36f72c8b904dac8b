r"""Stresses in the outer corners of a beam's profile, from section forces.

Navier's of the normal force and of bending, and Bredt's of the torque, in the thinner of both plates that meet.  Left
out: shear stresses of transverse forces, largest in the middle of a wall; warping; and all that a beam does not know
of, as walls that bend under pads.  Outer corners that are rounded have the stresses of sharp ones, which are larger.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from pmr.fields.envelope import FORCES, ForceRows
from pmr.fields.stress import FIBRE, StressRows
from pmr.models.profile_section import MidLine, section_of
from pmr.models.sections_along import SectionsAlong
from pmr.scene.profile import BoxProfile
from pmr.scene.structures import BeamSection

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
#: Places (k, 2) m in a profile by their names, and their stresses of unit section forces (k, c, 6).
Corners = tuple[dict[str, Array], Array]


def of_corners(profile: BoxProfile, section: BeamSection) -> Corners:
    r"""Axial stress and that of torsion in each corner of unit section forces, in the order of `FORCES`, (k, 2, 6).

    .. math:: \sigma = \frac{N}{A} + \begin{pmatrix} -M_z & M_y \end{pmatrix} I^{-1} (p - c), \qquad
        \tau = \frac{T}{2 A_m t}
    """
    I = np.array([[section.second_moment_z, section.product_of_inertia],
                  [section.product_of_inertia, section.second_moment_y]])  # fmt: skip
    stresses_of_corners, enclosed = np.zeros((len(profile.corners), 2, len(FORCES))), MidLine(profile).enclosed_area
    for stresses, corner in zip(stresses_of_corners, profile.corners, strict=True):
        of_z, of_y = np.linalg.solve(I, np.subtract(corner.at, section.centroid))
        stresses[0, [0, 4, 5]] = 1.0 / section.area, of_y, -of_z
        stresses[1, 3] = 1.0 / (2.0 * enclosed * corner.thickness)
    return {corner.name: np.array(corner.at) for corner in profile.corners}, stresses_of_corners


def of_fibres(profile: BoxProfile, section: BeamSection) -> Corners:
    """Axial stress of N and M_y below and above, (2, 1, 6)."""
    heights, stresses = [corner.at[1] for corner in profile.corners], np.zeros((2, 1, len(FORCES)))
    places = {"bottom": np.array([0.0, min(heights)]), "top": np.array([0.0, max(heights)])}
    stresses[:, 0, 0] = 1.0 / section.area
    stresses[:, 0, 4] = [(z - section.centroid[1]) / section.second_moment_y for _, z in places.values()]
    return places, stresses


def stresses_along(
    sections: SectionsAlong,
    number: Indices,
    forces: ForceRows,
    element: Indices,
    corners: Callable[[BoxProfile, BeamSection], Corners],
) -> StressRows | None:
    """Stresses of section forces at P places, in these sections and elements (P,); None where a section has no profile.

    Of a section that changes from place to place stresses are those of the profile at the place.
    """
    corners_of, keys = dict[tuple[int, float], Corners](), []
    for k, x in zip(number.tolist(), forces.x[: len(number)].tolist(), strict=True):
        stretch = sections.stretches[k]
        if stretch is None:
            return None
        same = stretch.first is stretch.last
        keys.append((k, 0.0 if same else x))
        if keys[-1] not in corners_of:
            profile = stretch.at(x)
            corners_of[keys[-1]] = corners(profile, sections.each[k] if same else section_of(profile, sections.poisson))
    at = {name: np.array([corners_of[key][0][name] for key in keys]) for name in corners_of[keys[0]][0]}
    return stress_rows(forces, element, at, np.array([corners_of[key][1] for key in keys]))


def stress_rows(forces: ForceRows, element: Indices, corners: Mapping[str, Array], of: Array) -> StressRows:
    """Stresses in corners of unit section forces, at each of the P places of section forces.

    Parameters
    ----------
    element : (P,) array
        Where the places of each force are.
    corners : dict of str to (P, 2) array, m
        Where in the section.
    of : (P, k, c, 6) array
        Stresses in k corners, c of them or the axial one alone.
    """
    count, components = len(element), of.shape[2]
    names = forces.names[::count]
    of = of[..., [list(FORCES).index(name) for name in names]]
    ends = np.arange(count * components + 1)
    local = [
        sp.hstack(
            [sp.csr_matrix((of_corner[..., n].ravel(), ends[:-1] // components, ends)) for n in range(len(names))]
        )
        for of_corner in np.moveaxis(of, 1, 0)
    ]
    rows = sp.csr_matrix(sp.vstack(local) @ forces.rows)
    rows.eliminate_zeros()
    x = forces.x[:count, None]
    return StressRows(
        rows=rows,
        mises=FIBRE[:components, :components],
        components=("axial", "torsion")[:components],
        points=np.concatenate([np.hstack([x, at]) for at in corners.values()]),
        cell=np.tile(element, len(corners)),
        faces=tuple(corners),
        face=np.repeat(np.arange(len(corners)), count),
    )
