"""Largest forces of a motion over those at rest: a boom that stands has the factor 1, one that is let go some 2."""

from typing import Any

import free_boom
import numpy as np
import plain_machines
import pytest

import pmr
from pmr.compare.strength import dynamic_factors_part
from pmr.scene import Scene

pytestmark = pytest.mark.slow  # a boom is reduced

STANDS = ("sections.fly.joint.extension={kind='constant', amount=0.7}", "sections.fly.masses.0.mass=2000.0")


def rows(*keys: str) -> dict[str, dict[str, Any]]:
    """Rows of ``dynamic_factors`` by kind of force."""
    scene = free_boom.scene("frame.second_order=false", *keys)
    system = pmr.reduce(scene).system
    figures = dynamic_factors_part(scene, system, pmr.simulate(scene, system)).figures
    return {row["kind"]: row for row in figures.get("dynamic_factors", ())}


def test_a_boom_at_rest_has_the_factor_1() -> None:
    of = rows(*STANDS, "start='equilibrium'", "time.end=0.02")
    assert [*of] == ["pad", "reaction", "resultant", "cylinder"]
    for row in of.values():
        assert row["largest"] / row["rest"] == pytest.approx(1.0, abs=1e-9)


def test_a_boom_that_is_let_go_swings_to_twice_its_force_at_rest() -> None:
    """A heavy load on a light boom is nearly a single mass on a spring, whose largest force is twice its weight."""
    pad = rows(*STANDS, "start='rest'", "gravity.rise=0.0", "time.end=0.4", "time.step=5e-4")["pad"]
    assert pad["largest"] / pad["rest"] == pytest.approx(2.0, rel=0.05)


def test_rest_is_that_of_the_posture_and_the_loads_at_the_time_of_the_largest_force() -> None:
    hook = "sections.fly.loads.2.signal={kind='sine', amplitude=5e3, frequency=3.0}"
    pad = rows("start='equilibrium'", hook)["pad"]
    scene = free_boom.scene("frame.second_order=false", "start='equilibrium'", hook)
    extension, load = (
        float(signal.value(pad["t"])) for signal in (scene.extension(1), scene.sections[1].loads[2].signal)
    )
    still = free_boom.scene(
        "frame.second_order=false",
        "start='equilibrium'",
        f"sections.fly.joint.extension={{kind='constant', amount={extension!r}}}",
        f"sections.fly.loads.2.signal={{kind='constant', amount={load!r}}}",
    )
    response = pmr.simulate(still, pmr.reduce(still).system)
    (number,) = [k for k, output in enumerate(response.outputs) if output.name == pad["name"]]
    assert pad["rest"] == pytest.approx(response.column(number)[0], rel=1e-6)
    assert abs(load) > 1e3 and 0.5 < extension < 0.9


def test_a_boom_that_a_gust_lifts_has_no_force_at_rest_under_it() -> None:
    """A beam on a pin and a pad that only pushes: the force of the pin is largest while the tip is pulled up."""
    pulse = {"kind": "table", "interpolation": "linear", "times": [0.0, 0.05, 0.06], "values": [0.0, 0.0, 2e4]}
    scene = Scene.model_validate(
        {
            "title": "beam on a pad",
            "start": "equilibrium",
            "free_motions": "allowed",
            "frame": {"pivot": [0.0, 0.0, 0.0], "luffing": 0.0, "second_order": False},
            "body": {
                "model": "beam3d",
                "box": {"length": 6.0, "width": 0.2, "height": 0.2, "wall": 0.006},
                "material": {"young": 2.1e11, "density": 7850.0, "poisson": 0.3},
            },
            "mesh": {"elements": 4},
            "supports": [{"on": "tail", "directions": ["x", "y", "z", "rx", "rz"]}],
            "pads": [
                {"name": "pad", "at": 3.0, "length": 0.1, "width": 0.05, "faces": {"bottom": [0.0]},
                 "stiffness": 1e8, "unilateral": True}
            ],
            "loads": [{"name": "gust", "on": "tip", "direction": "z", "signal": pulse}],
            "reduction": {"coordinates": 6, "estimate": False},
            "gravity": {},
            "time": {"end": 0.06, "step": 1e-3},
            "compare": {"against": []},
        }
    )  # fmt: skip
    system = pmr.reduce(scene).system
    figures = dynamic_factors_part(scene, system, pmr.simulate(scene, system)).figures
    assert not {row["kind"] for row in figures.get("dynamic_factors", ())} & {"reaction", "resultant"}


def test_loads_of_one_name_on_two_sections_keep_their_own_values() -> None:
    """The boom stands still, so each force is the one at rest."""
    _, middle, fly = pmr.load_scene("boom_three").names
    load = "{name='push', on='tip', direction='z', signal={kind='constant', amount=%s}}"
    loads = [f"sections.{name}.loads=[{load % amount}]" for name, amount in ((middle, 5e4), (fly, 1e3))]
    still = [f"sections.{name}.joint.extension={{kind='constant', amount=1.5}}" for name in (middle, fly)]
    frame = ("frame={pivot=[0.0,0.0,0.0], luffing=0.1}", "start='equilibrium'", "compare.against=[]", "time.end=0.02")
    scene = pmr.load_scene("boom_three", [*frame, *still, *loads, "gravity.rise=0.0"])
    model = pmr.reduce(scene).system
    found = dynamic_factors_part(scene, model, pmr.simulate(scene, model)).figures["dynamic_factors"]
    assert [row["kind"] for row in found] == ["pad", "reaction", "resultant", "cylinder"]
    assert all(row["largest"] / row["rest"] == pytest.approx(1.0, abs=1e-9) for row in found)


def test_a_body_on_a_moving_slider_rests_where_it_is_at_the_largest_force() -> None:
    still = ("frame={pivot=[0.0,0.0,0.0], luffing=0.1}", "start='equilibrium'", "compare.against=[]")
    path = "slider.path={kind='smooth_ramp', times=[0.0, 2.5], values=[4.0, 1.5]}"
    scene = pmr.load_scene("boom_beam", [*still, path, "time.end=3.0"])
    model = pmr.reduce(scene).system
    found = dynamic_factors_part(scene, model, pmr.simulate(scene, model)).figures["dynamic_factors"][0]
    place = float(scene.slider.path.value(found["t"]))
    loads = [f"loads.{load.name}.signal={float(load.signal.value(found['t']))!r}" for load in scene.sections[0].loads]
    there = pmr.load_scene("boom_beam", [*still, "time.end=0.02", "gravity.rise=0.0", f"slider.path={place!r}", *loads])
    response = pmr.simulate(there, model)
    (number,) = [k for k, output in enumerate(response.outputs) if output.name == found["name"]]
    assert found["rest"] == pytest.approx(response.column(number)[0], rel=1e-9)
    assert abs(place - float(scene.slider.path.value(0.0))) > 0.1


@pytest.mark.parametrize("key", ["frame.base={z={kind='sine', amplitude=0.1, frequency=1.0}}"])
def test_a_base_that_moves_has_no_factor(key: str) -> None:
    assert rows(*STANDS, key, "time.end=0.02") == {}


def outriggers(*keys: str) -> Scene:
    """A coarse crane on outriggers, its sections out by 2 m."""
    few = ("section.mesh.elements=6", "section.reduction.estimate=false", "compare.against=[]")
    out = [f"sections.{name}.joint.extension=2.0" for name in ("middle", "fly")]
    return pmr.load_scene(plain_machines.OUTRIGGERS, [*few, *out, *keys])


def test_a_machine_that_stands_has_the_factor_1_in_its_pin_and_in_the_use_of_its_support_polygon() -> None:
    scene = outriggers("frame.luffing=20.0", "frame.slewing=30.0", "time.end=0.04")
    model = pmr.reduce(scene).system
    found = dynamic_factors_part(scene, model, pmr.simulate(scene, model)).figures["dynamic_factors"]
    assert {"reaction", "resultant", "outrigger", "tipping"} < {row["kind"] for row in found}
    assert all(row["largest"] / row["rest"] == pytest.approx(1.0, abs=1e-6) for row in found)


def test_the_resultant_of_a_pin_has_the_factor_of_its_history_not_of_a_component() -> None:
    """The pin of a crane that luffs fast: the largest resultant, over that of the same posture held still."""
    still = ("frame.slewing=0.0", "start='equilibrium'")
    luffing = "frame.luffing={kind='smooth_ramp', times=[0.0, 0.5], values=[20.0, 30.0]}"
    scene = outriggers(*still, luffing, "time.end=0.5")
    model = pmr.reduce(scene).system
    response = pmr.simulate(scene, model)
    rows = dynamic_factors_part(scene, model, response).figures["dynamic_factors"]
    pin = next(row for row in rows if row["kind"] == "resultant")
    axes = [f"reaction of base: pin {axis}" for axis in "xyz"]
    sizes = np.sqrt(sum(response.other(name) ** 2 for name in axes))
    assert pin["name"] == "base: pin" and pin["largest"] == pytest.approx(sizes.max(), rel=1e-12)
    there = outriggers(*still, f"frame.luffing={float(scene.frame.luffing.value(pin['t']))!r}", "time.end=0.02")
    at_rest = pmr.simulate(there, pmr.reduce(there).system)
    rest = np.sqrt(sum(at_rest.other(name)[0] ** 2 for name in axes))
    assert pin["rest"] == pytest.approx(rest, rel=1e-6) and pin["largest"] / rest > 1.02
