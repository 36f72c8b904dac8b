"""What a box says of its length: doublers and tapers, and what of them is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmr import scene as scenes
from pmr.errors import InputError
from pmr.scene.box import Box
from pmr.scene.choice import choose_model
from pmr.scene.members import member_at

WORKFLOWS = Path(__file__).parents[2] / "workflows"
DOUBLED = "body.box.doublers=[{start=0.0, end=1.0, thickness=0.005}]"
SECTION = "area=1.0, second_moment_y=1.0, second_moment_z=1.0, torsion_constant=1.0"
PLAIN = "length=6.0, width=0.3, height=0.4, wall=0.008"
OCTAGON = {"length": 6.0, "width": 0.3, "height": 0.4, "wall": {"bottom": 0.01, "sides": 0.006, "top": 0.008}}


def plate(start: float, end: float, thickness: float = 0.005, **more) -> dict:
    return {"start": start, "end": end, "thickness": thickness} | more


def test_walls_are_thicker_where_doublers_are() -> None:
    """Sums where they overlap; names of faces, whose corners go with bottom and top."""
    box = Box(**OCTAGON, chamfer=0.1, radius=0.02, doublers=[plate(0.0, 2.0), plate(1.0, 6.0, 0.003, faces=["bottom"])])
    found = [(one.start, one.end, one.first) for one in box.stretches]
    assert [(a, b) for a, b, _ in found] == [(0.0, 1.0), (1.0, 2.0), (2.0, 6.0)]
    for face, own in (("bottom", 0.01), ("bottom left", 0.01), ("left", 0.006), ("top right", 0.008)):
        below = 0.003 * (face == "bottom")
        expected = [own + 0.005, own + 0.005 + below, own + below]
        assert [profile.thickness(face) for *_, profile in found] == pytest.approx(expected, rel=1e-12)
    corners = [next(side for side in profile.sides if side.name == "bottom corners").thickness for *_, profile in found]
    assert corners == pytest.approx([0.015, 0.018, 0.013], rel=1e-12)


REFUSED = [
    ("doublers=[{start=0.5, end=0.5, thickness=0.005}]", "doublers[0].end", "from 0.506 m up to the length, 6 m"),
    ("doublers=[{start=0.0, end=6.1, thickness=0.005}]", "doublers[0].end", "up to the length, 6 m, is allowed"),
    ('doublers=[{start=0.0, end=1.0, thickness=0.005, faces=["top left"]}]', "doublers[0].faces", "bottom, left, top"),
    ("doublers=[{start=0.0, end=1.0, thickness=0.15}]", "doublers[0].thickness", "less than 0.15 m"),
    (
        "doublers=[{start=0.0, end=1.0, thickness=0.005}, {start=1.001, end=2.0, thickness=0.005}]",
        "doublers", "something ends at 1 and at 1.001 m",
    ),
    ("tip_taper={length=6.5, height=0.3}", "tip_taper.length", "up to the box's length, 6 m"),
    ("tail_taper={length=4.0, height=0.3}, tip_taper={length=3.0, width=0.2}", "tail_taper.length", "together"),
    ("tip_taper={length=1.0}", "tip_taper", "a dimension at the end is needed"),
    ("tip_taper={length=1.0, height=0.5}", "tip_taper.height", "up to the box's own 0.4 m"),
    ("tip_taper={length=1.0, chamfer=0.05}", "tip_taper.chamfer", "none may come or go"),
    ("tip_taper={length=1.0, width=0.01}", "tip_taper.wall", "at the end, less than 0.005 m"),
    ("tip_taper={length=1.0, wall={top=0.01}}", "tip_taper.wall", "and all of them needed: bottom, left, top, right"),
]  # fmt: skip


@pytest.mark.parametrize(("given", "key", "says"), REFUSED)
def test_what_is_refused_of_a_box_is_said_in_one_line(given: str, key: str, says: str) -> None:
    box = f"body.box={{length=6.0, width=0.3, height=0.4, wall=0.008, {given}}}"
    with pytest.raises(InputError) as refused:
        scenes.load(WORKFLOWS / "boom_beam.toml", [box])
    assert refused.value.key == f"body.box.{key}" and says in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("scene", "changes", "says"),
    [
        ("boom", ["body.model=beam2d", "mesh.grading=2.0"], "1 is allowed with body.box.doublers, which says"),
        ("boom_solid", [], "beam2d, beam3d and shell are allowed with body.box.doublers"),
        (
            "boom_beam",
            ["body.shear=false", f"body.section={{{SECTION}}}"],
            "none is allowed with body.box.doublers",
        ),
    ],
)  # fmt: skip
def test_models_that_do_not_know_doublers_are_refused(scene: str, changes: list[str], says: str) -> None:
    with pytest.raises(InputError, match=says):
        scenes.load(
            WORKFLOWS / f"{scene}.toml", ["body.box.doublers=[{start=0.0, end=1.0, thickness=0.005}]", *changes]
        )


def test_a_section_that_is_thicker_on_one_side_takes_a_beam_in_space() -> None:
    for faces, model in (("['left', 'top']", "beam3d"), ("['bottom']", "beam2d")):
        doubler = f"body.box.doublers=[{{start=0.0, end=1.0, thickness=0.005, faces={faces}}}]"
        chosen = choose_model(member_at(scenes.load(WORKFLOWS / "boom.toml", [doubler, "loads=[]", "masses=[]"])))
        assert chosen.model == model and ("the walls at left and right differ" in chosen.reasons) == (model == "beam3d")


TAPER = "body.box.tip_taper={length=@, height=0.3}"


def test_pads_run_where_a_section_does_not_taper() -> None:
    """Those at the mouth of the boom reach 4.15 m along it."""
    load_one = lambda length: scenes.load(WORKFLOWS / "boom_beam.toml", [TAPER.replace("@", length)])  # noqa: E731
    load_one("1.7")
    with pytest.raises(
        InputError, match="the face .* offers 0 to 4 m.*; where the box tapers, its faces are not"
    ) as no:
        load_one("2.0")
    assert "\n" not in str(no.value)
    thinner = scenes.load(WORKFLOWS / "boom_beam.toml", ["body.box.tip_taper={length=2.0, wall=0.006}"])
    assert thinner.body.box.parallel_range == (0.0, 6.0) and thinner.body.box.untapered_range == (0.0, 4.0)


def test_pads_of_joints_run_where_neither_section_tapers() -> None:
    """The inner one's tip may taper; the outer one's, where pads are at its mouth, may not."""
    boom = WORKFLOWS / "boom_octagonal.toml"
    scenes.load_any(boom, ["sections.fly.body.box.tip_taper={length=0.5, height=0.3}"])
    for taper, key in (
        ("base.body.box.tip_taper={length=0.5, height=0.3}", "sections[1].joint.mouth[0].at"),
        ("fly.body.box.tail_taper={length=0.5, height=0.3}", "sections[1].joint.tail[0].at"),
    ):
        with pytest.raises(InputError, match="pads are allowed there, not where the box tapers") as no:
            scenes.load_any(boom, [f"sections.{taper}"])
        assert no.value.key == key and "\n" not in str(no.value)


def test_a_tail_that_tapers_has_room_for_the_next_section() -> None:
    """The fly gets 0.8 m near the tail of the base, where this has lost 0.43 of what it loses at its tail."""
    boom, pads = WORKFLOWS / "boom_octagonal.toml", "section.joint.tail.0.at=0.8"
    taper = "sections.base.body.box.tail_taper={length=1.4, height=@}"
    scenes.load_any(boom, [pads, taper.replace("@", "0.44")])
    with pytest.raises(InputError, match="fly gets 0.8 m near the tail of base, which tapers over 1.4 m") as no:
        scenes.load_any(boom, [pads, taper.replace("@", "0.30")])
    assert "\n" not in str(no.value)


@pytest.mark.parametrize(
    ("frames", "says"),
    [
        ("frames=[3.0, 2.0], frame_depth=0.05", "ascending places within 0 and 6 m are allowed"),
        ("frames=[6.0], frame_depth=0.05", "ascending places within 0 and 6 m are allowed"),
        ("frames=[3.0]", "more than 0 and less than 0.15 m, or 'full', is allowed"),
        ("frames=[3.0], frame_depth=0.15", "more than 0 and less than 0.15 m, or 'full', is allowed"),
        ('frames=[3.0], frame_depth="half"', "frame_depth"),
    ],
)
def test_frames_of_a_beam_are_within_it(frames: str, says: str) -> None:
    with pytest.raises(InputError, match=says) as no:
        scenes.load(WORKFLOWS / "boom_beam.toml", [f"body.box={{{PLAIN}, {frames}}}"])
    assert "\n" not in str(no.value)


def test_a_section_does_not_slide_through_frames() -> None:
    """The fly gets 0.8 m near the tail of the base; the gap between them is 22 mm at its sides."""
    boom, frames = WORKFLOWS / "boom_octagonal.toml", "sections.base.body.box.frames=[{}]"
    depth = "sections.base.body.box.frame_depth={}"
    scenes.load_any(boom, [frames.format(0.5), depth.format('"full"')])
    scenes.load_any(boom, [frames.format(0.5, 2.0), depth.format(0.02)])
    scenes.load_any(boom, ["sections.fly.body.box.frames=[2.0]", 'sections.fly.body.box.frame_depth="full"'])
    for given in ('"full"', 0.05):
        with pytest.raises(InputError, match="places of less than 0.8 m are allowed.*: fly slides past 2 m") as no:
            scenes.load_any(boom, ["sections.base.body.box.frames=[0.5, 2.0]", depth.format(given)])
        assert "\n" not in str(no.value)
