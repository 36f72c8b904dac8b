"""What signals do between two steps: said where it matters, and nothing said where the steps follow."""

from __future__ import annotations

import numpy as np
import one_body
import pytest
from driving import driven
from oracle import flexible, full_body

from pmr.errors import InputError
from pmr.scene.signals import Chirp, Constant, Ramp, Signal, Sine, SmoothRamp, Step, Sum, Table
from pmr.simulation import TimeStepping
from pmr.simulation.excitation import clip_path
from pmr.simulation.stepping import STEPS_A_PERIOD, UNSEEN, describe_lost_features, describe_overshoots, is_aliased

STEPPING = TimeStepping(1.0, 1e-3)
SLOW = Ramp(times=(0.0, 1.0), values=(0.0, 100.0))

FOLLOWED = [
    Constant(amount=3.0),
    Sine(amplitude=1.0, frequency=100.0),
    Sine(amplitude=0.0, frequency=1e6),
    Chirp(amplitude=1.0, times=(0.0, 1.0), frequencies=(1.0, 140.0)),
    Chirp(amplitude=1.0, times=(1.5, 2.5), frequencies=(1.0, 1000.0)),  # fast only after the end
    Step(time=0.5005, after=1.0),  # seen at most a step late
    Step(time=0.3, after=1.0),
    Ramp(times=(0.1, 0.1015, 0.2), values=(0.0, 1.0, 1.0)),
    SmoothRamp(times=(0.1, 0.11, 0.12), values=(0.0, 1.0, 0.0)),
    Table(times=tuple(np.linspace(0.0, 1.0, 1001)), values=tuple(np.cos(np.arange(1001.0)))),
]
LOST = {
    "1000 Hz stands still at steps of 0.001 s; steps of 0.00014 s": Sine(amplitude=1.0, frequency=1000.0, phase=1.0),
    "999 Hz looks like 1 Hz": Sine(amplitude=1.0, frequency=999.0),
    "1300 Hz looks like 300 Hz": Chirp(amplitude=1.0, times=(0.0, 0.5), frequencies=(1.0, 1300.0)),
    "200 Hz has 5 steps": Sine(amplitude=1.0, frequency=200.0),
    "about t = 0.5005 s": Ramp(times=(0.5001, 0.5005, 0.5009), values=(0.0, 1.0, 0.0)),
    "about t = 0.4002 s": Sum(terms=(Step(time=0.4002, after=3.0), Step(time=0.4004, after=-3.0))),
    "passes between two": Table(times=tuple(np.linspace(0.0, 1.0, 4001)), values=tuple(np.sin(np.arange(4001.0)))),
}  # fmt: skip


@pytest.mark.parametrize("signal", FOLLOWED, ids=lambda signal: signal.kind)
def test_what_the_steps_follow_is_not_warned_of(signal: Signal) -> None:
    assert describe_lost_features([("F", signal)], STEPPING) == []


@pytest.mark.parametrize(("said", "signal"), LOST.items())
def test_what_is_lost_between_the_steps_is_said(said: str, signal: Signal) -> None:
    (line,) = describe_lost_features([("still", Constant(amount=1.0)), ("load F", signal)], STEPPING)
    assert line.startswith("load F: ") and said in line


def test_a_small_fast_part_of_a_large_slow_signal_is_seen() -> None:
    both = Sum(terms=(SLOW, Sine(amplitude=0.01, frequency=2000.0)))
    (line,) = describe_lost_features([("F", both)], STEPPING)
    assert "2000 Hz stands still" in line and is_aliased(both, STEPPING) and not is_aliased(SLOW, STEPPING)


@pytest.mark.parametrize("frequency", [499.0, 513.0, 870.0, 1300.0])
def test_the_step_that_is_said_to_follow_does(frequency: float) -> None:
    tone = Sine(amplitude=1.0, frequency=frequency)
    (line,) = describe_lost_features([("F", tone)], STEPPING)
    step = float(line.split("steps of ")[-1].split(" s or less")[0])
    assert describe_lost_features([("F", tone)], TimeStepping(1.0, 1.0 / np.ceil(1.0 / step))) == []


def test_the_fewest_steps_a_period_keep_to_the_share() -> None:
    assert (1.0 - np.cos(np.pi / STEPS_A_PERIOD)) / 2.0 < UNSEEN < (1.0 - np.cos(np.pi / (STEPS_A_PERIOD - 1))) / 2.0


@pytest.mark.parametrize("frequency", [1e5, 5e2, 1e9])
def test_a_path_that_leaves_the_beam_between_the_steps_is_refused(frequency: float) -> None:
    path = Sine(amplitude=10.0, frequency=frequency, offset=2.5)
    domain, inside = (0.0, 5.0), path.model_copy(update={"amplitude": 2.0})
    assert clip_path(inside, inside.value(STEPPING.times), domain, STEPPING.times) == pytest.approx(2.5, abs=1e-3)
    with pytest.raises(InputError, match="left between two steps"):
        clip_path(path, path.value(STEPPING.times), domain, STEPPING.times)
    model = flexible(full_body(10), 4)
    with pytest.raises(InputError, match="left between two steps"):
        one_body.simulate(model, driven(path, Constant(amount=1.0), STEPPING))


#: Flat, then two rows on either side of a top that no row holds.
TURNING = Table(times=(0.0, 0.2, 0.4, 0.6, 0.8, 1.0), values=(0.0, 0.3, 1.0, 1.0, 0.3, 0.0))


def test_a_table_whose_curve_leaves_its_values_is_told_with_the_amount() -> None:
    high = float(TURNING.value(np.linspace(0.0, 1.0, 10_001)).max())
    assert high - 1.0 > UNSEEN
    for signal in (TURNING, Sum(terms=(Constant(amount=3.0), TURNING))):
        (line,) = describe_overshoots([("load F", signal)], STEPPING)
        assert line.startswith(f"load F: the curve through its table (akima) goes from 0 to {high:.4g}")
        assert f" {100.0 * (high - 1.0):.2g} % of the table's range" in line
    straight = TURNING.model_copy(update={"interpolation": "linear"})
    assert describe_overshoots([("load F", straight), ("load G", Constant(amount=1.0))], STEPPING) == []
    assert describe_overshoots([("load F", TURNING)], TimeStepping(0.4, 1e-3)) == []  # nothing of that is reached


def test_a_table_with_rows_where_it_turns_keeps_to_them() -> None:
    t = np.linspace(0.0, 1.0, 51)
    fine = Table(times=tuple(t), values=tuple(np.sin(2.0 * np.pi * t)))
    assert describe_overshoots([("load F", fine)], STEPPING) == []
