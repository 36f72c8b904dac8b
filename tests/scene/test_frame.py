"""A frame that luffs and slews in a scene: what is refused, in one line."""

from typing import get_args

import numpy as np
import pytest

from pmr import InputError
from pmr import scene as scenes
from pmr.scene import Scene
from pmr.scene.choice import inertia_fields, model_of
from pmr.scene.frame import Frame
from pmr.scene.members import member_at, members
from pmr.scene.rotation import FrameRotation
from pmr.scene.signals import Signal

THREE = "boom_three"
LUFFING = "frame.luffing={kind='smooth_ramp', times=[1.0, 5.0], values=[0.2, 1.0]}"
SLEWING = "frame.slewing={kind='smooth_ramp', times=[1.0, 5.0], values=[0.0, 1.5]}"
PIVOT = "frame.pivot=[0.0, 0.0, 0.0]"


def load(*changes: str) -> Scene:
    found: Scene = scenes.load_any(THREE, changes)
    return found


def test_fields_that_vanish_are_left_out() -> None:
    luffing = load(PIVOT, LUFFING)
    assert [inertia_fields(one) for one in members(luffing)] == [("x", "z", "xx", "zx")] * 3
    assert inertia_fields(member_at(load())) == ()
    both = load(PIVOT, LUFFING, SLEWING, "section.body.model=auto", *SPREAD)
    assert {model_of(one) for one in members(both)} == {"beam3d"}
    assert set(inertia_fields(member_at(both))) == {*"xyz", *(j + k for j in "xyz" for k in "xyz")}
    thin = load(PIVOT, LUFFING, SLEWING, *SPREAD, "section.body.shear=false")  # without rotary inertia but of torsion
    assert set(inertia_fields(member_at(thin))) == {*"xyz", *("xx", "yx", "zx", "yz", "zy")}


SPREAD = (
    "sections.base.body.model=beam3d",
    "sections.middle.body.model=beam3d",
    "sections.fly.body.model=beam3d",
    "section.joint.tail.0.faces={bottom=[-0.05, 0.05], top=[-0.05, 0.05], left=[0.0], right=[0.0]}",
    "section.joint.mouth.0.faces={bottom=[-0.05, 0.05], top=[-0.05, 0.05], left=[0.0], right=[0.0]}",
)


def test_angles_are_in_radians_or_degrees() -> None:
    frame = load(PIVOT, LUFFING, "frame.unit=degrees").frame
    assert frame is not None
    luffing, slewing = frame.angles
    t = np.array([0.0, 3.0, 8.0])
    assert luffing.value(t) == pytest.approx(np.deg2rad([0.2, 0.6, 1.0]))
    assert luffing.rate(t)[1] == pytest.approx(np.deg2rad(0.8 / 4.0 * 1.875))
    assert not slewing.value(t).any()


def test_the_rotation_into_space_is_that_of_the_angular_velocity() -> None:
    t, h = np.linspace(1.5, 4.5, 7), 1e-4
    angle = {"kind": "smooth_ramp", "times": [1.0, 5.0], "values": [10.0, 60.0]}
    frame = Frame.model_validate({"pivot": [0, 0, 0], "luffing": angle, "slewing": angle, "unit": "degrees"})
    R = frame.rotation(t)
    turning = FrameRotation.from_signals(*frame.angles, t)
    assert np.einsum("tji,tjk->tik", R, R) == pytest.approx(np.tile(np.eye(3), (7, 1, 1)), abs=1e-14)
    assert R[:, 2] == pytest.approx(turning.up, abs=1e-14)  # what Z is in the boom's axes
    spin = np.einsum("tji,tjk->tik", R, (frame.rotation(t + h) - frame.rotation(t - h)) / (2.0 * h))
    found = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
    assert found == pytest.approx(turning.velocity, abs=1e-7)  # h^2 / 6 times third rates, which are below 10 1/s^3


KINDS = {
    "constant": "0.3",
    "sine": "{kind='sine', amplitude=0.2, frequency=0.1, phase=0.5}",
    "chirp": "{kind='chirp', amplitude=0.2, times=[0.0, 4.0], frequencies=[0.1, 0.3]}",
    "smooth_ramp": "{kind='smooth_ramp', times=[1.0, 5.0], values=[0.1, 0.9]}",
    "table": "{kind='table', times=[0.0, 1.0, 2.5, 4.0, 20.0], values=[0.1, 0.15, 0.3, 0.35, 0.4]}",
    "sum": "{kind='sum', terms=[{kind='sine', amplitude=0.1, frequency=0.2}, {kind='constant', amount=0.4}]}",
    "step": "{kind='step', time=2.0, after=1.0}",
    "ramp": "{kind='ramp', times=[1.0, 5.0], values=[0.0, 1.0]}",
}


def test_every_kind_of_signal_is_an_angle_with_two_rates_or_is_refused() -> None:
    signals = get_args(get_args(Signal)[0])
    assert set(KINDS) == {kind.model_fields["kind"].default for kind in signals}
    t, h = np.array([0.3, 1.7, 3.3, 4.4]), 1e-3
    for kind, angle in KINDS.items():
        given = PIVOT, f"frame.luffing={angle}"
        if kind in ("step", "ramp"):
            with pytest.raises(InputError, match=r"frame.luffing: an angle without jumps and kinks is allowed"):
                load(*given)
            continue
        luffing = load(*given).frame.angles[0]
        second = (luffing.rate(t + h) - luffing.rate(t - h)) / (2.0 * h)
        assert luffing.second_rate(t) == pytest.approx(second, abs=1e-5), kind


@pytest.mark.parametrize("moved", [0.0, 0.2])
@pytest.mark.parametrize("noise", [4e-11, 3e-16])
def test_a_computed_angle_that_rests_up_to_round_off_is_a_table_without_jumps(moved: float, noise: float) -> None:
    """Until a free angle moves, if it ever does, its values differ by round-off alone."""
    t = np.arange(0.0, 20.0, 0.02)
    x = np.clip((t - 1.0) / 3.0, 0.0, 1.0)
    angle = 0.5236 + noise * np.sin(70.0 * t) + moved * x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
    scene = load(PIVOT, f"frame.luffing={{kind='table', times={t.tolist()}, values={angle.tolist()}}}")
    assert scene.frame is not None
    assert scene.frame.angles[0].value(t) == pytest.approx(angle, rel=1e-14)


def test_a_table_that_ends_in_motion_within_the_run_is_refused_with_what_to_do() -> None:
    end = load().time.end
    table = "frame.luffing={{kind='table', times=[0.0, 1.0, 2.5, {}], values=[0.1, 0.15, 0.3, 0.35]}}"
    with pytest.raises(InputError, match=rf"a kink at {end:g} s: its table has to end at rest or after time\.end"):
        load(PIVOT, table.format(end))
    load(PIVOT, table.format(1.01 * end))
