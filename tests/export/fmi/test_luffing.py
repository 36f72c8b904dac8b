"""The force of the cylinder that raises a boom as an output of its FMU, beside statics by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from compare.test_luffing_cylinder import FOOT, LENGTH, LUG, MASS, G, raised
from export.fmi.libraries import Instance, loaded
from turning_cylinder import Rigid, boom

import pmr
from pmr.export.fmi.fmu import fmu_contents
from pmr.simulation.moving import read_scene
from pmr.system.system import System


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
