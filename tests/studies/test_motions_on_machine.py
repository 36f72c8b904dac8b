"""Motions that studies compare have the forces on the machine that a run of the same scene has."""

from __future__ import annotations

import pytest
from turning_cylinder import Rigid, boom

from pmr.scene.mechanism import CYLINDER
from pmr.studies.motions import FullMotion


@pytest.mark.slow
def test_full_order_knows_the_force_of_the_luffing_cylinder() -> None:
    response = FullMotion.simulate(boom(30.0, "beam2d", 1e9)).response
    assert response.other(CYLINDER)[0] == pytest.approx(Rigid(0.5235987755982988).force, rel=1e-5)
