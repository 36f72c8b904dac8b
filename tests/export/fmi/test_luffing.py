"""FMUs of booms that luff: forces of the cylinder beside statics by hand, and a free angle beside a stepper."""

from pathlib import Path

import numpy as np
import pytest
from compare.test_luffing_cylinder import FOOT, LENGTH, LUG, MASS, G, raised
from export.fmi.libraries import CallError, Instance, Library, loaded
from oil_boom import STROKE, geometry
from simulation.native import test_stepper_luffing as freed
from turning_cylinder import Rigid, boom

import pmr
from pmr import SimulationError, System
from pmr.export.fmi import fmu_contents
from pmr.scene import Scene
from pmr.simulation.moving import read_scene


@pytest.mark.slow
def test_the_cylinder_carries_the_weight_at_each_angle(tmp_path: Path) -> None:
    """The arm is the height of the triangle of pivot, foot and lug over the cylinder; how it changes with the angle."""
    found = pmr.reduce(raised({"kind": "smooth_ramp", "times": [0.0, 2.0], "values": [0.3, 0.9]}))
    system = System.load(found.reduced.save(tmp_path / "reduced.npz"))
    library = loaded(fmu_contents(system, read_scene(system, "reduced.npz"), "boom", "3"), tmp_path, "3")
    output = "reaction_of_pivot_cylinder"

    def pressed(angle: float) -> float:
        instance = Instance(library)
        instance.choose_start(1)
        instance.initialise(["luffing"], [angle])
        return float(instance.get([output])[0])

    for angle in (-0.2, 0.3, 1.2):
        lug = np.hypot(*LUG) * np.array([np.cos(beta := angle + np.arctan2(LUG[1], LUG[0])), np.sin(beta)])
        arm = (FOOT[0] * lug[1] - FOOT[1] * lug[0]) / np.linalg.norm(lug - FOOT)
        assert pressed(angle) == pytest.approx(MASS * G * LENGTH * np.cos(angle) / arm, rel=1e-5)
    instance, h = Instance(library, model_exchange=False), 1e-5
    instance.initialise(["luffing"], [0.7])
    seen = [(instance.set(["luffing"], [0.7 + d]), instance.get([output])[0])[1] for d in (h, -h, 0.0)]
    assert instance.directional([output], "luffing")[0] == pytest.approx((seen[0] - seen[1]) / (2.0 * h), rel=1e-6)


@pytest.mark.slow
def test_a_cylinder_that_gives_way_turns_with_the_angle(tmp_path: Path) -> None:
    """Forces at rest as of a rigid boom, at angles that the scene does not have, and their change with the angle."""
    found = pmr.reduce(boom(20.0, "beam2d", 1e12))
    system = System.load(found.system.save(tmp_path / "system.npz"))
    library = loaded(fmu_contents(system, read_scene(system, "system.npz"), "boom", "3"), tmp_path, "3")
    force, pin = "force_of_s0_luffing_cylinder", [f"reaction_of_s0_pin_{axis}" for axis in "xz"]
    for degrees in (5.0, 65.0):
        instance, rigid = Instance(library), Rigid(np.deg2rad(degrees))
        instance.choose_start(1)
        instance.initialise(["luffing"], [np.deg2rad(degrees)])
        assert instance.get([force, *pin]) == pytest.approx([rigid.force, rigid.pin.real, rigid.pin.imag], rel=1e-5)
    instance, h = Instance(library, model_exchange=False), 1e-5
    instance.initialise(["luffing"], [0.7])
    seen = [(instance.set(["luffing"], [0.7 + d]), instance.get([force])[0])[1] for d in (h, -h, 0.0)]
    assert instance.directional([force], "luffing")[0] == pytest.approx((seen[0] - seen[1]) / (2.0 * h), rel=1e-5)


def free_boom(drive: str, folder: Path) -> tuple[Scene, System, Library]:
    """Boom that hoists, slews and luffs by itself, as it was saved, with its FMU."""
    scene, system = freed.boom(drive)
    system = System.load(system.save(folder / "system.npz"))
    contents = fmu_contents(system, read_scene(system, "system.npz", free=True), "boom", "3")
    return scene, system, loaded(contents, folder, "3")


@pytest.mark.slow
@pytest.mark.parametrize("drive", freed.DRIVES)
def test_a_free_luffing_angle_is_that_of_a_stepper(drive: str, tmp_path: Path) -> None:
    """Under the same motions at the ends of steps, also after a state that was saved; its start is a parameter."""
    scene, _, library = free_boom(drive, tmp_path)
    h, begun, turned = scene.time.step, 0.32, 0.01
    names = ["luffing angle", "hook height", "luffing cylinder force", "fly: tip z"]
    stepper, instance = freed.stepped(drive, outputs=names, frame={"luffing": (begun, turned)}), Instance(library)
    shown = ["luffing_angle", "hook_height", "luffing_cylinder_force", "fly_tip_z"]
    instance.set(["internal_step", "luffing_start", "luffing_start_rate"], [h, begun, turned])
    instance.initialise()
    assert instance.get(["luffing_angle", "luffing_start"]) == pytest.approx([begun, begun], rel=1e-14)
    for k in range(1, 81):
        _, loads, frame = freed.driven(scene, drive, k)
        expected = stepper.step({}, loads, frame)
        (at, rate, second), (drives, faster) = frame["slewing"], loads[f"luffing drive {drive}"]
        inputs = {
            "slewing": at - h * rate + h**2 / 2.0 * second, "slewing_rate": rate - h * second, "slewing_rate_2": second,
            f"luffing_drive_{drive}": drives - h * faster, f"luffing_drive_{drive}_rate": faster,
            "hoist_rope": loads["hoist rope"],
        }  # fmt: skip
        instance.set(list(inputs), list(inputs.values()))
        before = instance.serialised(instance.saved())
        instance.step((k - 1) * h, h)
        assert instance.get(shown) == pytest.approx(expected, rel=1e-11, abs=1e-13)
    after = instance.get(shown)
    assert instance.get(["luffing_start", "luffing_start_rate"]) == pytest.approx([begun, turned])
    other = Instance(library)
    other.restore(other.deserialised(before))
    other.step(79 * h, h)
    np.testing.assert_array_equal(other.get(shown), after)
    with pytest.raises(CallError, match="fixed once the start is made"):
        instance.set(["luffing_start"], [0.3])
    assert not {"luffing", "luffing_rate", "luffing_start_rate_2"} & set(library.references)


@pytest.mark.slow
def test_an_fmu_says_why_a_free_luffing_angle_is_not_found(tmp_path: Path) -> None:
    _, _, library = free_boom("length", tmp_path)
    instance = Instance(library)
    instance.initialise()
    instance.set(["luffing_drive_length"], [60.0])
    with pytest.raises(CallError, match="foot, lug and pivot|the luffing angle or extension is not found"):
        for k in range(2000):
            instance.step(k * 1e-3, 1e-3)
    with pytest.raises(CallError, match="derivatives with a hoist or a free motion are not known"):
        Instance(library).directional(["luffing_angle"], "slewing")
    hook = Instance(library)
    hook.initialise()
    hook.set(["hoist_rope"], [5.0])
    with pytest.raises(CallError, match="the hook is at its head sheaves"):
        for k in range(2000):
            hook.step(k * 1e-3, 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("angle", [-0.4, 0.9])
def test_a_luffing_angle_beyond_the_stroke_is_no_start(angle: float, tmp_path: Path) -> None:
    _, _, library = free_boom("opening", tmp_path)
    assert not STROKE[0] < geometry(angle)[0] < STROKE[1]
    with pytest.raises(CallError, match="luffing_start: the length of .* is needed within its stroke"):
        Instance(library).initialise(["luffing_start"], [angle])
    with pytest.raises(SimulationError, match="at the first luffing angle is needed within its stroke"):
        freed.stepped("opening", frame={"luffing": angle})
