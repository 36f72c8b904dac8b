"""Entries of lists are changed by their names, or by their numbers, from wherever a change comes."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmr import scene as scenes
from pmr.errors import InputError

BOOM = Path("workflows/boom_beam.toml").resolve()


def test_by_name_by_number_and_inside_a_signal() -> None:
    scene = scenes.load(
        BOOM, ["masses.payload.mass=500.0", "loads.1.direction=z", "loads.tip force.signal.amplitude=1.0"]
    )
    assert scene.masses[0].mass == 500.0 and scene.masses[0].on == "tip"
    assert scene.loads[1].direction == "z" and scene.loads[0].signal.amplitude == 1.0
    assert scene.loads[0].signal.frequencies == (0.5, 6.0)


def test_in_a_file_that_extends_another(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(
        f"extends = '{BOOM}'\n[loads.gust]\ndirection = 'z'\n[pads.mouth]\nwidth = 0.05\n"
    )
    scene = scenes.load(tmp_path / "mine.toml")
    assert [load.direction for load in scene.loads] == ["z", "z"] and len(scene.pads) == 2
    assert scene.pads[1].width == 0.05 and scene.pads[1].moving


@pytest.mark.parametrize(
    ("override", "allowed"),
    [
        (
            "pads.nose.at=9",
            r"pads.nose.at = 9: the entries of this list are .*, by name or number: tail \(0\), mouth \(1\)",
        ),
        ("masses.3.mass=1", r"masses.3.mass = 1: the entries of this list are .*: payload \(0\)$"),
        (
            "masses.mass=1",
            r"masses.mass = 1: this is a list; which .* before mass, as in masses.payload.mass: payload \(0\)",
        ),
        ("masses.payload=1", r"masses\[0\] = 1: a table of keys is allowed"),
        ("compare.against=full", "compare.against = 'full': a list is allowed"),
        ("gravity.direction=[0,0,-1]", ""),
        ("pads.mouth.faces.top.left=1", "pads.1.faces.top.left = 1: this list can't be changed in part"),
    ],
)
def test_what_is_not_there_is_answered_with_what_is(override: str, allowed: str) -> None:
    if not allowed:
        scenes.load(BOOM, [override])
        return
    with pytest.raises(InputError, match=allowed):
        scenes.load(BOOM, [override])


def test_two_of_one_name_are_told_apart_by_number_alone(tmp_path: Path) -> None:
    text = BOOM.with_name("boom.toml").read_text().replace('name = "gust"', 'name = "tip force"')
    (tmp_path / "two.toml").write_text(text)
    with pytest.raises(InputError, match="number"):
        scenes.load(tmp_path / "two.toml", ["loads.tip force.direction=y"])
