"""A stepper whose luffing angle is free, beside the run: same kernel, driven by an opening, a rope and slewing."""

from functools import cache
from typing import Any

import free_boom
import numpy as np
import pytest
from oil_boom import FOOT, LUG, RIGID, UP_AND_DOWN, oil

import pmr
from pmr import InputError, System
from pmr.export.fmi.description import reference
from pmr.export.fmi.variables import Drivers, variables
from pmr.kernel.state import StepError
from pmr.scene import Scene
from pmr.simulation.free_base import with_all_inertia
from pmr.simulation.moving import path_ranges, read_scene
from pmr.simulation.native.free_motion import LuffingRun
from pmr.simulation.native.machine import CYLINDER_COLUMNS

pytestmark = pytest.mark.slow  # a boom is reduced

HOIST = "hoist={payload=60.0, EA=2e6, falls=2, hanging=1.5, winch={at=[-0.4, 0.1, 0.5]}}"
RAMP = "{kind='smooth_ramp', times=[0.05, 0.2], values="
KEYS = (
    *RIGID[3:], "frame.second_order=false", "start='equilibrium'", "time.rho_inf=0.9", "time.end=0.2", "time.step=1e-3",
    f"frame.slewing={RAMP}[0.0, 0.1]}}", f"hoist.speed={RAMP}[0.0, 0.3]}}",
)  # fmt: skip
DRIVES = {
    "opening": oil(UP_AND_DOWN, "", True),
    "length": f"frame.cylinder={{foot={FOOT.tolist()}, lug={LUG.tolist()}, length={RAMP}[1.0, 1.03]}}, spring=1e7, "
    "damping=1e4}",
}


@cache
def boom(drive: str) -> tuple[Scene, System]:
    keys = (*KEYS[:-1], HOIST, KEYS[-1], DRIVES[drive])
    return free_boom.scene(*keys), with_all_inertia(pmr.reduce(free_boom.scene(*keys)).system)


def stepped(drive: str, **options: Any) -> pmr.Stepper:
    scene, system = boom(drive)
    return pmr.Stepper(system, step=scene.time.step, s={"fly": 0.6}, rho_inf=0.9, **options)


def driven(scene: Scene, drive: str, k: int) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Paths, loads and motions of the frame at the end of step k."""
    t, frame = np.array(k * scene.time.step), scene.frame
    assert frame is not None and frame.cylinder is not None and scene.hoist is not None
    slewing = tuple(float(getattr(frame.slewing, of)(t)) for of in ("value", "rate", "second_rate"))
    signal = frame.cylinder.drive_signals[drive]
    loads = {
        "hoist rope": float(scene.hoist.rope_signal.value(t)),
        f"luffing drive {drive}": (float(signal.value(t)), float(signal.rate(t))),
    }
    return {"fly": (0.6, 0.0, 0.0)}, loads, {"slewing": slewing}


@pytest.mark.parametrize("drive", DRIVES)
def test_angle_and_cylinder_are_those_of_the_run(drive: str) -> None:
    scene, system = boom(drive)
    run = LuffingRun(scene, system)
    angle = run.with_luffing().frame.luffing.samples.values
    columns = dict(zip(CYLINDER_COLUMNS, run.simulation.cylinder.T, strict=True))
    # each step finds the rate to MACHINE_NEAR of the fastest so far, which is at least that of a fall within a step
    near = 2.0 * 1e-9 * max(np.abs(angle[1]).max(), scene.time.step * 9.80665)
    stepper = stepped(drive, outputs=["luffing angle", "rate of luffing angle", "hook height"])
    for k in range(1, scene.time.steps + 1):
        y = stepper.step(*driven(scene, drive, k))
        assert y[0] == pytest.approx(angle[0, k], abs=1e-12)
        assert y[1] == pytest.approx(angle[1, k], abs=near)
    for name, value in stepper.luffing.items():
        if name.startswith("luffing cylinder "):
            expected = columns[name.removeprefix("luffing cylinder ")]
            assert value == pytest.approx(expected[-1], abs=1e-10 * np.abs(expected).max())
    assert np.ptp(angle[0]) > 1e-3


def test_coordinates_are_those_of_the_run_and_the_hook_is_where_march_has_it() -> None:
    scene, system = boom("opening")
    run, stepper = LuffingRun(scene, system), stepped("opening", outputs=["hook height"])
    run.run()
    for k in range(1, scene.time.steps + 1):
        y = stepper.step(*driven(scene, "opening", k))
    expected = run.form.initial_states(run.simulation.state.z, run.simulation.state.v)
    for name, state in stepper.states.items():
        assert state.q == pytest.approx(expected[name].q, abs=1e-10 * np.abs(expected[name].q).max())
    assert y == pytest.approx(pmr.simulate(scene, system).other("hook height")[-1], rel=1e-6)


def test_the_angle_is_given_at_the_start_alone() -> None:
    begun = stepped("opening", frame={"luffing": 0.35})
    assert begun.luffing["luffing angle"] == pytest.approx(0.35, rel=1e-12)
    with pytest.raises(InputError, match="after the start"):
        begun.step({}, None, {"luffing": 0.4})
    with pytest.raises(InputError, match=r"luffing drive force.*luffing drive opening"):
        begun.step({}, {"luffing drive force": 1.0})


def test_a_free_angle_is_not_compared_with_its_rate_at_the_start(caplog: pytest.LogCaptureFixture) -> None:
    stepper = stepped("opening", frame={"luffing": (0.3, 1.0)})
    for _ in range(100):
        stepper.step({})
    assert not [line for line in caplog.messages if "rates lead" in line]


def test_the_rate_at_the_start_is_that_of_the_scene() -> None:
    scene = free_boom.scene(*KEYS[:-1], "frame.luffing_rate=0.02", DRIVES["opening"])
    system = with_all_inertia(pmr.reduce(scene).system)
    stepper = pmr.Stepper(system, step=scene.time.step, s={"fly": 0.6}, rho_inf=0.9)
    assert stepper.luffing["rate of luffing angle"] == pytest.approx(0.02, rel=1e-12)
    drivers = Drivers.of(system)
    carried = reference(drivers, read_scene(system, "system", free=True))
    start = {v.name: v.start for v in variables(drivers, carried.start_values, carried.nominal)}
    assert start["luffing_start_rate"] == pytest.approx(0.02, rel=1e-12)


def test_paths_beside_a_free_angle_range_as_far_as_the_scene_moves_them() -> None:
    out = f"sections.fly.joint.extension={RAMP}[0.6, 0.7]}}"
    system = pmr.reduce(free_boom.scene(*KEYS[:-1], DRIVES["opening"], out)).system
    assert path_ranges(system)["fly"] == pytest.approx((0.6, 0.7)) and system.ranges["fly"][1] > 0.8


def test_a_saved_state_goes_on_alike_in_another_stepper() -> None:
    """Angle, rate and pressures are parts of the state, bit for bit."""
    scene, _ = boom("opening")
    first, other = (stepped("opening", outputs=["luffing angle", "hook height"]) for _ in range(2))
    for k in range(1, 41):
        first.step(*driven(scene, "opening", k))
    other._state.restore(first._state.save())
    for k in range(41, 61):
        steps = [stepper.step(*driven(scene, "opening", k)) for stepper in (first, other)]
        np.testing.assert_array_equal(*steps)
    assert first.luffing == other.luffing


def test_a_valve_opens_no_further_than_fully() -> None:
    """An opening beyond 1 or -1 is a fully open valve."""
    for full in (1.0, -1.0):
        ends = []
        for opening in (0.5 * full, full, 3.0 * full):
            stepper = stepped("opening", outputs=["luffing angle"])
            for _ in range(50):
                y = stepper.step({}, {"luffing drive opening": opening})
            ends.append(float(y[0]))
        assert ends[2] == ends[1] != ends[0]


def test_a_step_of_the_boom_alone_is_refused() -> None:
    """The angle is moved by steps in the frame alone: without them it would stand still in silence."""
    stepper = stepped("opening")
    with pytest.raises(StepError, match="step 1"):
        stepper._state.step(stepper._state.drivers)
