"""A ground below the machine of a scene and in a load chart: what is refused, in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmr import scene as scenes
from pmr.errors import InputError
from pmr.studies.limits import Limit

STILL = ("frame.unit=rad", "frame.luffing=0.3", "frame.slewing=0.0")
WORKFLOWS = Path(__file__).parents[2] / "workflows"
A, B, C = ("{name='a',at=[2.0,1.5]}", "{name='b',at=[-2.0,1.5]}", "{name='c',at=[-2.0,-1.5]}")
CARRIER = "{name='carrier',mass=9e3,at=[0.0,0.0,-1.0]}"


def ground(*outriggers: str, more: str = "") -> str:
    return f"frame.ground={{masses=[{CARRIER}],outriggers=[{','.join(outriggers)}]{more}}}"


REFUSED = [
    ((ground(A, B),), "frame.ground.outriggers = 2: three or more are allowed"),
    (
        (ground(A, "{name='b',at=[4.0,3.0]}", "{name='c',at=[-2.0,-1.5]}"),),
        "frame.ground.outriggers: places that are not on one line are allowed",
    ),
    ((ground(A, B, C, "{name='d',at=[2.0,1.5]}"),), r"frame.ground.outriggers.at = \[2.0, 1.5\]: a place of its own"),
    ((ground(A, B, C, "{name='a',at=[2.0,-1.5]}"),), "frame.ground.outriggers.name = 'a': a name of its own"),
    ((ground(A, B, "{name='c',at=[0.0,-1.5],stiffness=-1.0}"),), r"outriggers\[2\].stiffness = -1.0: .*greater than 0"),
    ((ground(A, B, "{name='c',at=[0.0,-1.5],stiff=1.0}"),), r"outriggers\[2\].stiff = 1.0: unknown key; did you mean"),
    ((ground(A, B, C, more=",slope=[100.0,0.0]"),), r"frame.ground.slope\[0\] = 100"),
    ((ground(A, B, C, more=",slope=[0.1,0.0]"), "frame.base.ry=0.1"), "frame.base.ry: none is allowed beside frame.gr"),
    ((ground(A, B, C), "frame.ground.masses.0.mass=0.0"), r"masses\[0\].mass = 0.0: .*greater than 0"),
    ((ground(A, B, C), "frame.ground.masses.0.inertia=[1.0,1.0,5.0]"), r"masses\[0\].inertia"),
    ((ground(A, B, C), "frame.machine={mass=1e4}"), "frame.ground: none is allowed beside frame.machine"),
    ((ground(A, B, C), "sections.base.supports.0.points=all"), "supports = 'all': 'mean' is allowed beside frame.gro"),
]  # fmt: skip


def test_a_slope_below_a_free_luffing_angle_is_refused() -> None:
    with pytest.raises(InputError, match="frame.ground.slope: none is allowed beside frame.luffing = 'free'"):
        scenes.load_any(WORKFLOWS / "luffing_oil.toml", [ground(A, B, C, more=",slope=[1.0,0.0]")])


@pytest.mark.parametrize(("changes", "told"), REFUSED)
def test_a_ground_that_can_hold_no_machine_is_refused_in_one_line(changes: tuple[str, ...], told: str) -> None:
    with pytest.raises(InputError, match=told) as refused:
        scenes.load_any(WORKFLOWS / "crane.toml", [*STILL, *changes])
    assert "\n" not in str(refused.value)


def test_limits_on_what_a_machine_stands_on_need_a_ground() -> None:
    bare = scenes.load_any(WORKFLOWS / "crane.toml")
    stands = scenes.load_any(WORKFLOWS / "crane.toml", [ground(A, B, C)])
    for limit in (
        Limit(name="t", of="tipping", most=0.8),
        Limit(name="o", of="outrigger", most=1e5),
        Limit(name="l", of="lift-off", least=1e3),
        Limit(name="v", of="overturning"),
    ):
        limit.check(stands)
        with pytest.raises(InputError, match=f"limits.{limit.name}.of = '{limit.of}': a scene with frame.ground"):
            limit.check(bare)
    with pytest.raises(ValueError, match="polygon and machine belong to a limit of overturning"):
        Limit(name="t", of="tipping", most=0.8, polygon=[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
