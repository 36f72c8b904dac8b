r"""Section properties of a rectangular tube from the dimensions of its mid-surface.

Area and second moments are those of the hollow rectangle, exactly.  The torsion constant is Bredt's for one closed
cell, :math:`4 A_m^2 / \oint ds / t` (Young, Budynas, Sadegh: Roark's Formulas for Stress and Strain, 8th ed., 2012,
section 10.3).  Warping is free and neglected: a box of unequal walls warps a little.

The shear areas are kappa A with Cowper's coefficient of the thin-walled box, :math:`m = b t_f / (h t_w)`,
:math:`n = b / h`, h along the force:

.. math::
    \kappa = \frac{10 (1 + \nu) (1 + 3 m)^2}{12 + 72 m + 150 m^2 + 90 m^3 + \nu (11 + 66 m + 135 m^2 + 90 m^3)
             + 10 n^2 ((3 + \nu) m + 3 m^2)}

Cowper: The shear coefficient in Timoshenko's beam theory, Journal of Applied Mechanics 33, 1966, 335-340, table 1.
"""

from __future__ import annotations

from pmr.scene.structures import BeamSection, BoxProfile


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
    """Of the hollow rectangle, for bending in the direction `along`."""
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
