"""Play at the pads of a joint where a run begins in equilibrium: what takes it up, and what does not."""

from __future__ import annotations

from typing import Any

import pytest
from turning_cylinder import boom

from pmr.errors import InputError
from pmr.scene import Scene
from pmr.scene.checks import check_scene


def loose(**frame: Any) -> dict[str, Any]:
    """A boom in space whose pads have play at the left and at the right."""
    plain = boom(30.0, "beam3d", 1e7).model_dump(mode="json")
    for end in ("tail", "mouth"):
        (ring,) = plain["sections"][1]["joint"][end]
        ring |= {"unilateral": True, "clearance": {"left": 1e-3, "right": 1e-3}}
        ring["faces"] |= {"top": [-0.06, 0.06], "right": [0.0]}
    plain["frame"] |= frame
    return plain


def constant(amount: float) -> dict[str, Any]:
    return {"kind": "constant", "amount": amount}


def test_nothing_takes_up_play_aside_on_level_ground() -> None:
    for frame in ({}, {"slewing": constant(40.0)}, {"base": {"ry": constant(5.0)}}):
        with pytest.raises(InputError, match=r"clearance.*no load along y takes up the play of s1 at t = 0"):
            check_scene(Scene.model_validate(loose(**frame)))


@pytest.mark.parametrize(
    "frame", [{"base": {"rx": constant(4.0)}}, {"slewing": constant(40.0), "base": {"ry": constant(5.0)}}]
)
def test_weight_on_a_slope_takes_up_play_aside(frame: dict[str, Any]) -> None:
    """Rolled, or pitched below a boom that is slewed: the vertical has a part across the boom."""
    check_scene(Scene.model_validate(loose(**frame)))


def test_a_load_along_the_ground_takes_it_up_where_the_boom_is_slewed() -> None:
    """Along X of the ground, which a boom that points there has not across it."""
    push = {"name": "wind", "on": "tip", "direction": "x", "axes": "ground", "signal": constant(10.0)}
    for angle, held in ((0.0, False), (40.0, True)):
        plain = loose(slewing=constant(angle))
        plain["sections"][1]["loads"].append(push)
        if held:
            check_scene(Scene.model_validate(plain))
        else:
            with pytest.raises(InputError, match="no load along y"):
                check_scene(Scene.model_validate(plain))
