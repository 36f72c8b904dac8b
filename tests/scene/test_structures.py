"""Play at the pads of a joint where a run begins in equilibrium: what takes it up, and what does not.
Whether the walls of a beam give way: what that takes, and what it changes.
"""

from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError
from turning_cylinder import boom

from pmr import InputError
from pmr import scene as scenes
from pmr.scene import Scene
from pmr.scene.checks import check_scene
from pmr.scene.choice import choose_model, has_giving_walls, has_walls_that_could_give
from pmr.scene.members import member_at, ring_name
from pmr.scene.structures import BoxProfile, Material, PointMass


def test_the_shear_modulus_follows() -> None:
    assert Material(young=2.6, poisson=0.3).shear_modulus == pytest.approx(1.0)


def test_a_wall_thicker_than_the_tube_is_refused() -> None:
    with pytest.raises(ValidationError, match="less than 0.15 m, half of width and height"):
        BoxProfile(width=0.3, height=0.4, wall=0.3)


def test_negative_masses_and_incompressible_materials_are_refused() -> None:
    with pytest.raises(ValidationError, match="greater than or equal to 0"):
        PointMass(name="m", on="tip", mass=-1.0)
    with pytest.raises(ValidationError, match="less than 0.5"):
        Material(poisson=0.5)


BOOM = "boom"
MODELS = ("beam3d", "shell", "solid")
REST = "pads=[{{name='tail',{tail}}},{{name='mouth',moving=true,{mouth}}}]"
FITS = {"tail": "at=0.15,faces={bottom=[0.11],left=[-0.16]}", "mouth": "faces={top=[0.0],right=[0.0]}"}


def refused(model: str, *changes: str) -> str:
    with pytest.raises(InputError) as error:
        scenes.load(BOOM, [f"body.model={model}", *changes])
    return str(error.value)


def pads(**changed: str) -> str:
    return REST.format(**(FITS | changed))


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(("at", "reach"), [("15.0", "14.85 to 15.15"), ("-0.2", "-0.35 to -0.05"),
                                           ("6.2", "6.05 to 6.35"), ("0.149", "-0.001 to 0.299")])  # fmt: skip
def test_a_pad_off_or_partly_off_the_ends_is_refused(model: str, at: str, reach: str) -> None:
    said = refused(model, pads(tail=f"at={at},faces={{bottom=[0.0]}}"))
    assert f"pads[0].at = {float(at)}: the pad tail bottom reaches from {reach} m along the axis" in said
    assert "on the face bottom, from 0 to 6 m" in said


@pytest.mark.parametrize("model", MODELS)
def test_a_pad_off_or_partly_off_the_sides_is_refused(model: str) -> None:
    said = refused(model, pads(tail="at=0.15,faces={bottom=[-1.0,1.0]}"))
    assert "pads[0].faces.bottom = -1.0: the pad tail bottom right reaches from -1.04 to -0.96 m across" in said
    assert "the flat face bottom offers -0.15 to 0.15 m" in said
    assert "left offers -0.2 to 0.2 m" in refused(model, pads(tail="at=0.15,faces={left=[0.17]}"))
    assert "bottom offers -0.1 to 0.1 m" in refused(model, pads(), "body.box.radius=0.05")


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(("path", "reach"), [("7.0,8.0", "6.85 to 8.15"), ("3.0,5.9", "2.85 to 6.05"),
                                             ("0.1,3.0", "-0.05 to 3.15")])  # fmt: skip
def test_a_path_that_takes_a_pad_off_is_refused(model: str, path: str, reach: str) -> None:
    said = refused(model, pads(), f"slider.path={{kind='smooth_ramp',times=[1.0,5.0],values=[{path}]}}")
    assert f"slider.path: the pad mouth top reaches from {reach} m along the axis as s goes from" in said


@pytest.mark.parametrize("model", MODELS)
def test_pads_that_touch_the_rims_of_their_faces_fit(model: str) -> None:
    whole = "slider.path={kind='smooth_ramp',times=[1.0,5.0],values=[0.15,5.85]}"
    assert scenes.load(BOOM, [f"body.model={model}", pads(), whole]).title


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
        with pytest.raises(InputError, match=r"clearance.*at t = 0 no load along y takes up the play of s1"):
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


WORKFLOWS = Path(__file__).parents[2] / "workflows"


def test_walls_give_way_unless_stresses_take_a_shell() -> None:
    boom = WORKFLOWS / "boom.toml"
    chosen = member_at(scenes.load(boom, ["body.walls=give"]))
    assert choose_model(chosen).model == "beam3d" and has_giving_walls(chosen)
    stresses = member_at(scenes.load(boom, ["body.walls=give", "recovery.stress=true"]))
    assert choose_model(stresses).model == "shell" and not has_giving_walls(stresses)


def test_walls_could_give_under_pads_alone() -> None:
    """A warning of the model's error advised it on a cantilever without pads, where the key is refused."""
    boom = WORKFLOWS / "boom_beam.toml"
    assert has_walls_that_could_give(member_at(scenes.load(boom)))
    held = member_at(scenes.load(boom, ["supports=[{name='clamp',kind='clamped'}]"]))
    part = held.part.model_copy(update={"pads": (), "slider": None})
    assert not has_walls_that_could_give(member_at(held.scene.model_copy(update={"sections": (part,)})))


def test_a_shell_takes_over_the_scene_of_a_beam_whose_walls_give_way() -> None:
    """As studies do, which compare the two."""
    scene = member_at(scenes.load(WORKFLOWS / "boom_beam_walls.toml", ["body.model=shell"]))
    assert choose_model(scene).model == "shell" and not has_giving_walls(scene)


def test_each_ring_of_a_joint_dents_a_wall_of_its_own() -> None:
    """Rings of one pattern share their rows where walls are rigid."""
    alike = scenes.load_any(WORKFLOWS / "boom_three.toml")
    own = scenes.load_any(WORKFLOWS / "boom_three.toml", ["section.body.walls=give"])
    for scene, count in ((alike, 1), (own, 4)):
        rings = [ring for number in (1, 2) for ring in scene.joint(number).rings]
        assert len({ring_name(scene, ring) for ring in rings}) == count
        assert len(member_at(scene, 1).pads) == count
