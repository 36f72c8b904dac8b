"""What a box says of its length: doublers and tapers, and what of them is refused.
Profiles of plates: what closes, what fits into what, and where places on faces are.
"""

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from pmr import InputError
from pmr import scene as scenes
from pmr.scene.box import Box
from pmr.scene.choice import choose_model
from pmr.scene.members import member_at, members
from pmr.scene.profile import FACES, BoxProfile, gaps

WORKFLOWS = Path(__file__).parents[2] / "workflows"
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
        InputError, match="on the face .*, from 0 to 4 m; where the box tapers, its faces are not"
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
        with pytest.raises(
            InputError, match="pads are allowed where its faces are parallel.*, and not where the box tapers"
        ) as no:
            scenes.load_any(boom, [f"sections.{taper}"])
        assert no.value.key == key and "\n" not in str(no.value)


def test_a_tail_that_tapers_has_room_for_the_next_section() -> None:
    """The fly gets 0.8 m near the tail of the base, where this has lost 0.43 of what it loses at its tail."""
    boom, pads = WORKFLOWS / "boom_octagonal.toml", "section.joint.tail.0.at=0.8"
    taper = "sections.base.body.box.tail_taper={length=1.4, height=@}"
    scenes.load_any(boom, [pads, taper.replace("@", "0.44")])
    with pytest.raises(
        InputError, match="fly comes to 0.8 m from the tail of base, where the taper leaves 0.0133 m too"
    ) as no:
        scenes.load_any(boom, [pads, taper.replace("@", "0.30")])
    assert "\n" not in str(no.value)


def test_a_section_does_not_slide_through_frames() -> None:
    """The fly gets 0.8 m near the tail of the base; the gap between them is 22 mm at its sides."""
    boom, frames = WORKFLOWS / "boom_octagonal.toml", "sections.base.body.box.frames=[{}]"
    depth = "sections.base.body.box.frame_depth={}"
    scenes.load_any(boom, [frames.format(0.5), depth.format('"full"')])
    scenes.load_any(boom, [frames.format(0.5, 2.0), depth.format(0.02)])
    scenes.load_any(boom, ["sections.fly.body.box.frames=[2.0]", 'sections.fly.body.box.frame_depth="full"'])
    for given in ('"full"', 0.05):
        with pytest.raises(InputError, match="fly slides past the frame at 2 m; frames at less than 0.8 m, or") as no:
            scenes.load_any(boom, ["sections.base.body.box.frames=[0.5, 2.0]", depth.format(given)])
        assert "\n" not in str(no.value)


BOOM = "boom_octagonal"
BELLY = {"radius": {"bottom": 0.15, "top": 0.03}}


def profile(**given) -> BoxProfile:
    return BoxProfile(**({"width": 0.3, "height": 0.4, "wall": 0.008} | given))


@pytest.mark.parametrize(
    ("given", "faces"),
    [
        ({}, ("bottom", "left", "top", "right")),
        ({"chamfer": 0.1}, FACES),
        ({"chamfer": (0.15, 0.1)}, [face for face in FACES if face not in ("bottom", "top")]),
        ({"chamfer": (0.1, 0.2)}, [face for face in FACES if face not in ("left", "right")]),
        ({"chamfer": {"bottom": 0.1}}, ("bottom", "bottom left", "left", "top", "right", "bottom right")),
        (BELLY, ("left", "top", "right")),
    ],
)
def test_which_faces_a_profile_has(given, faces) -> None:
    found = profile(**given)
    assert tuple(found.faces) == tuple(faces)
    ends = [side.start for side in found.sides[1:]] + [found.sides[0].start]
    assert np.allclose([side.end for side in found.sides], ends)
    for side in found.faces.values():
        assert side.normal @ side.start > 0.0 and side.normal @ side.across_direction == pytest.approx(0.0, abs=1e-15)


def test_places_on_a_slanted_face_count_upwards_from_the_place_nearest_to_the_axis() -> None:
    for name, side in profile(chamfer=0.1).faces.items():
        assert side.across_direction @ [1.0, 1e-3 if name in ("bottom", "top") else 1e3] > 0.0
        ends = np.array([side.start, side.end])
        assert sorted(ends @ side.across_direction) == pytest.approx(side.span)
    low, high = profile(width=0.4, chamfer=0.1).faces["top left"].span
    assert low == pytest.approx(-high)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"wall": 0.15}, "less than 0.15 m, half of width and height of the mid-surface"),
        ({"wall": {"top": 0.01, "sides": 0.008}}, "all of them needed: bottom, left, top, right; sides are"),
        ({"wall": {"top": 0.01, "bottom": 0.01, "sides": 0.01, "top left": 0.01}}, "the faces of this profile"),
        ({"chamfer": 0.2}, "up to 0.15 m along y, half the width"),
        ({"chamfer": (0.1, 0.25)}, "bottom and top 0.4 m together"),
        ({"chamfer": (0.1, 0.0)}, "or up to 0.15 m along y"),
        ({"chamfer": 0.002}, "thinner walls are allowed: bottom left has no room inside"),
        (
            {"radius": 0.16},
            "more than 0.004 m, half the wall, and at most 0.15 m on the mid-surface, where it is 0.16 m",
        ),
        (
            {"radius": 0.2, "sizes": "outer"},
            "and at most 0.146 m on the mid-surface, where it is 0.196 m",
        ),
        ({"radius": {"bottom": 0.15, "top": 0.26}}, "more than 0.004 m, half the wall, and at most 0.14 m"),
        ({"radius": 0.13, "chamfer": 0.1}, r"and at most 0\.\d+ m"),
        ({"radius": 0.004}, "0 is allowed, or more than 0.004 m"),
    ],
)
def test_what_does_not_close_is_refused(given, says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        profile(**given)


def test_walls_by_name() -> None:
    walls = profile(
        chamfer=0.1, radius=0.02, wall={"bottom": 0.01, "sides": 0.006, "top": 0.008, "top left": 0.009}
    ).walls
    slanted = {"bottom left": 0.01, "bottom right": 0.01, "top left": 0.009, "top right": 0.008}
    corners = {"bottom corners": 0.01, "top corners": 0.008}
    assert walls == {"bottom": 0.01, "left": 0.006, "right": 0.006, "top": 0.008} | slanted | corners


def test_the_gap_between_two_profiles_by_face() -> None:
    inner = profile(width=0.26, height=0.36, chamfer=0.09, wall={"bottom": 0.01, "sides": 0.006, "top": 0.008})
    outer = profile(chamfer=0.1)
    found = gaps(inner.sides, outer.sides)
    beside = {"bottom": 0.02 - 0.009, "left": 0.02 - 0.007, "top": 0.02 - 0.008}
    assert found | beside == pytest.approx(found)
    # mid-surfaces of the chamfers are sqrt(2) (0.02 + 0.02 - (0.1 - 0.09)) / 2 apart
    assert found["top left"] == pytest.approx(0.03 / np.sqrt(2) - 0.008)
    belly = profile(**BELLY)
    for shrunk, narrowest in ((0.0, 0.02 - 0.008), (0.03, 0.02 - 0.008)):
        radius = {"bottom": 0.13 - shrunk, "top": 0.02}
        within = gaps(profile(width=0.26, height=0.36, radius=radius).sides, belly.sides)
        assert within["left"] == pytest.approx(narrowest)
        assert (within["corners"] == pytest.approx(narrowest, abs=1e-5)) is (shrunk == 0.0)
    assert gaps(profile(width=0.26, height=0.36).sides, belly.sides)["corners"] < 0.0


PADS = "section.joint.tail=[{at=0.15,width=0.06,faces={%s},clearance={%s}}]"


def test_pads_on_slanted_faces_take_a_beam_in_space() -> None:
    still = ["section.body.model=auto", "sections.fly.loads=[]"]
    for member in members(scenes.load_any(BOOM, still)):
        assert choose_model(member).model == "beam3d" and "pads are on slanted faces" in choose_model(member).reasons


def test_each_face_has_its_play() -> None:
    """Sections rest on slanted pads that have none, whatever the others have."""
    play = PADS % ("'bottom left'=[-0.035],'bottom right'=[-0.035],top=[0.0]", "top=0.001")
    boom = scenes.load_any(BOOM, [play, play.replace("tail", "mouth"), "start=equilibrium"])
    ring = boom.sections[1].joint.tail[0]
    assert [ring.clearance_on(face) for face in ("top", "bottom left")] == [0.001, 0.0]


WALLS = {"bottom": 0.010, "sides": 0.006, "top": 0.008}
SIZED = [
    {"width": 0.30, "height": 0.40, "wall": 0.008},
    {"width": 0.30, "height": 0.40, "wall": {**WALLS, "left": 0.009}},
    {"width": 0.36, "height": 0.46, "wall": WALLS, "chamfer": 0.11},
    {"width": 0.36, "height": 0.46, "wall": WALLS, "chamfer": {"bottom": [0.18, 0.10]}},
    {"width": 0.36, "height": 0.40, "wall": WALLS, "radius": {"bottom": 0.1, "top": 0.03}},
    {"width": 0.36, "height": 0.46, "wall": WALLS, "chamfer": [0.10, 0.12], "radius": 0.03},
]


def measured(middle: BoxProfile, sign: float) -> dict:
    """Sizes of the outer (1) or inner (-1) surface of a profile, by the offset of its corners from the mid-surface."""
    ends = np.array([edge.start + sign * (np.array(corner.position) - edge.start)
                     for edge, corner in zip(middle.edges, middle.corners, strict=True)])  # fmt: skip
    (y, z), (top_y, top_z) = ends.min(axis=0), ends.max(axis=0)
    right, low, high = (ends[np.isclose(ends[:, axis], at)] for axis, at in ((0, y), (1, z), (1, top_z)))
    cuts = {
        "bottom": [low[:, 0].min() - y, right[:, 1].min() - z],
        "top": [high[:, 0].min() - y, top_z - right[:, 1].max()],
    }
    radii = {half: r + sign * middle.thickness(half) / 2.0 for half in cuts if (r := middle.radius_at(half))}
    return {
        "width": top_y - y,
        "height": top_z - z,
        "chamfer": {h: c for h, c in cuts.items() if max(c) > 1e-9},
        "radius": radii,
    }


@pytest.mark.parametrize("given", SIZED)
@pytest.mark.parametrize(("sizes", "sign"), [("outer", 1.0), ("inner", -1.0), ("middle", 0.0)])
def test_a_profile_by_its_outer_or_inner_sizes_is_that_of_its_mid_surface(given: dict, sizes: str, sign: float) -> None:
    middle = Box(length=6.0, **given)
    other = Box(**{"length": 6.0, "wall": given["wall"], "sizes": sizes} | measured(middle, sign))
    for one, two in zip(middle.sides, other.sides, strict=True):
        assert (one.name, one.thickness) == (two.name, two.thickness)
        assert np.allclose([one.start, one.end], [two.start, two.end], rtol=0.0, atol=1e-15 * 40)
        assert one.radius == pytest.approx(two.radius, abs=1e-14)


def test_a_taper_of_outer_sizes_may_have_thinner_walls_of_the_same_outer_size() -> None:
    outer = Box(
        length=6.0, width=0.308, height=0.408, wall=0.008, sizes="outer", tip_taper={"length": 1.0, "wall": 0.006}
    )
    end = outer.profile_at(6.0)
    assert (end.width + 0.006, end.height + 0.006) == pytest.approx((0.308, 0.408), abs=1e-12)


def test_a_wall_of_the_least_thickness_keeps_it_along_a_taper() -> None:
    """(1 - share) t + share t is less than t for some shares, by round-off."""
    box = Box(length=6.0, width=3e-4, height=4e-4, wall=1e-6, tip_taper={"length": 1.0, "height": 3e-4})
    assert {box.profile_at(x).thickness("top") for x in np.linspace(5.0, 6.0, 1001)} == {1e-6}


def test_what_hangs_on_a_box_along_it_is_a_part_of_its_density() -> None:
    """4 kg/m on a box that has doublers and tapers: its mass grows by 24 kg; the same in both words is one scene."""
    change = "sections.base.body.attached_mass_per_length=4.0"
    doubled = "sections.base.body.box.doublers=[{start=1.0,end=2.0,thickness=0.006}]"
    plain, hung = (scenes.load_any(WORKFLOWS / "boom_two.toml", [doubled, *more]) for more in ((), (change,)))
    before, after = (of.sections[0].body for of in (plain, hung))
    added = (after.material.density - before.material.density) * before.box.volume
    assert added == pytest.approx(24.0, rel=1e-12) and after.box == before.box
    assert before.box.volume == pytest.approx(6.0 * 1.4 * 0.008 + 1.4 * 0.006, rel=1e-12)
    written = f"sections.base.body.material.density={after.material.density!r}"
    assert scenes.load_any(WORKFLOWS / "boom_two.toml", [doubled, written]).hash == hung.hash
    with pytest.raises(InputError, match="a body by its box alone"):
        scenes.load_any(WORKFLOWS / "paper_simple.toml", ["body.attached_mass_per_length=4.0"])


def test_a_play_to_compare_with_is_as_wide_as_the_narrower_gap_that_has_pads() -> None:
    """Pads are at bottom and top alone."""
    scenes.load_any("boom_three", ["compare.play=0.02", "sections.fly.body.box.width=0.235"])
    with pytest.raises(InputError, match=r"compare\.play = 0\.02: at most 0\.012 m is allowed"):
        scenes.load_any("boom_three", ["compare.play=0.02", "sections.fly.body.box.height=0.335"])
