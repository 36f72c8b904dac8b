"""A ground below the machine of a scene and in a load chart: what is refused, in one line.

A hoist in a scene: what is refused, in one line, and what it makes of a boom's inputs.
Slips that users of hoists, oil, outriggers, loads and vehicles make: each has one line that says what is allowed.
"""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import plain_machines
import pytest

import pmr
from pmr import InputError
from pmr import scene as scenes
from pmr.compare.evaluation import hoist_outputs
from pmr.scene import load_any
from pmr.scene.choice import axis_loads, choose_model
from pmr.scene.frame_checks import distance_along
from pmr.scene.hints import hints
from pmr.scene.members import members
from pmr.simulation import Excitation
from pmr.studies.limits import Limit
from pmr.system.terms import hoist_of

STILL = ("frame.unit=rad", "frame.luffing=0.3", "frame.slewing=0.0")


A, B, C = ("{name='a',at=[2.0,1.5]}", "{name='b',at=[-2.0,1.5]}", "{name='c',at=[-2.0,-1.5]}")

CARRIER = "{name='carrier',mass=9e3,at=[0.0,0.0,-1.0]}"


def ground(*outriggers: str, more: str = "") -> str:
    return f"frame.ground={{masses=[{CARRIER}],outriggers=[{','.join(outriggers)}]{more}}}"


REFUSED = [
    ((ground(A, B),), "frame.ground.outriggers = 2: three or more are allowed"),
    ((ground(A, "{name='b',at=[4.0,3.0]}", "{name='c',at=[-2.0,-1.5]}"),),
     "frame.ground.outriggers: places that are not on one line are allowed"),
    ((ground(A, B, C, "{name='d',at=[2.0,1.5]}"),), r"frame.ground.outriggers.at = \[2.0, 1.5\]: a place of its own"),
    ((ground(A, B, C, "{name='a',at=[2.0,-1.5]}"),), "frame.ground.outriggers.name = 'a': a name of its own"),
    ((ground(A, B, "{name='c',at=[0.0,-1.5],stiffness=-1.0}"),), r"outriggers\[2\].stiffness = -1.0: .*greater than 0"),
    ((ground(A, B, "{name='c',at=[0.0,-1.5],stiff=1.0}"),), r"outriggers\[2\].stiff = 1.0: unknown key; did you mean"),
    ((ground(A, B, C, more=",slope=[100.0,0.0]"),), r"frame.ground.slope\[0\] = 100"),
    ((ground(A, B, C, more=",slope=[0.1,0.0]"), "frame.base.ry=0.1"), "frame.base.ry: none is allowed beside frame.gr"),
    ((ground(A, B, C), "frame.ground.masses.0.mass=0.0"), r"masses\[0\].mass = 0.0: .*greater than 0"),
    ((ground(A, B, C), "frame.ground.masses.0.inertia=[1.0,1.0,5.0]"), r"masses\[0\].inertia"),
    ((ground(A, B, C), "frame.machine={mass=1e4}"), "frame.ground: none is allowed beside frame.machine"),
    ((ground(A, B, C), "sections.base.supports.0.points=all"), "points = 'all': 'mean' is allowed with frame.ground"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "told"), REFUSED)
def test_a_ground_that_can_hold_no_machine_is_refused_in_one_line(changes: tuple[str, ...], told: str) -> None:
    with pytest.raises(InputError, match=told) as refused:
        scenes.load_any("crane", [*STILL, *changes])
    assert "\n" not in str(refused.value)


def test_limits_on_what_a_machine_stands_on_need_a_ground() -> None:
    bare = scenes.load_any("crane")
    stands = scenes.load_any("crane", [ground(A, B, C)])
    for limit in (
        Limit(name="t", of="tipping", most=0.8),
        Limit(name="o", of="outrigger", most=1e5),
        Limit(name="l", of="lift-off", least=1e3),
        Limit(name="v", of="overturning"),
    ):
        limit.check(stands)
        with pytest.raises(InputError, match=f"limits.{limit.name}.of = '{limit.of}': a scene with frame.ground"):
            limit.check(bare)
    with pytest.raises(ValueError, match="polygon and machine belong to a limit of overturning"):
        Limit(name="t", of="tipping", most=0.8, polygon=[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])


STANDS = [
    "hoist.winch={section='base', at=[0.0, 0.0, 0.0]}",
    "frame.ground={height=1.6, masses=[{name='m', mass=1e4, at=[0.0, 0.0, 0.0]}], outriggers=["
    "{name='a', at=[2.0, 2.0]}, {name='b', at=[2.0, -2.0]}, {name='c', at=[-4.0, 0.0]}]}",
]


def test_the_hook_of_a_machine_on_outriggers_is_measured_from_their_ground() -> None:
    scene = pmr.load_scene(plain_machines.HOIST, [*STANDS, "hoist.pivot_height=0.0"])
    assert hoist_of(scene).numbers[-1] == 1.6
    with pytest.raises(
        InputError, match=r"hoist\.pivot_height = 2\.0: leave it out, as frame\.ground\.height = 1\.6 is"
    ):
        pmr.load_scene(plain_machines.HOIST, [*STANDS, "hoist.pivot_height=2.0"])
    lifted = "frame.base.z={kind='sine', amplitude=1.0, frequency=0.1}"
    with pytest.raises(InputError, match=r"frame\.ground\.height = 1\.6: 0 is allowed, as frame\.base\.z moves"):
        pmr.load_scene(plain_machines.HOIST, [*STANDS, "hoist.pivot_height=0.0", lifted])


def test_its_outputs_belong_to_the_section_with_its_head() -> None:
    hoist = hoist_of(pmr.load_scene(plain_machines.HOIST, ["hoist.section=middle"]))
    bodies = dict.fromkeys(("base", "middle", "fly"))
    assert {output.body for output in hoist_outputs(SimpleNamespace(bodies=bodies, hoist=hoist))} == {"middle"}


def test_a_head_off_the_axis_turns_its_section() -> None:
    *_, fly = members(pmr.load_scene(plain_machines.HOIST, ["hoist.offset=[0.1, 0.2]"]))
    assert [load.name for load in axis_loads(fly)] == [f"hoist {d}" for d in ("x", "y", "z", "rx", "ry", "rz")]


@pytest.mark.parametrize(
    "key", ["hoist.offset=[0.1, 0.0]", "hoist.swing=[0.0, 0.1]", "hoist.winch.at=[-0.5, 0.1, 0.4]", "hoist.wind.y=1.0"]
)
def test_a_payload_beside_the_vertical_plane_needs_sections_in_space(key: str, tmp_path: Path) -> None:
    lines = plain_machines.HOIST.read_text().splitlines()
    file = tmp_path / "planar.toml"
    file.write_text("\n".join(line for line in lines if not line.startswith(("slewing", "wind.y", "#:"))))
    rings = "[{at=0.15, faces={bottom=[0.0], top=[0.0]}, unilateral=false}]"
    supports = "[{on='tail', directions=['x', 'z']}, {on=1.5, directions=['z']}]"
    plane = ["section.body.model=auto", f"sections.base.supports={supports}"]
    plane += [f"section.joint.{end}={rings}" for end in ("tail", "mouth")]
    assert {choose_model(member).model for member in members(load_any(file, plane))} == {"beam2d"}
    assert {choose_model(member).model for member in members(load_any(file, [*plane, key]))} == {"beam3d"}


def test_a_payload_at_rest_weighs_and_its_rope_presses() -> None:
    scene = pmr.load_scene(plain_machines.HOIST)
    loads = Excitation.from_scene(scene).loads
    weight, up = 450.0 * 9.80665, np.sqrt(0.5)
    assert [float(loads[f"fly.hoist {d}"].value(0.0)) for d in "xyz"] == pytest.approx(
        [-weight * up - weight / 2.0, 0.0, -weight * up]
    )
    assert distance_along(scene, 0.0) == pytest.approx(np.hypot(10.0 * up + 0.5, 10.0 * up - 0.4))


def test_a_load_chart_refuses_a_hoist(tmp_path: Path, run_command) -> None:
    refused = run_command("chart", "hoist", "--up-to", "1000", "--out", str(tmp_path / "chart"))
    assert refused.returncode == 2 and "hoist: leave it out, as a load chart" in refused.stderr


@pytest.mark.parametrize(
    ("name", "change", "said"),
    [
        ("hoist", "hoist.payload=0.4", "hoist.payload = 0.4 kg is unusual"),
        ("luffing_oil", "frame.cylinder.oil.supply=210.0", "oil.supply = 210 Pa is unusual"),
        ("luffing_oil", "frame.cylinder.oil.valve.gain=[8e-4,2e-4]", "valve.gain[0] = 0.0008"),
        ("crane", "sections.fly.loads=[{acts='temperature',signal=293.0}]", "signal = 293 K is unusual"),
        ("crane", "sections.fly.loads=[{acts='wind',signal=0.25}]", "signal = 0.25 Pa is unusual"),
    ],
)
def test_a_wrong_unit_has_a_hint(name: str, change: str, said: str) -> None:
    here = " ".join(hints(pmr.load_scene(name, [change])))
    assert said in here and said not in " ".join(hints(pmr.load_scene(name)))
