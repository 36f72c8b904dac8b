"""Share of the force that a luffing cylinder bears, of a push, of a pull and of a slender rod."""

import numpy as np
import pytest

from pmr.scene.cylinder import LuffingCylinder

HINGES = {"foot": (0.5, -1.0), "lug": (2.0, -0.2)}


@pytest.mark.parametrize(
    ("keys", "used"),
    [
        ({"allowed_push": 4e5}, [0.5, 0.0, 0.0]),
        ({"allowed_pull": 1e5}, [0.0, 0.0, 1.0]),
        ({"allowed_push": 4e5, "allowed_pull": 4e5}, [0.5, 0.0, 0.25]),
        ({"rod": 0.08}, [2e5 / (np.pi**3 * 210e9 * 0.08**4 / 64.0), 0.0, 0.0]),  # at a length of 1 m
    ],
)
def test_the_share_of_an_allowed_force_by_its_way(keys: dict[str, float], used: list[float]) -> None:
    cylinder = LuffingCylinder(**HINGES, **keys)
    force, length = np.array([2e5, 0.0, -1e5]), np.array([1.0, 2.0, 1.0])
    allowed = cylinder.allowed_forces(length)
    assert np.maximum(np.maximum(force / allowed.push, -force / allowed.pull), 0.0) == pytest.approx(used)
    assert cylinder.has_allowed_forces and not LuffingCylinder(**HINGES).has_allowed_forces
