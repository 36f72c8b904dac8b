from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pmr import InputError
from pmr import scene as scenes
from pmr.fullmodel.from_scene import structure_of
from pmr.scene import Damping, Scene
from pmr.scene.choice import choose_model, wall_frequency
from pmr.scene.members import member_at

WORKFLOWS = Path(__file__).parents[2] / "workflows"
AT_THE_WEB = (
    "pads=[{name='a',at=0.15,width=0.06,faces={bottom=[-0.12,0.12],top=[-0.12,0.12]}},"
    "{name='b',moving=true,width=0.06,faces={top=[-0.12,0.12]}}]"
)
PROBE = "probes=[{name='p',at=[3.0,0.0,0.2],measures=['%s']}]"
VERTICAL = "loads=[{name='F',signal=1000.0}]"


@pytest.fixture
def load() -> Callable[..., Scene]:
    def loaded(*overrides: str) -> Scene:
        scene = scenes.load(WORKFLOWS / "boom.toml", overrides)
        return scene

    return loaded


def test_rings_become_pads_with_names_that_differ(load) -> None:
    names = [name for ring in load().pads for name, _, _ in ring.named_pads]
    assert names[:6] == [
        "tail bottom right", "tail bottom left", "tail top right", "tail top left", "tail left", "tail right"
    ]  # fmt: skip
    assert len(set(names)) == 12


def test_a_dumped_scene_is_the_same_scene(load) -> None:
    scene = load()
    again = Scene.model_validate(scene.model_dump(mode="json"))
    assert again == scene and again.hash == scene.hash


def test_gravity_is_the_last_input_and_comes_up_smoothly(load) -> None:
    names = list(member_at(load()).signals)
    assert names[-1] == "gravity" and len(names) == 3
    weight = member_at(load()).signals["gravity"]
    assert weight.value([0.0, 0.5, 1.0, 9.0]) == pytest.approx([0.0, 9.80665 / 2, 9.80665, 9.80665])
    assert member_at(load("gravity.rise=0.0")).signals["gravity"].value(0.0) == 9.80665


@pytest.mark.parametrize("direction", ["[-1.0,0.0,-1.0]", "[-1e-200,0.0,-1e-200]", "[-1e300,0,-1e300]"])
def test_of_the_direction_of_gravity_the_length_does_not_count(load, direction: str) -> None:
    found = load(f"gravity.direction={direction}").gravity
    assert found.direction == pytest.approx((-np.sqrt(0.5), 0.0, -np.sqrt(0.5)), rel=1e-15)
    assert load("gravity.direction=[0.0,0.0,-2.0]").hash == load().hash  # a length of two is that of one
    again = Scene.model_validate(load(f"gravity.direction={direction}").model_dump(mode="json"))
    assert again.gravity.direction == found.direction


def test_an_inclination_stands_in_the_place_of_a_direction(load) -> None:
    found = load("gravity.inclination=30.0").gravity
    assert found.direction == pytest.approx(
        (-0.5, 0.0, -np.sqrt(0.75)), rel=1e-15
    ) and found.elevation == pytest.approx(30)
    assert load("gravity.inclination=0").hash == load().hash
    after = load("gravity.direction=[0.0,1.0,0.0]", "gravity.inclination=-90.0").gravity  # the last one counts
    assert after.direction == pytest.approx((1.0, 0.0, 0.0), abs=1e-15)
    for wrong, says in (("91", "less than or equal to 90"), ("true", "number"), ("'steep'", "number")):
        with pytest.raises(InputError, match=f"gravity.inclination = .*{says}"):
            load(f"gravity.inclination={wrong}")
    with pytest.raises(InputError, match="did you mean 'inclination'"):
        load("gravity.inclinaton=3")


def test_free_modes_with_residual_flexibility_are_the_default(load) -> None:
    assert load().reduction.basis == "free_modes" and load().reduction.flexibility
    held = load("reduction.basis=eigenmodes")
    assert held.reduction.positions == "path" and not held.reduction.flexibility


def test_damping_by_ratio_is_rayleigh_damping(load) -> None:
    found = load().damping
    for f in (10.0, 60.0):
        omega = 2.0 * np.pi * f
        assert (found.mass / omega + found.stiffness * omega) / 2.0 == pytest.approx(0.005, rel=1e-12)
    with pytest.raises(ValueError, match="two ascending frequencies"):
        Damping.model_validate({"ratio": 0.01, "frequencies": [60.0, 10.0]})


def test_damping_is_given_anew_in_either_way(load, tmp_path: Path) -> None:
    assert load("damping.mass=0.5").damping == Damping(mass=0.5)
    assert load("damping={mass=0.5,stiffness=1e-4}").damping == Damping(mass=0.5, stiffness=1e-4)
    (tmp_path / "plain.toml").write_text(
        f"extends = '{(WORKFLOWS / 'boom.toml').resolve()}'\n[damping]\nmass = 0.5\nstiffness = 1e-4\n"
    )
    plain = scenes.load(tmp_path / "plain.toml")
    assert plain.damping == Damping(mass=0.5, stiffness=1e-4)
    back = scenes.load(tmp_path / "plain.toml", ["damping.ratio=0.005", "damping.frequencies=[10.0,60.0]"])
    assert back.damping == load().damping


def test_damping_in_two_ways_names_the_file_that_has_both(tmp_path: Path) -> None:
    both = tmp_path / "both.toml"
    both.write_text(f"extends = '{(WORKFLOWS / 'boom.toml').resolve()}'\n[damping]\nmass = 0.5\nratio = 0.01\n")
    with pytest.raises(InputError, match="both.toml: damping: ratio with two ascending frequencies"):
        scenes.load(both)
    with pytest.raises(InputError, match="^--set: damping: ratio with two"):
        scenes.load(WORKFLOWS / "boom.toml", ["damping.frequencies=[60.0,10.0]"])


@pytest.mark.parametrize(
    ("overrides", "model", "reason"),
    [
        ((), "beam3d", "the load gust acts along y"),
        (("body.box.frames=[3.0]", "body.box.frame_depth=0.05"), "shell", "the box has frames"),
        ((AT_THE_WEB, VERTICAL), "beam2d", "all loads and masses lie in the vertical plane"),
        ((AT_THE_WEB, VERTICAL, "recovery={every=0.1}"), "shell", "stresses are computed"),
        ((AT_THE_WEB, VERTICAL, PROBE % "strain"), "shell", "stresses are computed"),
        ((AT_THE_WEB, VERTICAL, PROBE % "displacement"), "beam2d", "vertical"),
        ((AT_THE_WEB, VERTICAL, "body.box.wall=0.002"), "beam2d", "vertical plane"),
        ((AT_THE_WEB, "loads=[{name='F',signal={kind='sine',amplitude=1.0,frequency=50.0}}]"), "shell",
         "loads of 50 Hz come near the walls' own frequency of 123 Hz"),
        (("body.model=solid",), "solid", "the scene names it"),
        ((AT_THE_WEB, VERTICAL, "loads.0.point=[6.0,0.4,0.0]"), "beam3d", "has a place of its own, loads.point"),
        ((VERTICAL, *(f"pads.{ring}.faces={{bottom=[-0.1,0.05],top=[0.0],left=[0.0],right=[0.0]}}" for ring in (
         "tail", "mouth"))), "beam3d", "pads at the bottom or top are not alike at left and right"),
    ],
)  # fmt: skip
def test_the_scene_decides_what_a_model_has_to_carry(load, overrides, model, reason) -> None:
    chosen = choose_model(member_at(load(*overrides)))
    assert chosen.model == model and reason in chosen.reasons[0]


def test_a_wall_is_a_long_plate() -> None:
    """The modes of the reference boom that distort its walls begin at 89 Hz, between hinged and less than hinged."""
    box = scenes.load(WORKFLOWS / "boom.toml").body.box  # type: ignore[attr-defined]
    assert wall_frequency(box, 210e9, 0.3, 7850.0) == pytest.approx(122.9, abs=0.1)


def test_a_model_is_made_for_the_path_or_for_all_of_its_travel(load) -> None:
    assert load().travel == load().path_bounds == (1.5, 4.0)
    assert load("slider.travel=[1.500002,3.999998]").travel == (1.500002, 3.999998)  # measured paths overshoot
    wider = load("slider.travel=[1.4,4.2]")
    assert wider.travel == (1.4, 4.2) and wider.path_bounds == (1.5, 4.0) and wider.hash != load().hash
    assert structure_of(member_at(load("slider.travel=[1.4,4.2]", "body.model=beam3d"))).pads.travel == (1.4, 4.2)
    with pytest.raises(InputError, match="points may slide along the whole beam"):
        scenes.load(WORKFLOWS / "paper_simple.toml", ["slider.travel=[0.0,5.0]"])
