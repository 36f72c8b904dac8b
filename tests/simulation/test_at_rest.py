"""Scenes at rest: angles of the scene stay in its unit beside postures that are given in rad."""

from typing import Any

import numpy as np
import pytest

from pmr.scene import Scene
from pmr.scene.checks import check_scene
from pmr.simulation.at_rest import accelerate_angle, amplitudes_at_rest, scene_at_rest
from pmr.simulation.excitation import Excitation
from pmr.simulation.reactions import machine_wrench

POSTURES, LOADS = np.arange(2.0), {"wind": 500.0}
LUFFING, SLEWING = np.array([0.2, 0.9]), np.array([0.0, 2.0])
MASSES = [{"name": "carrier", "mass": 9000.0, "at": [-0.6, 0.2, -0.8]}]
LEGS = [{"name": f"leg {x} {y}", "at": [x, y]} for x in (-2.0, 2.0) for y in (-1.5, 1.5)]


def boom(unit: str, *loads: dict[str, Any], **angles: list[float]) -> Scene:
    """A boom in wind, or with these loads and second order, on a machine; its `angles` in rad are written in `unit`."""
    per = 1.0 if unit == "rad" else 180.0 / np.pi
    (azimuth,), base, slope = ((per * np.array(angles[key])).tolist() for key in ("azimuth", "base", "slope"))
    frame: dict[str, Any] = {"pivot": [0.4, 0.0, 0.3], "unit": unit, "luffing": 0.7 * per, "slewing": 1.0 * per}
    frame["second_order"] = bool(loads)
    frame["ground"] = {"height": 1.4, "slope": slope, "masses": MASSES, "outriggers": LEGS}
    if any(base):
        frame["base"] = dict(zip(("rx", "ry", "rz"), base, strict=True))
    wind = {"name": "wind", "acts": "wind", "azimuth": azimuth, "shape": 1.5, "signal": 400.0}
    section = {
        "name": "boom",
        "body": {"model": "beam3d", "box": {"length": 6.0, "width": 0.22, "height": 0.32, "wall": 0.006}},
        "supports": [{"name": "pin", "on": "tail", "kind": "clamped"}],
        "loads": loads or [wind],
    }
    scene = Scene.model_validate(
        {"title": "boom", "frame": frame, "sections": [section], "gravity": {}, "time": {"end": 1.0, "step": 0.01}}
    )
    check_scene(scene)
    return scene


@pytest.mark.parametrize(
    "angles",
    [
        {"azimuth": [3.5], "base": [0.0, 0.0, 0.0], "slope": [0.02, -0.04]},
        {"azimuth": [-1.2], "base": [0.03, -0.02, 0.8], "slope": [0.0, 0.0]},
    ],
    ids=["on a slope", "on an inclined base"],
)
@pytest.mark.parametrize("accelerated", [None, "luffing", "slewing"])
def test_a_scene_in_degrees_has_the_loads_of_the_same_scene_in_rad(
    angles: dict[str, list[float]], accelerated: str | None
) -> None:
    drives = []
    for unit in ("degrees", "rad"):
        scene = boom(unit, **angles)
        still = scene_at_rest(scene, {}, LUFFING, SLEWING, LOADS)
        still = accelerate_angle(still, accelerated) if accelerated else still
        excitation = Excitation.from_scene(still)
        drives.append(
            {name: signal.value(POSTURES) for name, signal in (excitation.loads | excitation.terms).items()}
            | {"machine": machine_wrench(still, POSTURES)}
        )
    in_degrees, in_rad = drives
    assert in_degrees.keys() == in_rad.keys() and any("wind" in name for name in in_rad)
    cancelled = 1e-14 * max(float(np.abs(values).max()) for values in in_rad.values())  # round-off of terms of a sum
    for name, values in in_rad.items():
        assert in_degrees[name] == pytest.approx(values, rel=1e-12, abs=cancelled), name


@pytest.mark.parametrize("direction", ["x", "z"])
def test_a_force_that_grows_in_time_compresses_with_all_of_it(direction: str) -> None:
    """Downwards on a raised boom as well as against its end: its largest value, 0, is the one at the start."""
    amplitudes = []
    for signal in (-4e3, {"kind": "smooth_ramp", "times": [0.0, 1.0], "values": [0.0, -4e3]}):
        load = {"name": "payload", "direction": direction, "axes": "ground", "signal": signal}
        scene = boom("rad", load, azimuth=[0.0], base=[0.0, 0.0, 0.0], slope=[0.0, 0.0])
        amplitudes.append(amplitudes_at_rest(scene, {"boom": np.zeros(2)}, 0.7))
    constant, growing = amplitudes
    assert constant.min() < 0.0 and growing == pytest.approx(constant)
