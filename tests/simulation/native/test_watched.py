"""Steppers and FMUs warn once of displacements too large for the theory, and of a machine that tips."""

import logging
from functools import cache
from pathlib import Path
from typing import Literal

import free_boom
import pytest
from export.fmi.libraries import Instance, loaded
from simulation.test_pairs import PLAIN

import pmr
from pmr import System
from pmr.export.fmi import fmu_contents
from pmr.simulation.moving import read_scene

pytestmark = pytest.mark.slow  # a boom is reduced

#: Forces in N at the tip, upwards: one that lifts the boom and so tips the machine, and what bends the boom further.
LIFTS, BENDS = -4e4, -2e6
LOAD = "fly.hook z"


@cache
def boom() -> System:
    return pmr.reduce(free_boom.scene(*PLAIN)).system


def tell(force: float, caplog: pytest.LogCaptureFixture) -> list[str]:
    """Warnings of a stepper in 300 steps under a force at the tip."""
    caplog.clear()
    stepper = pmr.Stepper(boom(), 1e-3, {"fly": 0.6}, outputs=["fly: tip z"])
    with caplog.at_level(logging.WARNING):
        for _ in range(300):
            stepper.step({"fly": 0.6}, {LOAD: force})
    return [record.getMessage() for record in caplog.records]


def test_a_stepper_warns_once_that_the_machine_tips_and_of_large_displacements(
    caplog: pytest.LogCaptureFixture,
) -> None:
    assert tell(0.0, caplog) == []
    (tips,) = tell(LIFTS, caplog)
    assert "the tipping margin over" in tips and "is below 0: the machine tips" in tips
    both = tell(BENDS, caplog)
    assert len(both) == 2
    assert any("is more than 0.1 times the greatest length of the boom, 3.6 m" in line for line in both)


@pytest.mark.parametrize("version", ["2", "3"])
def test_an_fmu_warns_once_alike(version: Literal["2", "3"], tmp_path: Path) -> None:
    contents = fmu_contents(boom(), read_scene(boom(), "system"), "boom", version)
    library = loaded(contents, tmp_path, version)
    for force, count in ((0.0, 0), (LIFTS, 1), (BENDS, 2)):
        instance = Instance(library)
        instance.initialise()
        instance.set(["fly_hook_z"], [force])
        for k in range(300):
            instance.step(k * 1e-3, 1e-3)
        warnings = [line for line in instance.said if "machine tips" in line or "small motions" in line]
        assert len(warnings) == count
