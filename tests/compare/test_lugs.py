"""Forces of the two lugs of a pin, beside those by hand."""

from typing import Any

import numpy as np
import pytest

import pmr
from pmr.compare.forces import support_rows
from pmr.scene import Scene
from pmr.scene.built import Support

#: Load at the tip, 0.3 m to the left of the axis and 4 m from the pin, N.  A roller 1 m from the pin holds the boom up.
LOAD = {"x": 2000.0, "y": 100.0, "z": -500.0}
LENGTH, LEFT, SPACING = 4.0, 0.3, 0.4


def still(amount: float) -> dict[str, Any]:
    return {"kind": "constant", "amount": amount}


@pytest.mark.parametrize("stiffness", ["rigid", 1e9])
def test_lugs_share_the_force_and_bear_the_moment_as_a_couple(stiffness: str | float) -> None:
    """By hand: the pin bears (-2000, -100, -1500) N, 150 N m about x and 200 N m about z.

    Half of the force, all of it along y, and a couple of 200 / 0.4 along x and 150 / 0.4 along z make (-1500, -100,
    -375) N on one lug and (-500, -100, -1125) N on the other.
    """
    box = {"length": LENGTH, "width": 0.3, "height": 0.4, "wall": 0.01}
    pin = {"name": "pin", "on": "tail", "directions": ["x", "y", "z", "rx", "rz"], "stiffness": stiffness}
    loads = [
        {"name": f"F{d}", "on": "tip", "direction": d, "point": [LENGTH, LEFT, 0.0], "signal": still(amount)}
        for d, amount in LOAD.items()
    ]
    scene = Scene.model_validate(
        {
            "title": "pin",
            "body": {"model": "beam3d", "box": box},
            "mesh": {"elements": 8},
            "supports": [pin | {"lug_spacing": SPACING}, {"name": "roller", "on": 1.0, "directions": ["z"]}],
            "slider": {"path": still(3.0)},
            "pads": [{"name": "none", "moving": True, "faces": {"top": [0.0]}, "stiffness": 1e-3}],
            "loads": loads,
            "reduction": {"coordinates": 8, "estimate": False},
            "start": "equilibrium",
            "time": {"end": 0.02, "step": 0.01},
            "compare": {"against": [], "richer": "none"},
        }
    )
    rows = {row["name"]: row for row in support_rows(scene, pmr.simulate(scene, pmr.reduce(scene).reduced))}
    assert rows["pin"]["max"] == pytest.approx(np.linalg.norm([2000.0, 100.0, 1500.0]), rel=1e-6)
    assert rows["pin"]["lug"]["max"] == pytest.approx(np.linalg.norm([1500.0, 100.0, 375.0]), rel=1e-6)
    assert "lug" not in rows["roller"]


def test_both_lugs_together_bear_the_force_across_the_pin() -> None:
    """A pin along x: 1 N along y is halved, 1 N along x counts with both lugs, and 1 N m about z is 1 / d along y."""
    pin = Support(directions=("x", "y", "z", "ry", "rz"), lug_spacing=0.5)
    assert pin.lug_shares("y").tolist() == [[0.0, 0.5, 0.0]] * 2
    assert pin.lug_shares("x").tolist() == [[1.0, 0.0, 0.0]] * 2
    assert pin.lug_shares("rz").tolist() == [[0.0, 2.0, 0.0], [0.0, -2.0, 0.0]]
