"""Steppers and FMUs say that forces of outriggers, or what moves by itself, are not found."""

from functools import cache
from pathlib import Path
from typing import Literal

import free_boom
import pytest
from export.fmi.libraries import CallError, Instance, loaded
from simulation.native import test_stepper_luffing as freed
from simulation.test_pairs import PLAIN

import pmr
from pmr import SimulationError, System
from pmr.export.fmi import fmu_contents
from pmr.simulation.moving import read_scene

pytestmark = pytest.mark.slow  # a boom is reduced

#: Gravity in m/s^2 under which coordinates are finite, but no force on the ground is.
HEAVY = 1e306
OUTRIGGER = "force of outrigger a"


@cache
def on_outriggers() -> System:
    return pmr.reduce(free_boom.scene(*PLAIN)).system


def test_a_stepper_says_that_forces_on_the_ground_are_not_found() -> None:
    stepper = pmr.Stepper(on_outriggers(), 1e-3, {"fly": 0.6}, outputs=[OUTRIGGER])
    stepper.step({"fly": 0.6})
    with pytest.raises(SimulationError, match=r"the outputs of step 2, t = 0.002 s, fly at 0.6 m: not finite"):
        stepper.step({"fly": 0.6}, {"gravity": HEAVY})
    with pytest.raises(SimulationError, match=r"the outputs of step 2: .* a force on the ground, is no finite number"):
        stepper.outputs.sum()
    others = pmr.Stepper(on_outriggers(), 1e-3, {"fly": 0.6}, outputs=["fly: tip z"])
    others.step({"fly": 0.6}, {"gravity": HEAVY})  # whose own outputs are finite
    with pytest.raises(SimulationError, match=r"step 2, t = 0.002 s, fly at 0.6 m: not finite"):
        others.step({"fly": 0.6}, {"gravity": 1e308})


def test_a_stepper_says_that_a_free_luffing_angle_is_not_found() -> None:
    stepper = freed.stepped("length", outputs=["fly: tip z"])
    with pytest.raises(SimulationError, match=r"step \d+, t = \S+ s, .*(angle or extension is not found|come in line)"):
        for _ in range(2000):
            stepper.step({"fly": 0.6}, {"luffing drive length": (60.0, 0.0)})


@pytest.mark.parametrize("version", ["2", "3"])
def test_an_fmu_says_that_forces_on_the_ground_are_not_found(version: Literal["2", "3"], tmp_path: Path) -> None:
    contents = fmu_contents(on_outriggers(), read_scene(on_outriggers(), "system"), "boom", version)
    instance = Instance(loaded(contents, tmp_path, version))
    instance.initialise()
    instance.step(0.0, 1e-3)
    assert instance.get(["force_of_outrigger_a"])[0] > 0.0
    instance.set(["gravity"], [HEAVY])
    instance.step(1e-3, 1e-3)
    with pytest.raises(CallError, match="a force on the ground, is not finite"):
        instance.get(["force_of_outrigger_a"])
