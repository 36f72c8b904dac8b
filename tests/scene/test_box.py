"""What a box says of its length: doublers, and what of them is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmr import scene as scenes
from pmr.errors import InputError
from pmr.scene.box import Box
from pmr.scene.choice import choose
from pmr.scene.members import member_at

WORKFLOWS = Path(__file__).parents[2] / "workflows"
DOUBLED = "body.box.doublers=[{start=0.0, end=1.0, thickness=0.005}]"
SECTION = "area=1.0, second_moment_y=1.0, second_moment_z=1.0, torsion_constant=1.0"
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
        ("boom", ["body.model=beam2d"], "beam3d and shell are allowed with body.box.doublers"),
        ("boom_solid", [], "beam3d and shell are allowed with body.box.doublers"),
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


def test_a_section_that_varies_takes_a_beam_in_space() -> None:
    chosen = choose(member_at(scenes.load(WORKFLOWS / "boom.toml", [DOUBLED, "loads=[]", "masses=[]"])))
    assert chosen.model == "beam3d" and "its section varies along it" in chosen.reasons
