from __future__ import annotations

import numpy as np
import pytest

from pmr.fullmodel.pads import slider_row
from pmr.models.beam2d import Beam2D
from pmr.scene.structures import Profile
from pmr.system.rows import StraightRows

BEAM = Beam2D(
    Profile(length=3.0, bending_stiffness=1e6, mass_per_length=10.0, axial=False), np.array([0.0, 0.7, 1.6, 3.0])
)


@pytest.mark.parametrize("end", [0.0, 1.1, 1.6, 3.0])
@pytest.mark.parametrize("x", [0.2, 0.7, 2.9])
def test_rows_are_what_bends_between_two_places(end: float, x: float) -> None:
    """Of a cubic, which the elements hold exactly, on both sides of the place that stays; zero for rigid motions."""
    w = np.poly1d([0.3, -0.5, 0.2, 0.1])
    q = np.stack([w(BEAM.nodes), w.deriv()(BEAM.nodes)], axis=1).ravel()
    first, second = StraightRows(end, ("a", "b")).rows(slider_row(BEAM))
    chord = w(end) - w(x)
    assert (first.at(x) @ q).item() == pytest.approx((x - end) * w.deriv()(end) + chord, abs=1e-13)
    assert (second.at(x) @ q).item() == pytest.approx((x - end) * w.deriv()(x) + chord, abs=1e-13)
    rigid = np.stack([[1.0, 0.0]] * 4).ravel(), np.stack([BEAM.nodes, np.ones(4)], axis=1).ravel()
    assert np.abs(np.concatenate([row.at(x) @ one for row in (first, second) for one in rigid])).max() < 1e-14
    assert (first.name, second.name) == ("a", "b")
