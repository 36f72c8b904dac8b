"""What a model leaves out follows from its scene, and a hung force without a mass is named."""

from pathlib import Path

import pytest

from pmr import InputError
from pmr import scene as scenes
from pmr.cli.app import TEMPLATES
from pmr.scene.choice import observed_places
from pmr.scene.hints import hints, left_out
from pmr.scene.members import member_at

CRANE = Path(str(TEMPLATES / "crane.toml"))
HUNG = "sections.fly.loads.wind={axes='ground', direction='z', signal=-9810.0}"


def test_what_is_left_out_follows_from_the_scene() -> None:
    crane = left_out(scenes.load_any(CRANE))
    assert "bending of walls under pads (in stresses of beams)" in crane["strength"] and "fatigue" in crane["strength"]
    assert "friction" in crane["pads"] and "swing of the payload" in crane["loads"] and "ground" in crane["machine"]
    assert "cylinders" in crane["masses"] and "masses" not in left_out(scenes.load_any("paper_evolved"))
    rubbing = scenes.load_any(CRANE, ["section.joint.tail.0.friction=0.1", "sections.fly.masses=[]"])
    other = left_out(rubbing)
    assert "friction" not in other["pads"] and "swing" not in other["loads"]
    at_rest = left_out(rubbing, at_rest=True)["pads"]  # as in a load chart without error bars
    assert "friction" in at_rest and "play (at side pads" in at_rest
    assert left_out(scenes.load_any(Path("workflows/paper_simple.toml"))) == {}
    assert "relief valves" in left_out(scenes.load_any("luffing_oil"))["machine"] and "relief" not in crane["machine"]


def test_walls_that_are_rigid_under_pads_are_named_with_the_key_by_which_they_give() -> None:
    said = left_out(scenes.load_any(Path("workflows/luffing_oil.toml")))["walls"]
    assert all(word in said for word in ("deflections", "frequencies", "forces of pads", "body.walls = 'give'"))
    assert "walls" not in left_out(scenes.load_any(CRANE))  # whose walls give
    assert "walls" in left_out(scenes.load_any(CRANE, ["sections.fly.body.walls=rigid"]), at_rest=True)
    assert "walls" not in left_out(scenes.load_any(Path("workflows/boom_three_shell.toml")))


def test_sides_of_doublers_and_lines_of_action_are_named_unless_the_scene_has_them() -> None:
    doubled = "sections.fly.body.box.doublers=[{{start=0.0,end=0.5,thickness=0.004,side='{}'}}]"
    middle, inner = (left_out(scenes.load_any(CRANE, [doubled.format(side)])) for side in ("middle", "inner"))
    assert "doublers" in middle["walls"] and "walls" not in inner and "offset" in inner["machine"]
    offset = "joint.cylinder.offset=[0.0,-0.1]"
    some, placed = (left_out(scenes.load_any(CRANE, [f"{of}.{offset}"])) for of in ("sections.fly", "section"))
    assert "cylinder or rope of middle off the axis (key offset)" in some["machine"]
    assert "offset" not in placed["machine"]


def test_kinds_of_an_extension_name_the_free_one_and_kinds_of_an_angle_do_not() -> None:
    for key, has_free in (("section.joint.extension", True), ("frame.slewing", False)):
        with pytest.raises(InputError) as refused:
            scenes.load_any(CRANE, [f"{key}.kind='fre'"])
        assert ("free" in refused.value.allowed) is has_free and "smooth_ramp" in refused.value.allowed


def test_a_hung_force_without_a_mass_is_named_in_one_remark() -> None:
    assert hints(scenes.load_any(CRANE)) == []
    (remark,) = hints(scenes.load_any(CRANE, [HUNG, "sections.fly.masses=[]"]))
    assert "fly: wind (1000 kg) is a force without mass" in remark
    assert hints(scenes.load_any(CRANE, [HUNG])) == []  # 1150 kg hang there


def test_a_shell_is_observed_between_its_ends_unless_the_scene_says_where() -> None:
    shell = scenes.load_any(CRANE, ["sections.fly.body.model=shell"])
    places = observed_places(member_at(shell, 2))
    assert places is not None and (len(places), places[0], places[-1]) == (29, pytest.approx(0.3), pytest.approx(5.7))
    assert observed_places(member_at(shell, 0)) is None


def test_a_payload_is_refused_where_a_chart_hangs_no_load() -> None:
    """It would be left out of the chart and nothing hung in its place."""
    weight = "sections.base.masses=[{name='box', on='tip', mass=500.0, payload=true}]"
    with pytest.raises(InputError, match="a mass on the tip of the last section"):
        scenes.load_any(CRANE, [weight])
