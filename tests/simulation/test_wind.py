"""Wind on a boom beside integrals of its profile."""

import json
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

import pmr
from pmr import InputError
from pmr.files.arrays import Array
from pmr.scene import Scene
from pmr.scene.checks import check_scene
from pmr.scene.files import stored_scene
from pmr.scene.ground import Ground
from pmr.scene.hoist import Hoist
from pmr.scene.members import member_at
from pmr.simulation.frame import WindOnSection, load_signals
from pmr.studies.tasks import scene_arguments, scene_of

LENGTHS, OUT, PIVOT, ABOVE = (6.0, 5.5), 3.7, (0.4, 0.0, 0.3), 1.8
BOXES = ((0.30, 0.40, 0.008), (0.26, 0.36, 0.006))
PADS = [{"at": 0.2, "faces": {"bottom": [-0.05, 0.05], "top": [-0.05, 0.05], "left": [0.0], "right": [0.0]}}]
WIND = {
    "acts": "wind", "azimuth": 70.0, "shape": 1.6, "exponent": 0.16, "reference": 10.0, "least": 4.0, "above": ABOVE,
}  # fmt: skip


def still(amount: float) -> dict[str, Any]:
    return {"kind": "constant", "amount": amount}


def scene(luffing: Any, slewing: Any, pressure: Any, model: str = "beam3d", **load: Any) -> Scene:
    """Two sections in the wind, clamped to a machine, with a base that is inclined."""
    sections = list[dict[str, Any]]()
    for k, (length, (width, height, wall)) in enumerate(zip(LENGTHS, BOXES, strict=True)):
        body = {"model": model, "box": {"length": length, "width": width, "height": height, "wall": wall}}
        part: dict[str, Any] = {"name": f"s{k}", "body": body, "mesh": {"elements": 6}}
        part |= {"reduction": {"coordinates": 8, "estimate": False}}
        part["loads"] = [WIND | {"name": "wind", "signal": pressure} | load]
        pads = [ring | {"unilateral": False} for ring in PADS]
        part |= {"joint": {"extension": still(OUT), "tail": pads, "mouth": pads}} if k else {}
        part |= {} if k else {"supports": [{"name": "clamp", "kind": "clamped"}]}
        sections.append(part)
    frame = {
        "pivot": list(PIVOT), "unit": "degrees", "luffing": luffing, "slewing": slewing, "base": {"ry": still(2.0)},
    }  # fmt: skip
    built = Scene.model_validate(
        {
            "title": "wind",
            "frame": frame,
            "sections": sections,
            "gravity": {"acceleration": 1e-9},
            "start": "equilibrium",
            "time": {"end": 2.0, "step": 0.02},
            "compare": {"against": [], "richer": "none"},
        }
    )
    check_scene(built)
    return built


def by_integrals(luffing: float, slewing: float, pressure: float) -> Array:
    """Force and moment about the pivot (6,) of the wind, in the axes of the boom, by adaptive quadrature."""
    turned = Rotation.from_euler("ZY", [slewing, -luffing], degrees=True)
    R = (Rotation.from_euler("Y", 2.0, degrees=True) * turned).as_matrix()
    blown = R.T @ [np.cos(np.deg2rad(70.0)), np.sin(np.deg2rad(70.0)), 0.0]
    total, tail = np.zeros(6), 0.0
    for k, (length, (width, height, _)) in enumerate(zip(LENGTHS, BOXES, strict=True)):
        tail, hidden = tail + OUT * k, max(LENGTHS[0] - OUT, 0.0) * k
        for axis, depth in ((1, height), (2, width)):
            push = 1.6 * depth * blown[axis] * abs(blown[axis]) * pressure

            def per_length(x: float, power: int, tail: float = tail) -> float:
                """Profile at x from the section's tail, times its distance from the pivot along the boom."""
                at = ABOVE + R[2] @ (np.array(PIVOT) + [tail + x, 0.0, 0.0])
                return float((max(at, 4.0) / 10.0) ** 0.32 * (PIVOT[0] + tail + x) ** power)

            bend = float(np.clip((4.0 - ABOVE - R[2] @ (np.array(PIVOT) + [tail, 0.0, 0.0])) / R[2, 0], hidden, length))
            parts = [(hidden, bend), (bend, length)]
            force, first = (
                push * sum(quad(per_length, *part, (power,), epsrel=1e-12, epsabs=1e-13)[0] for part in parts)
                for power in (0, 1)
            )
            total[axis] += force
            # x' F - z' F of the pivot's height above the axis
            arm = np.zeros(3)
            arm[2] = PIVOT[2]
            total[3:] += np.cross([1.0, 0.0, 0.0], first * np.eye(3)[axis]) + np.cross(arm, force * np.eye(3)[axis])
    return total


@pytest.mark.slow
@pytest.mark.parametrize(
    ("luffing", "slewing", "keys"),
    [
        (25.0, 40.0, {}),
        (3.0, -20.0, {}),
        (60.0, 90.0, {}),
        (40.0, 30.0, {"model": "shell", "slews": True, "azimuth": 40.0}),  # 40 degrees from the boom: 70 from X
    ],
)
def test_force_and_moment_of_the_wind_are_integrals_of_its_profile(
    luffing: float, slewing: float, keys: dict[str, Any]
) -> None:
    """Of what the boom presses with on its machine at rest."""
    built = scene(still(luffing), still(slewing), still(300.0), **keys)
    found = pmr.simulate(built, pmr.reduce(built).reduced)
    expected = by_integrals(luffing, slewing, 300.0)
    for k, axis in enumerate(("x", "y", "z", "rx", "ry", "rz")):
        size = np.abs(expected[:3] if k < 3 else expected[3:]).max()
        assert found.other(f"reaction of pivot {axis}")[0] == pytest.approx(expected[k], abs=1e-8 * size)


@pytest.mark.parametrize("t", [0.0, 0.7, 2.0])
def test_polynomials_of_the_wind_have_its_force_and_moment_at_any_time(t: float) -> None:
    """A gust while the boom luffs and slews; 1e-9 of the largest."""
    ramp = {"kind": "smooth_ramp", "times": [0.0, 2.0]}
    built = scene(ramp | {"values": [0.0, 50.0]}, ramp | {"values": [0.0, 90.0]}, ramp | {"values": [100.0, 400.0]})
    assert built.frame is not None
    luffing, slewing = (float(np.rad2deg(angle.value(t))) for angle in built.frame.angles)
    pressure, total = float(built.sections[0].loads[0].signal.value(t)), np.zeros(6)
    for number, length in enumerate(LENGTHS):
        signals = load_signals(built, member_at(built, number))
        for axis in (1, 2):
            force, first = (float(signals[f"wind {'xyz'[axis]} {degree}"].value(t)) for degree in (0, 1))
            force, first = (
                force * length,
                first * length**2 / 6.0 + force * length * (length / 2.0 + PIVOT[0] + OUT * number),
            )
            total[axis] += force
            total[3:] += np.cross([1.0, 0.0, 0.0], first * np.eye(3)[axis])
            total[3:] += np.cross([0.0, 0.0, PIVOT[2]], force * np.eye(3)[axis])
    expected = by_integrals(luffing, slewing, pressure)
    assert total[:3] == pytest.approx(expected[:3], abs=1e-9 * np.abs(expected[:3]).max())
    assert total[3:] == pytest.approx(expected[3:], abs=1e-9 * np.abs(expected[3:]).max())


def test_wind_above_a_ground_is_the_same_in_a_stored_scene_and_in_a_task_of_a_study() -> None:
    """It had the pivot on the ground there, and beside a hoist that says how high the pivot is.

    Stored scenes of earlier versions have this 0 in all loads.
    """
    built, on_ground = (scene(still(30.0), still(0.0), still(300.0), above=above) for above in (None, 0.0))
    assert built.frame is not None
    outriggers = [{"name": name, "at": at} for name, at in (("a", (2.0, 2.0)), ("b", (2.0, -2.0)), ("c", (-2.0, 0.0)))]
    ground = Ground.model_validate({"height": ABOVE, "outriggers": outriggers})
    built, on_ground = (each.with_keys(frame={"ground": ground}) for each in (built, on_ground))
    former = json.loads(built.model_dump_json())
    for part in former["sections"]:
        part["loads"][0]["above"] = 0.0
    copies = [scene_of(scene_arguments(built)), *(stored_scene(data, "scene.json") for data in (former, json.loads(
        built.model_dump_json()))), scene(still(30.0), still(0.0), still(300.0)), on_ground]  # fmt: skip
    amplitudes = [
        [float(signal.value(0.0)) for signal in load_signals(each, member_at(each, 1)).values()]
        for each in (built, *copies)
    ]
    assert all(of_copy == amplitudes[0] for of_copy in amplitudes[1:]) and amplitudes[0][0] > 0.0
    hoisting = scene(still(30.0), still(0.0), still(300.0), above=None).with_keys(
        hoist=Hoist(payload=100.0, length=2.0, EA=1e7, pivot_height=ABOVE)
    )
    wind = load_signals(hoisting, member_at(hoisting, 1))
    assert [float(wind[f"wind {axis} {k}"].value(0.0)) for axis in "yz" for k in range(4)] == amplitudes[0]


def test_a_base_that_rises_lifts_the_boom_into_stronger_wind() -> None:
    """The pivot rises by 3 m in 2 s, beside pivots that are at its heights from the start."""
    pressure = still(300.0)
    built = scene(still(30.0), still(0.0), pressure)
    rise = {"ry": still(2.0), "z": {"kind": "smooth_ramp", "times": [0.0, 2.0], "values": [0.0, 3.0]}}
    rising = Scene.model_validate(built.model_dump(mode="json") | {"frame": built.frame.model_dump() | {"base": rise}})
    for t, height in ((0.0, 0.0), (1.0, 1.5), (2.0, 3.0)):
        higher = scene(still(30.0), still(0.0), pressure, above=ABOVE + height)
        of_rising, of_higher = (
            [float(signal.value(t)) for signal in load_signals(each, member_at(each, 1)).values()]
            for each in (rising, higher)
        )
        assert of_rising == pytest.approx(of_higher, rel=1e-12) and of_rising[0] > 0.0


def test_a_wind_without_a_profile_presses_alike_on_what_is_outside() -> None:
    built = scene(still(0.0), still(0.0), still(200.0), exponent=0.0, azimuth=90.0)
    signals = load_signals(built, member_at(built, 0))
    assert isinstance(signals["wind y 0"], WindOnSection)
    assert signals["wind y 0"].value(0.5) == pytest.approx(1.6 * 0.40 * 200.0)
    assert [float(signals[f"wind y {k}"].value(0.5)) for k in (1, 2, 3)] == pytest.approx([0.0] * 3, abs=1e-9)
    assert float(signals["wind z 0"].value(0.5)) == pytest.approx(0.0, abs=1e-9)
    of_fly = load_signals(built, member_at(built, 1))["wind y 0"].value(0.5)
    assert of_fly == pytest.approx(1.6 * 0.36 * 200.0 * (LENGTHS[1] - (LENGTHS[0] - OUT)) / LENGTHS[1])


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"exponent": -0.1}, "greater than or equal to 0"),
        ({"shape": 0.0}, "greater than 0"),
        ({"direction": "y"}, "acts = 'force' or 'temperature' is allowed with it"),
        ({"on": "tail"}, "acts = 'force' is allowed with it"),
        ({"acts": "force"}, "acts = 'wind' is allowed with it"),
    ],
)
def test_keys_that_wind_does_not_have_are_refused(changes: dict[str, Any], told: str) -> None:
    with pytest.raises((InputError, ValueError), match=told):
        scene(still(0.0), still(0.0), still(200.0), **changes)
