"""Whether the walls of a beam give way: what that takes, and what it changes."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmr import scene as scenes
from pmr.errors import InputError
from pmr.scene.choice import choose_model, has_giving_walls
from pmr.scene.members import footprint, member_at

WORKFLOWS = Path(__file__).parents[2] / "workflows"
#: Refused in one line: the scene, what is changed, what is said.
REFUSED = [
    ("paper_simple", ["body.walls=give"], "'rigid' is allowed without body.box"),
    ("boom_beam_walls", ["pads=[]", "body.model=beam2d"], "is allowed without pads that have faces"),
    (
        "boom_three",
        ["section.body.walls=give", "section.joint.tail=[{at=0.1}]", "section.joint.mouth=[{at=0.1}]"],
        "'rigid' is allowed without pads that have faces",
    ),
]


@pytest.mark.parametrize(("name", "changes", "says"), REFUSED, ids=[name for name, *_ in REFUSED])
def test_walls_that_can_not_give_way_are_refused_in_one_line(name: str, changes: list[str], says: str) -> None:
    with pytest.raises(InputError, match=says) as refused:
        scenes.load_any(WORKFLOWS / f"{name}.toml", changes)
    assert "\n" not in str(refused.value)


def test_walls_give_way_unless_stresses_take_a_shell() -> None:
    boom = WORKFLOWS / "boom.toml"
    chosen = member_at(scenes.load(boom, ["body.walls=give"]))
    assert choose_model(chosen).model == "beam3d" and has_giving_walls(chosen)
    stresses = member_at(scenes.load(boom, ["body.walls=give", "recovery.stress=true"]))
    assert choose_model(stresses).model == "shell" and not has_giving_walls(stresses)


def test_a_shell_takes_over_the_scene_of_a_beam_whose_walls_give_way() -> None:
    """As studies do, which compare the two."""
    scene = member_at(scenes.load(WORKFLOWS / "boom_beam_walls.toml", ["body.model=shell"]))
    assert choose_model(scene).model == "shell" and not has_giving_walls(scene)


def test_each_ring_of_a_joint_dents_a_wall_of_its_own() -> None:
    """Rings of one pattern share their rows where walls are rigid."""
    alike = scenes.load_any(WORKFLOWS / "boom_three.toml")
    own = scenes.load_any(WORKFLOWS / "boom_three.toml", ["section.body.walls=give"])
    for boom, count in ((alike, 1), (own, 4)):
        rings = [ring for number in (1, 2) for ring in boom.joint(number).rings]
        assert len({footprint(boom, ring) for ring in rings}) == count
        assert len(member_at(boom, 1).pads) == count
