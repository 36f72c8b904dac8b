from __future__ import annotations

import numpy as np
import pytest

from pmr.models.box_section import box_section
from pmr.scene.structures import BoxProfile

BOOM = BoxProfile(width=0.3, height=0.4, wall=0.008)


def test_a_tube_is_one_rectangle_without_another() -> None:
    section = box_section(BOOM, 0.3)
    assert section.area == pytest.approx(0.308 * 0.408 - 0.292 * 0.392, rel=1e-12)
    assert section.second_moment_y == pytest.approx((0.308 * 0.408**3 - 0.292 * 0.392**3) / 12, rel=1e-12)
    assert section.second_moment_z == pytest.approx((0.408 * 0.308**3 - 0.392 * 0.292**3) / 12, rel=1e-12)


def test_torsion_is_bredts() -> None:
    """4 A_m^2 / (perimeter / t)."""
    assert box_section(BOOM, 0.3).torsion_constant == pytest.approx(4 * (0.3 * 0.4) ** 2 / (1.4 / 0.008), rel=1e-12)


@pytest.mark.parametrize("nu", [0.0, 0.3])
def test_the_shear_coefficient_of_a_square_tube_is_cowpers(nu: float) -> None:
    """20 (1 + nu) / (48 + 39 nu), tabulated on its own in the same paper."""
    section = box_section(BoxProfile(width=0.2, height=0.2, wall=0.005), nu)
    assert section.shear_area_y == pytest.approx(20 * (1 + nu) / (48 + 39 * nu) * section.area, rel=1e-12)
    assert section.shear_area_z == section.shear_area_y


@pytest.mark.parametrize(("width", "height"), [(1.0, 3.0), (0.02, 2.0)])
def test_the_webs_carry_the_shear(width: float, height: float) -> None:
    """The narrower the flanges, the nearer kappa A to 5/6 of the webs' area at nu = 0, and never above the webs'."""
    section = box_section(BoxProfile(width=width, height=height, wall=0.001), 0.0)
    webs = 2 * height * 0.001
    assert section.shear_area_z < webs
    assert section.shear_area_z == pytest.approx(5 / 6 * webs, rel=0.01 + 0.5 * width / height)


def test_turning_the_section_exchanges_its_axes() -> None:
    turned = box_section(BoxProfile(width=0.4, height=0.3, wall=0.008), 0.3)
    section = box_section(BOOM, 0.3)
    assert (turned.second_moment_y, turned.shear_area_z) == (section.second_moment_z, section.shear_area_y)
    assert np.isclose(turned.torsion_constant, section.torsion_constant, rtol=1e-12)
