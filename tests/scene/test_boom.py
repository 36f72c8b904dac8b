"""Scenes of several sections: what they take over from what they share, and what is refused in one line."""

import numpy as np
import pytest

from pmr import InputError
from pmr import scene as scenes
from pmr.scene import Scene
from pmr.scene.checks import check_scene
from pmr.scene.members import member_at, members

THREE = "boom_three"


def load(*changes: str) -> Scene:
    found = scenes.load_any(THREE, changes)
    return found


def test_sections_take_over_what_they_share_and_say_the_rest() -> None:
    boom = load("section.mesh.elements=12", "sections.fly.mesh.elements=20")
    assert boom.names == ("base", "middle", "fly") and boom.sections[0].joint is None
    assert [part.mesh.elements for part in boom.sections] == [12, 12, 20]
    assert [part.body.box.width for part in boom.sections if part.body.box] == [0.30, 0.26, 0.22]
    assert {part.body.box.length for part in boom.sections if part.body.box} == {6.0}
    assert (
        Scene.model_validate_json(boom.model_dump_json()).hash
        == boom.hash
        == load("section.mesh.elements=12", "sections.fly.mesh.elements=20", "title=Other").hash
        != load().hash
    )


def test_an_extension_is_a_signal_an_overlap_or_follows_another_one() -> None:
    boom = load("sections.fly.joint.follows=middle", "sections.fly.joint.ratio=0.5", "sections.fly.joint.offset=0.4")
    t = np.linspace(0.0, 8.0, 9)
    assert np.allclose(boom.paths["fly"].value(t), 0.4 + 0.5 * boom.paths["middle"].value(t))
    assert np.allclose(boom.paths["fly"].rate(t), 0.5 * boom.paths["middle"].rate(t))
    assert boom.paths["fly"].bounds(0.0, 8.0) == pytest.approx((0.7, 2.65))
    assert load("sections.fly.joint.overlap=2.0").reach(0.0) == pytest.approx(0.6 + 4.0 + 6.0)


def test_pads_measure_a_section_wherever_joints_take_them() -> None:
    boom = load()
    travels = [stretch for one in members(boom) for stretch in one.ring_ranges.values()]
    assert travels == [pytest.approx(pair) for pair in ((0.75, 5.85), (0.15, 5.85), (0.15, 5.25))]
    assert [ring.name for ring in member_at(boom, 1).pads] == ["pads 1"]
    mixed = load("sections.fly.joint.tail.0.length=0.1", "sections.fly.joint.tail.0.at=0.05")
    assert [len(one.ring_ranges) for one in members(mixed)] == [1, 2, 2]


def test_pads_beside_each_other_on_a_face_do_not_overlap() -> None:
    """Pads of the tail and of the mouth are 0.08 m and 0.04 m wide, their centres 0.061 m or 0.059 m apart."""
    faces = ["section.body.model=beam3d", "sections.fly.joint.tail.0.faces={bottom=[0.0],top=[0.0]}"]
    faces += ["sections.fly.joint.mouth.0.width=0.04", "sections.fly.joint.extension=5.5"]
    beside = "sections.fly.joint.mouth.0.faces={bottom=[-%s,%s],top=[0.08]}"
    load(*faces, beside % (0.061, 0.061))
    with pytest.raises(InputError, match="overlap on the bottom"):
        load(*faces, beside % (0.059, 0.059))


def test_a_frequency_response_leaves_no_friction_out() -> None:
    rubbing = [
        f"section.joint.{end}.0.{key}" for end in ("tail", "mouth") for key in ("unilateral=false", "friction=0.1")
    ]
    with pytest.raises(
        InputError, match=r"sections\[2\].observe.frequency_response = True: false is allowed, as pads have friction"
    ):
        load("section.body.model=beam3d", *rubbing, "sections.fly.observe.frequency_response=true")


def test_sections_are_held_along_the_boom_where_nothing_slides() -> None:
    """A clamped fly that stays, and one that is clamped while the section before it slides."""
    clamped = ["sections.fly.supports=[{on='tip',kind='clamped'}]", "sections.fly.joint.extension=1.0"]
    assert load(*clamped, "sections.middle.joint.extension=1.0").sections[2].supports[0].kind == "clamped"
    with pytest.raises(InputError, match="fly travels with the extension of middle"):
        load(*clamped)


def test_play_across_the_boom_that_no_load_takes_up_is_refused_before_anything_is_built() -> None:
    """It was after a minute, as contacts that hold nothing at the start."""
    faces = "faces={bottom=[-0.06,0.06],top=[-0.06,0.06],left=[0.0],right=[0.0]}"
    play = [f"section.joint.{end}=[{{at=0.15,{faces},clearance=0.005}}]" for end in ("tail", "mouth")]
    space = "section.body.model=beam3d"
    with pytest.raises(InputError, match=r"sections\[1\].joint.tail\[0\].clearance = 0.005: .* no load along y"):
        load(space, *play)
    load(space, *play, "sections.fly.loads.0.direction=y", "sections.fly.loads.0.signal=10.0")
    held = f"sections.fly.joint.tail=[{{at=0.15,{faces}}}]"
    with pytest.raises(InputError, match=r"sections\[2\].joint.mouth\[0\].clearance = 0.005"):
        load(
            space,
            play[1],
            held,
            f"sections.middle.joint.mouth=[{{at=0.15,{faces}}}]",
            f"section.joint.tail=[{{at=0.15,{faces}}}]",
        )
    load(*(one.replace(",left=[0.0],right=[0.0]", "") for one in play))  # in plane the weight takes it up
    with pytest.raises(InputError, match="no load along z"):
        load(
            *(one.replace(",left=[0.0],right=[0.0]", "") for one in play),
            "gravity.rise=0.5",
            "sections.fly.loads.0.signal=0",
        )


def test_the_weight_of_sections_is_there_from_the_start_with_or_without_a_table() -> None:
    without = load().model_dump(mode="json")
    del without["gravity"]
    for gravity in ({}, {"gravity": {}}, {"gravity": {"rise": 0.0}}):
        boom = Scene.model_validate(without | gravity)
        assert boom.gravity.rise == 0.0 and boom.hash == load().hash
    assert Scene.model_validate(without | {"gravity": {"rise": 0.5}}).gravity.rise == 0.5


def test_friction_needs_a_cylinder() -> None:
    assert load("section.joint.tail.0.friction=0.1").sections[1].joint.rings[0].friction == 0.1
    data = load("section.joint.tail.0.friction=0.1").model_dump(mode="json")
    for part in data["sections"]:
        part["body"] = {"profile": {"length": 6.0, "bending_stiffness": 2e7, "mass_per_length": 60.0}}
    with pytest.raises(
        InputError, match=r"sections\[1\].joint.tail\[0\].friction = 0.1: 0 is allowed, as middle has no"
    ):
        check_scene(Scene.model_validate(data))


def test_whoever_takes_one_body_says_so() -> None:
    with pytest.raises(InputError, match="sections: a scene of one body is allowed here; pmr run takes booms"):
        scenes.load(THREE)
    assert isinstance(scenes.load_any("boom_beam"), scenes.Scene)
