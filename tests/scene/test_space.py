from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pmr import scene as scenes
from pmr.errors import InputError
from pmr.scene import Damping, StructureScene, from_data
from pmr.scene.choice import choose, wall_frequency

WORKFLOWS = Path(__file__).parents[2] / "workflows"
AT_THE_WEB = (
    "pads=[{name='a',at=0.15,faces={bottom=[-0.15,0.15],top=[-0.15,0.15]}},{name='b',moving=true,faces={top=[0.15]}}]"
)
MOUTH = "name='mouth',moving=true,faces={bottom=[0.0]}"
VERTICAL = "loads=[{name='F',signal=1000.0}]"


@pytest.fixture
def load() -> Callable[..., StructureScene]:
    def loaded(*overrides: str) -> StructureScene:
        scene = scenes.load(WORKFLOWS / "boom.toml", overrides)
        assert isinstance(scene, StructureScene)
        return scene

    return loaded


def test_rings_become_pads_with_names_that_differ(load) -> None:
    names = [name for ring in load().pads for name, _, _ in ring.places]
    assert names[:6] == [
        "tail bottom right", "tail bottom left", "tail top right", "tail top left", "tail left", "tail right"
    ]  # fmt: skip
    assert len(set(names)) == 12


def test_a_dumped_scene_is_the_same_scene(load) -> None:
    scene = load()
    again = from_data(scene.model_dump(mode="json"))
    assert again == scene and again.hash == scene.hash


def test_gravity_is_the_last_input_and_comes_up_smoothly(load) -> None:
    *_, weight = load().signals
    assert weight.value([0.0, 0.5, 1.0, 9.0]) == pytest.approx([0.0, 9.80665 / 2, 9.80665, 9.80665])
    assert load("gravity.rise=0.0").signals[-1].value(0.0) == 9.80665


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


@pytest.mark.parametrize(
    ("overrides", "model", "reason"),
    [
        ((), "shell", "the pad tail bottom right presses on the middle of a wall, 0.05 m from the web"),
        ((AT_THE_WEB,), "beam3d", "the load gust acts along y"),
        ((AT_THE_WEB, VERTICAL), "beam2d", "all loads and masses lie in the vertical plane"),
        ((AT_THE_WEB, VERTICAL, "recovery={every=0.1}"), "shell", "stresses are asked for"),
        ((AT_THE_WEB, VERTICAL, "body.box.wall=0.002"), "beam2d", "vertical plane"),
        (
            (AT_THE_WEB, "loads=[{name='F',signal={kind='sine',amplitude=1.0,frequency=50.0}}]"),
            "shell",
            "loads of 50 Hz come near the walls' own frequency of 123 Hz",
        ),
        (("body.model=solid",), "solid", "the scene names it"),
    ],
)
def test_the_scene_decides_the_model(load, overrides, model, reason) -> None:
    chosen = choose(load(*overrides))
    assert chosen.model == model and reason in chosen.reasons[0]


def test_a_wall_is_a_long_plate() -> None:
    """The modes of the reference boom that distort its walls begin at 89 Hz, between hinged and less than hinged."""
    box = scenes.load(WORKFLOWS / "boom.toml").body.box  # type: ignore[attr-defined]
    assert wall_frequency(box, 210e9, 0.3, 7850.0) == pytest.approx(122.9, abs=0.1)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("body.model=plate", "body.model"),
        ("mesh.file=nowhere.msh", "mesh.file = 'nowhere.msh': no such file"),
        ("body.box.wall=0.5", "body.box.wall = 0.5: less than width and height is allowed"),
        ("slider.offsets=[0.1]", "slider.offsets"),
        ("pads=[]", "nothing slides"),
        (f"pads=[{{{MOUTH},unilateral=true}}]", "compare.against = ['full']: [] is allowed"),
        (f"pads=[{{{MOUTH},clearance=1e-3}}]", "pads[0].clearance = 0.001: 0 is allowed unless unilateral = true"),
        ("compare.against=['ancf']", "ANCF is for planar beams"),
        ("reduction={basis='eigenmodes',positions='nodes'}", "'path' or a list"),
        ("recovery={every=0.0015}", "recovery.every = 0.0015: a multiple of time.step"),
        ("body.model=beam2d", "loads.gust.direction = 'y': x, z and ry are allowed for beam2d"),
        ("masses=[{name='m',on='tip',mass=1.0},{name='m',on='tip',mass=2.0}]", "masses = 'm': names that differ"),
        ("body.thickness=0.01", "give box.wall or thickness, one of them"),
        ("body.shape=1", "unknown key; did you mean"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(load, override, message) -> None:
    with pytest.raises(InputError) as refused:
        load(override)
    assert message in str(refused.value) and "\n" not in str(refused.value)


def test_a_study_of_planar_beams_refuses_a_boom() -> None:
    with pytest.raises(InputError, match="a scene with a planar beam is allowed here"):
        scenes.vary_beam(WORKFLOWS / "boom.toml")
