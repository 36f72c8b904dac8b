from __future__ import annotations

import pytest
from pydantic import ValidationError

from pmr.scene.structures import Beam3DBody, BeamSection, BoxProfile, Material, PointMass

PROFILE = BoxProfile(width=0.3, height=0.4, wall=0.008)
SECTION = BeamSection(area=1e-2, second_moment_y=1e-5, second_moment_z=1e-5, torsion_constant=1e-5)


def test_the_shear_modulus_follows() -> None:
    assert Material(young=2.6, poisson=0.3).shear_modulus == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({}, "give section or profile, one of them"),
        ({"section": SECTION, "profile": PROFILE}, "give section or profile, one of them"),
        ({"section": SECTION, "shear": True}, "needs section.shear_area_y and section.shear_area_z"),
        ({"profile": PROFILE, "length": 0.0}, "greater than 0"),
        ({"profile": PROFILE, "elements": 0}, "greater than or equal to 1"),
    ],
)
def test_a_beam_that_makes_no_sense_is_refused(changes, says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        Beam3DBody(**({"length": 1.0} | changes))


def test_a_wall_thicker_than_the_tube_is_refused() -> None:
    with pytest.raises(ValidationError, match="less than 0.15 m, half of width and height"):
        BoxProfile(width=0.3, height=0.4, wall=0.3)


def test_negative_masses_and_incompressible_materials_are_refused() -> None:
    with pytest.raises(ValidationError, match="greater than or equal to 0"):
        PointMass(name="m", on="tip", mass=-1.0)
    with pytest.raises(ValidationError, match="less than 0.5"):
        Material(poisson=0.5)
