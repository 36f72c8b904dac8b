"""One step at a time in a frame that is raised and slewed from outside, with second order: what a run finds."""

from typing import Any

import numpy as np
import plain_machines
import pytest
from shaken_crane import CHANGES, RHO, STEP, shaken_crane

import pmr
from pmr import InputError, Stepper, System
from pmr.simulation import Excitation, TimeStepping
from pmr.simulation.moving import MovingFrame
from pmr.simulation.native import systems


@pytest.fixture(scope="module")
def system() -> System:
    return shaken_crane()[0]


@pytest.fixture(scope="module")
def frame() -> MovingFrame:
    return shaken_crane()[1]


def given(frame: MovingFrame, excitation: Excitation, t: float) -> dict[str, Any]:
    """Arguments of a step."""
    motions = dict(zip(frame.drivers, frame.motions(excitation, t).T, strict=True))
    return {
        "s": {name: motions[name] for name in frame.paths},
        "F": {name: motions[name][0] for name in frame.loads},
        "frame": {name: motions[name] for name in (*frame.angles, *frame.axes)},
    }


@pytest.mark.slow
def test_steps_are_those_of_a_run(system: System, frame: MovingFrame) -> None:
    """Where gravity and inertia turn, and terms couple bodies: displacements and forces to round-off."""
    excitation = Excitation.from_scene(frame.scene).with_stepping(
        TimeStepping(frame.scene.time.end, STEP, RHO, parts=1)
    )
    expected = systems.simulate(system, excitation, systems.static_start(system, excitation))
    moved, force = np.hstack(list(systems.displacements(system, expected).values())), np.abs(expected.forces).max()
    stepper = Stepper(system, STEP, **given(frame, excitation, 0.0), rho_inf=RHO)
    for k, t in enumerate(excitation.times):
        if k:
            stepper.step(**given(frame, excitation, float(t)))
        size = np.abs(moved).max()
        np.testing.assert_allclose(stepper.outputs[: moved.shape[1]], moved[k], rtol=0.0, atol=1e-9 * size)
        np.testing.assert_allclose(list(stepper.forces.values()), expected.forces[k], rtol=0.0, atol=1e-7 * force)
    assert np.ptp(moved, axis=0).max() > 1e-3


@pytest.mark.slow
def test_what_is_left_out_stays(system: System) -> None:
    """In equilibrium at an angle: no rates, no motion."""
    at = {"middle": 1.0, "fly": 1.2}
    still = {"luffing": 0.5, "slewing": 0.0, "base.rx": 0.0, "base.x": 0.0}
    stepper = Stepper(system, STEP, at, frame=still | {"base.ry": 0.0, "base.rz": 0.0, "base.y": 0.0, "base.z": 0.0})
    start = stepper.outputs
    for _ in range(5):
        stepper.step({})
    np.testing.assert_allclose(stepper.outputs, start, rtol=0.0, atol=1e-8 * np.abs(start).max())
    raised = Stepper(system, STEP, at, frame=still | {"luffing": 1.2})
    assert np.abs(raised.outputs - start).max() > 1e-2 * np.abs(start).max()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"frame": {"lufing": 0.3}}, "frame = 'lufing': did you mean 'luffing'"),
        ({"frame": {"luffing": (0.3, 0.1, 0.0, 0.0)}},
         r"frame.luffing = \[0.3, 0.1, 0.0, 0.0\]: a value, or that with"),
        ({"frame": {"luffing": float("nan")}}, "frame.luffing = nan: finite numbers are allowed"),
        ({"frame": {"luffing": (0.3, float("inf"))}}, r"frame.luffing = .*inf.*: finite numbers are allowed"),
        ({"frame": {"luffing": 45.0}}, "frame.luffing = 45.0: at most one turn is allowed, 2 pi: it is in rad"),
        ({"frame": {"base.rx": -7.0}}, "frame.base.rx = -7.0: at most one turn is allowed"),
        ({"s": {"middle": 1.0, "fly": (99.0, 0.0)}}, "s.fly = 99.0: .* m is allowed"),
        ({"F": {"fly.inertia x": 1.0}}, "F = 'fly.inertia x': .*gravity are allowed"),
    ],
)  # fmt: skip
def test_bad_motions_are_refused(system: System, change: dict[str, Any], says: str) -> None:
    arguments: dict[str, Any] = {"s": {"middle": 1.0, "fly": 1.2}} | change
    with pytest.raises(InputError, match=says):
        Stepper(system, STEP, **arguments)


@pytest.mark.slow
def test_an_array_of_all_motions_is_taken_as_they_are_by_their_names(system: System, frame: MovingFrame) -> None:
    excitation = Excitation.from_scene(pmr.load_scene(plain_machines.CRANE, [*CHANGES]))
    by_names, by_array = (Stepper(system, STEP, **given(frame, excitation, 0.0)) for _ in range(2))
    assert by_array.motion_names == frame.drivers
    for k in range(1, 20):
        array = frame.motions(excitation, k * STEP)
        assert np.array_equal(by_names.step(**given(frame, excitation, k * STEP)), by_array.step(array))
    for number, value, message in (("fly", 99.0, "s.fly = 99.0: "), ("slewing", np.nan, "frame.slewing = "),
                                   ("luffing", 7.0, "frame.luffing = 7.0: at most one turn")):  # fmt: skip
        beyond = array.copy()
        beyond[0, frame.drivers.index(number)] = value
        with pytest.raises(InputError, match=message):
            by_array.step(beyond)
    for arguments in ((array[:2],), (array, 0.0)):
        with pytest.raises(InputError, match="stepper: s = .*allowed"):
            by_array.step(*arguments)
    assert np.array_equal(by_names.step(**given(frame, excitation, 20 * STEP)),
                          by_array.step(frame.motions(excitation, 20 * STEP)))  # fmt: skip


def test_a_motion_without_second_rates_is_told_once(system: System, frame: MovingFrame, caplog: Any) -> None:
    """As the run has it nothing is said; and a boom that slews goes on beyond a turn."""
    excitation = Excitation.from_scene(pmr.load_scene(plain_machines.CRANE, [*CHANGES]))
    for left_out in (False, True):
        stepper = Stepper(system, STEP, **given(frame, excitation, 0.0))
        for k in range(1, 20):
            one = given(frame, excitation, k * STEP)
            if left_out:
                one["s"] = {name: motion[0] for name, motion in one["s"].items()}
            stepper.step(**one)
        said = [line for line in caplog.messages if not line.startswith("step ")]  # but of pads that pull
        if not left_out:
            assert not said
            caplog.clear()
            stepper.step(one["s"], frame={"slewing": 13.0})
            assert [line.split()[0] for line in caplog.messages if not line.startswith("step ")] == ["slewing"]
            caplog.clear()
    end, without = (
        19 * STEP,
        "moves without a second rate, so the inertia of what moves is left out: both rates are needed",
    )
    moving = [name for name in frame.paths if excitation.paths[name].value(end) != excitation.paths[name].value(0.0)]
    assert moving and sorted(said) == sorted(f"{name} {without}" for name in moving)


@pytest.mark.parametrize("by_array", [False, True])
def test_rates_in_degrees_beside_angles_in_rad_are_told_once(
    system: System, frame: MovingFrame, caplog: Any, by_array: bool
) -> None:
    """Inertia forces would be those of such rates."""
    excitation = Excitation.from_scene(pmr.load_scene(plain_machines.CRANE, [*CHANGES]))
    stepper = Stepper(system, STEP, **given(frame, excitation, 0.0))
    for k in range(1, 60):
        motions = frame.motions(excitation, k * STEP)
        motions[1:, frame.drivers.index("luffing")] *= np.rad2deg(1.0)
        of = dict(zip(frame.drivers, motions.T, strict=True))
        by_name = {"s": {name: of[name] for name in frame.paths}, "F": {name: of[name][0] for name in frame.loads}}
        stepper.step(motions) if by_array else stepper.step(**by_name, frame={name: of[name] for name in frame.angles})
    (told,) = (line for line in caplog.messages if "where its rates lead by" in line)
    assert told.startswith("luffing moves by 0.00") and told.endswith("its rates are needed, in rad/s")
