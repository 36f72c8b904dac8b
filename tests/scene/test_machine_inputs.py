"""Slips that users of hoists, oil, outriggers, loads and vehicles make: each has one line that says what is allowed."""

from __future__ import annotations

import pytest

import pmr
from pmr.errors import InputError
from pmr.scene.hints import hints


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("hoist", "hoist.winch.at=[-0.5,0.4]", "hoist.winch.at = [-0.5, 0.4]: a list of 3 is allowed"),
        ("luffing_oil", "frame.cylinder.oil.areas=[0.0154]", "oil.areas = [0.0154]: a list of 2 is allowed"),
        ("luffing_oil", "frame.luffing='fre'", "frame.luffing = 'fre': 'free', a number or a table of keys is allowed"),
        ("crane_outriggers", "frame.ground.slope=[1.0,2.0,0.0]", "slope = [1.0, 2.0, 0.0]: a list of 2 is allowed"),
        ("crane_outriggers", "frame.ground.height=-1.6", "frame.ground.height = -1.6: "),
        (
            "bridge",
            "sections.vehicle.joint.tail=[{at=0.0,faces={bottom=[0.0]}}]",
            "without faces, is needed: the wheel",
        ),
        ("bridge", "sections.vehicle.joint.mouth=[{at=0.0}]", "body.mover: a joint with one ring in `tail`"),
    ],
)
def test_a_slip_is_refused_in_words_of_its_key(name: str, change: str, said: str) -> None:
    with pytest.raises(InputError) as refused:
        pmr.load_scene(name, [change])
    assert said in str(refused.value)


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("hoist", "hoist.payload=0.4", "hoist.payload = 0.4 kg is unusual"),
        ("luffing_oil", "frame.cylinder.oil.supply=210.0", "oil.supply = 210 Pa is unusual"),
        ("luffing_oil", "frame.cylinder.oil.valve.gain=[8e-4,2e-4]", "valve.gain[0] = 0.0008"),
        ("crane", "sections.fly.loads=[{acts='temperature',signal=293.0}]", "signal = 293 K is unusual"),
        ("crane", "sections.fly.loads=[{acts='wind',signal=0.25}]", "signal = 0.25 Pa is unusual"),
    ],
)
def test_a_wrong_unit_has_a_hint(name: str, change: str, said: str) -> None:
    here = " ".join(hints(pmr.load_scene(name, [change])))
    assert said in here and said not in " ".join(hints(pmr.load_scene(name)))
