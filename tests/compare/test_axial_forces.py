"""Axial forces that second order leaves out: a warning beside Euler's column, and beside second order in a frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import pmr
from pmr.compare.second_order import axial_part, second_order_effect
from pmr.results.run import SummaryPart
from pmr.scene import Scene
from pmr.simulation import Excitation

LENGTH, SIDE, WALL = 6.0, 0.06, 0.003
COLUMN = f"""
title = "Column"
body = {{ model = "beam3d", box = {{ length = {LENGTH}, width = {SIDE}, height = {SIDE}, wall = {WALL} }} }}
mesh.elements = 12
supports = [{{ on = "tail", kind = "clamped" }}]
time = {{ end = 0.1, step = 1e-2 }}
reduction.estimate = false
"""
SECOND_MOMENT = ((SIDE + WALL) ** 4 - (SIDE - WALL) ** 4) / 12.0
EULER = np.pi**2 * 210e9 * SECOND_MOMENT / (2.0 * LENGTH) ** 2  # N, clamped at one end
ON_TIP = 'loads = [{{ on = {on}, direction = "x", signal = {force} }}]\n'
RAISED = """
loads = [{ on = "tip", direction = "z", signal = 1.0 }]
masses = [{ name = "top", on = "tip", mass = 300.0 }]
"""


def scene_of(folder: Path, *parts: str) -> Scene:
    (folder / "column.toml").write_text(COLUMN + "".join(parts))
    return pmr.load_scene(folder / "column.toml")


def part_of(scene: Scene, mass: float = 0.0) -> SummaryPart:
    system = pmr.reduce(scene).system
    return axial_part(scene, system, Excitation.from_scene(scene), {"": mass})


@pytest.mark.parametrize(("on", "length"), [("'tip'", LENGTH), (0.5 * LENGTH, 0.5 * LENGTH)])
@pytest.mark.parametrize("share", [-0.5, 0.5, 1e-4])
def test_the_share_is_that_of_the_buckling_load(on: str | float, length: float, share: float, tmp_path: Path) -> None:
    """Of the part between support and load, which alone is pressed; tension is no less than pressure."""
    load = ON_TIP.format(on=on, force=share * EULER * (LENGTH / length) ** 2)
    part = part_of(scene_of(tmp_path, load))
    assert not part.grave
    assert len(part.warnings) == (abs(share) > 2e-3)
    for warning in part.warnings:
        percent = float(warning.split("by some ")[1].split(" %")[0])
        assert percent == pytest.approx(100.0 * abs(share), abs=1.5)


def test_beyond_the_buckling_load_the_warning_is_grave(tmp_path: Path) -> None:
    part = part_of(scene_of(tmp_path, ON_TIP.format(on="'tip'", force=-4.0 * EULER)))
    assert not part.warnings and "at 0 s 0.25 of them bends the body without limit" in part.grave[0]


def test_weight_of_a_raised_boom_counts_as_in_a_frame(tmp_path: Path) -> None:
    """Its own and that of what is on its tip, beside the geometric stiffness of the frame's second order."""
    raised = scene_of(tmp_path, RAISED, "gravity.inclination = 90.0\n")
    mass = 7850.0 * LENGTH * ((SIDE + WALL) ** 2 - (SIDE - WALL) ** 2)
    percent = float(part_of(raised, mass).warnings[0].split("by some ")[1].split(" %")[0])
    framed = scene_of(tmp_path, RAISED, "gravity = {}\nframe = { pivot = [0.0, 0.0, 0.0], luffing = 1.5707963 }\n")
    share = second_order_effect(framed, pmr.reduce(framed).system.bodies).largest_share
    assert percent == pytest.approx(100.0 * share, abs=0.6)
    assert part_of(framed) == SummaryPart()
