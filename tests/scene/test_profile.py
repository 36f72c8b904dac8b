"""Profiles of plates: what closes, what fits into what, and where places on faces are."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from pmr import scene as scenes
from pmr.errors import InputError
from pmr.scene.choice import choose_model
from pmr.scene.members import members
from pmr.scene.profile import FACES, BoxProfile, gaps

BOOM = Path(__file__).parents[2] / "workflows" / "boom_octagonal.toml"
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
        ({"wall": 0.15}, "less than 0.15 m, half of width and height"),
        ({"wall": {"top": 0.01, "sides": 0.008}}, "all of them needed: bottom, left, top, right; sides are"),
        ({"wall": {"top": 0.01, "bottom": 0.01, "sides": 0.01, "top left": 0.01}}, "the faces of this profile"),
        ({"chamfer": 0.2}, "up to 0.15 m along y, half the width"),
        ({"chamfer": (0.1, 0.25)}, "bottom and top 0.4 m together"),
        ({"chamfer": (0.1, 0.0)}, "or up to 0.15 m along y"),
        ({"chamfer": 0.002}, "thinner walls are allowed: bottom left has no room inside"),
        ({"radius": 0.16}, "more than 0.004 m, half the wall, and at most 0.15 m"),
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
REFUSED = [
    (["sections.fly.body.box.chamfer=0.05"], "comes 0.009 m too close to the bottom right of base"),
    (["sections.base.body.box.chamfer=[0.1,0.12]"], "the bottom left of fly and that of base are not"),
    (["sections.base.body.box.chamfer=0.0"], "faces that base has are allowed: bottom, left, top, right"),
    (
        [PADS % ("'top left'=[0.0],bottom=[0.0]", "'top left'=0.03")],
        "at most 0.0248198 m is allowed: this is the width",
    ),
    ([PADS % ("'top left'=[0.0]", "bottom=0.01")], "a clearance of faces that have pads is allowed: bottom has none"),
    ([PADS % ("'top left'=[-0.1]", "")], "the flat face top left offers -0.0424264 to 0.113137 m"),
    (["section.body.model=beam2d"], "bottom, top, left and right are allowed for beam2d, or body.model = 'beam3d'"),
]


@pytest.mark.parametrize(("changes", "says"), REFUSED)
def test_what_does_not_fit_is_refused_in_one_line(changes: list[str], says: str) -> None:
    with pytest.raises(InputError) as refused:
        scenes.load_any(BOOM, changes)
    assert says in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("wall={roof=0.01}", "wall.roof = 'roof': 'sides', 'bottom', 'bottom left'"),
        ("radius={left=0.1}", "radius.left = 'left': 'bottom' or 'top' is allowed"),
        ("wall={top=-1}", "wall.top = -1: input should be greater than 0"),
    ],
)
def test_a_table_in_place_of_a_number_is_refused_by_its_own_keys(change: str, says: str) -> None:
    with pytest.raises(InputError) as refused:
        scenes.load_any("boom_beam", [f"body.box.{change}"])
    assert says in str(refused.value) and "\n" not in str(refused.value)


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
