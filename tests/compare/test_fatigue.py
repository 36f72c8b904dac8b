"""Damage by load cycles from a scene to its summary, beside the closed form of a sinusoid."""

import json

import numpy as np
import pytest

import pmr
from pmr import InputError
from pmr.scene import Scene
from pmr.scene.checks import check_scene
from pmr.scene.files import stored_scene

LENGTH, FORCE, CYCLES = 6.0, 2e4, 5
WIDTH, HEIGHT, WALL = 0.22, 0.32, 0.006
SLOPE, REFERENCE = 3.0, 90e6


def shaken(**fatigue: object) -> Scene:
    """A box without inertia, so to say, under a force at its tip that begins at its least."""
    stiff = {"young": 2.1e15, "density": 1e-3}
    signal = {"kind": "sine", "amplitude": FORCE, "frequency": 1.0, "phase": -np.pi / 2.0}
    return Scene.model_validate(
        {
            "title": "shaken",
            "start": "equilibrium",
            "fatigue": {"slope": SLOPE, "reference": REFERENCE} | fatigue,
            "sections": [
                {
                    "name": "boom",
                    "body": {
                        "model": "beam3d",
                        "shear": False,
                        "box": {"length": LENGTH, "width": WIDTH, "height": HEIGHT, "wall": WALL},
                        "material": stiff,
                    },
                    "mesh": {"elements": 8},
                    "supports": [{"on": "tail", "kind": "clamped"}],
                    "pads": [{"name": "none", "moving": True, "faces": {"top": [0.0]}, "stiffness": 1e-3}],
                    "slider": {"path": {"kind": "constant", "amount": 3.0}},
                    "loads": [{"name": "shaker", "direction": "z", "signal": signal}],
                    "probes": [{"name": "root", "at": [0.0, 0.0, HEIGHT / 2.0]}],
                }
            ],
            "time": {"end": float(CYCLES), "step": 0.01, "rho_inf": 0.0},
            "compare": {"against": []},
        }
    )


def test_a_sinusoid_does_the_damage_of_its_range() -> None:
    lines = [{"cycles": 1e5, "factor": 1.0}, {"cycles": 3e6, "factor": 0.4}, {"cycles": 1e9, "factor": 0.01}]
    result = pmr.run(shaken(spectrum=lines, cut_off=20e6)).result
    second = ((WIDTH + WALL) * (HEIGHT + WALL) ** 3 - (WIDTH - WALL) * (HEIGHT - WALL) ** 3) / 12.0
    size = 2.0 * FORCE * LENGTH * (HEIGHT + WALL) / 2.0 / second
    found = np.ptp(result.responses["reduced"].other("root stress axial"))
    assert found == pytest.approx(size, rel=1e-5)
    # the third line is below the cut-off
    expected = CYCLES * (found / REFERENCE) ** SLOPE / 2e6 * (1e5 + 3e6 * 0.4**SLOPE)
    worst = result.summary["fatigue"][0]
    assert worst["name"] == "root stress axial" and worst["damage"] == pytest.approx(expected, rel=1e-9)
    assert worst["life"] == pytest.approx(1.0 / expected, rel=1e-9)
    assert (expected > 1.0) == any("fails by fatigue" in line for line in result.summary["warnings"])


def test_damage_without_a_stress_is_refused() -> None:
    scene = shaken()
    part = scene.sections[0].model_copy(update={"probes": ()})
    with pytest.raises(InputError, match="fatigue.*a probe with measures"):
        check_scene(scene.model_copy(update={"sections": (part,)}))


def test_cycles_beside_a_spectrum_are_refused() -> None:
    with pytest.raises(ValueError, match="give cycles or spectrum"):
        shaken(cycles=2.0, spectrum=[{"cycles": 1.0}])


def test_a_stored_scene_keeps_its_spectrum() -> None:
    """Results of a run with a spectrum could not be read, and no study had such a scene."""
    scene = shaken(spectrum=[{"cycles": 1e5, "factor": 0.5}])
    assert stored_scene(json.loads(scene.model_dump_json()), "scene.json").fatigue == scene.fatigue


def test_the_life_of_a_load_that_stays_is_that_of_its_closed_cycles() -> None:
    """The first lift is half a cycle, each further one is a whole one."""
    ramp = {"kind": "smooth_ramp", "times": [0.0, 1.0], "values": [0.0, FORCE]}
    section = shaken().sections[0]
    lift = section.loads[0].model_dump() | {"signal": ramp}
    data = shaken().model_dump(exclude_unset=True)
    data["sections"][0]["loads"] = [{key: lift[key] for key in ("name", "direction", "signal")}]
    result = pmr.run(Scene.model_validate(data)).result
    size = np.ptp(result.responses["reduced"].other("root stress axial"))
    cycle = (size / REFERENCE) ** SLOPE / 2e6
    worst = result.summary["fatigue"][0]
    assert (worst["damage"], worst["life"]) == pytest.approx((cycle / 2.0, 1.0 / cycle + 0.5), rel=1e-9)
