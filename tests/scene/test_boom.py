"""Scenes of several sections: what they take over from what they share, and what is refused in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pmr import InputError
from pmr import scene as scenes
from pmr.scene import Scene
from pmr.scene.checks import check_scene
from pmr.scene.members import member_at, members

THREE = Path(__file__).parents[2] / "workflows" / "boom_three.toml"


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


REFUSED = [
    ("sections.fly.loads.0.name=gravity", r"sections\[2\].loads\[0\].name = 'gravity': another name is allowed"),
    ("sections.fly.loads.0.name=extension", r"sections\[2\].loads\[0\].name = 'extension': another name is allowed"),
    ("sections.fly.joint.mouth.0.clearance=0.5", r"mouth\[0\].clearance = 0\.5: at most 0\.0135 m is allowed"),
    ("section.joint.tail.0.clearance=0.0136", r"sections\[1\].*clearance = 0.0136: at most 0\.0125 m"),
    ("section.joint.tail.0.clearance=0.0124", ""),
    ("section.joint.friction_speed=0.1", "joint.friction_speed = 0.1: this key is no longer allowed: pads stick"),
    ("section.joint.tail.0.friction=50", r"friction = 50.0: a number from 0 to 1 is allowed"),
    ("section.joint.tail.0.static_friction=0.2", "static_friction = 0.2 is allowed beside a smaller friction"),
    ("sections.fly.supports=[{on='tip',kind='clamped'}]", r"supports\[0\].kind = 'clamped': directions"),
    ("sections.middle.supports=[{on='tip',directions=['x'],stiffness=1e5}]", "directions: directions without x"),
    ("sections.fly.supports=[{on='tip',kind='roller'}]", ""),
    ("sections.base.pads=[{name='p',moving=true,faces={bottom=[0.0]}}]", r"pads\[0\].moving = True: false"),
    ("sections.fly.joint.extension=6.2", r"sections\[2\].joint.extension: it pulls fly out of middle: .* 5\.7 m"),
    ("sections.fly.joint.extension=5.75", r"joint.extension: the overlap of fly and middle gets down to 0\.25 m"),
    ("sections.fly.joint.extension=5.41", r"tail\[0\] and mouth\[0\] overlap on the bottom at .* 5\.41 m.* 5\.4 m"),
    ("sections.fly.joint.extension=5.4", ""),
    ("sections.fly.joint.extension=-0.1", r"the tail of fly gets 0\.1 m behind that of middle"),
    ("sections.fly.body.box.length=0.9", r"at an extension of 0\.6 m fly ends before a pad at the mouth of middle"),
    ("sections.fly.joint.overlap=7.0", r"sections\[2\].joint.overlap: the tail of fly gets 1 m behind"),
    ("sections.fly.body.box.width=0.256", r"outside fly is 0\.262 m, inside middle there are 0\.253 m"),
    ("sections.fly.joint.tail.0.at=0.1", r"sections\[2\].joint.tail\[0\].at = 0\.1: these pads reach from -0\.05"),
    ("sections.fly.joint.follows=fly", r"joint.follows = 'fly': middle are allowed"),
    (
        "sections.fly.joint.follows=base",
        r"joint.follows = 'base': middle are allowed, which do not follow it: the base, base, does not extend",
    ),
    ("sections.fly.joint.extension={kind='step',time=1.0,before=1.0,after=2.0}", r"fly jumps from 1 m to 2 m at 1 s"),
    ("sections.fly.name=middle", r"sections = 'middle': names that differ are allowed"),
    ("sections.fly.observe.frequency_response=true", r"sections\[2\].observe.frequency_response = True: true is"),
    ("sections.base.observe.frequency_response=true", r"sections\[0\].observe.frequency_response = True: false"),
    ("sections.fly.reduction.basis=file", r"sections\[2\].reduction.basis = 'file': 'free_modes'"),
    ("sections.fly.reduction.basis=eigenmodes", r"sections\[2\].reduction.basis = 'eigenmodes': 'free_modes'"),
    ("sections.fly.body.model=beam3d", r"planar beams \(base, middle\) beside others"),
    ("sections.fly.loads.0.on=12.0", r"sections\[2\].loads\[0\].on = 12\.0: on the body, 0 to 6 m"),
    ("section.joint.tail.0.faces.bottom=[0.2]", r"sections\[1\].joint.tail\[0\].faces.bottom = 0\.2: the pad"),
    ("sections.fly.joint.tail=[{at=0.15}]", r"sections\[2\].joint.tail\[0\].faces: faces are needed: other pads on"),
    ("section.joint.tail.0.unilateral=false", ""),
    ("section.joint.tail=[{at=0.15,unilateral=false,clearance=0.01}]", r"a clearance goes with unilateral = true"),
    ("simulation.simulators=['exudyn-callback']", r"simulators = 'exudyn-callback': march or exudyn is .* only push"),
    ("compare.against=['ancf']", r"compare.against = \['ancf'\]: \['full'\] or \[\] is allowed"),
    ("time.step=1e-320", r"time.step = 1e-320: a number from 1e-12 to 1e\+09 is allowed"),
    ("sections.fly.joint.tail.0.length=1e9", r"sections\[2\].joint.tail\[0\].length = 1000000000.0: a number from"),
    ("time.step=3e-3", r"time.step = 0\.003: a whole number of steps"),
    ("recovery.every=1.5e-3", r"recovery.every = 0\.0015: a multiple of time.step"),
    ("sections.fly.bodi=1", r"unknown key; did you mean 'body'\?"),
    ("mesh.elements=3", r"unknown key; did you mean 'sections.mesh'\? allowed: title, gravity, .* and 10 more$"),
    ("simulaton.repeats=3", r"did you mean 'simulation'\? allowed: simulation, title, [a-z, ]{,60} and 10 more$"),
    ("sections.fly.joint.strnds=1", r"did you mean 'sections.joint.rope.strands'\? allowed: extension, overlap"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "said"), REFUSED)
def test_what_contradicts_itself_is_refused_with_key_and_numbers(change: str, said: str) -> None:
    if not said:
        load(change)
        return
    with pytest.raises(InputError, match=said) as caught:
        load(change)
    assert "\n" not in str(caught.value)


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
    with pytest.raises(InputError, match=r"sections\[2\].observe.frequency_response = True: .* without friction"):
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


def test_pads_in_space_need_faces() -> None:
    with pytest.raises(InputError, match=r"sections\[1\].joint.tail\[0\].faces: faces are needed: only on planar"):
        load("section.joint.tail=[{at=0.15}]", "section.joint.mouth=[{at=0.15}]", "section.body.model=beam3d")


def test_friction_needs_a_cylinder() -> None:
    assert load("section.joint.tail.0.friction=0.1").sections[1].joint.rings[0].friction == 0.1
    data = load("section.joint.tail.0.friction=0.1").model_dump(mode="json")
    for part in data["sections"]:
        part["body"] = {"profile": {"length": 6.0, "bending_stiffness": 2e7, "mass_per_length": 60.0}}
    with pytest.raises(InputError, match=r"sections\[1\].joint.tail\[0\].friction = 0.1: 0 is allowed: middle has no"):
        check_scene(Scene.model_validate(data))


def test_only_planar_beams_have_rigid_overlaps() -> None:
    assert load("section.joint.rigid_overlap=true").sections[2].joint.rigid_overlap
    with pytest.raises(InputError, match=r"sections\[1\].joint.rigid_overlap = True: false is allowed but for planar"):
        load("section.joint.rigid_overlap=true", "section.body.model=beam3d")


def test_whoever_takes_one_body_says_so() -> None:
    with pytest.raises(InputError, match="sections: a scene of one body is allowed here; pmr run takes booms"):
        scenes.load(THREE)
    assert isinstance(scenes.load_any(THREE.with_name("boom_beam.toml")), scenes.Scene)
