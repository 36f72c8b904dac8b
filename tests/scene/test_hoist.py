"""A hoist in a scene: what is refused, in one line, and what it makes of a boom's inputs."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import plain_machines
import pytest
from processes import called

import pmr
from pmr.compare.evaluation import hoist_outputs
from pmr.errors import InputError
from pmr.scene import load_any
from pmr.scene.choice import axis_loads, choose_model
from pmr.scene.frame_checks import distance_along
from pmr.scene.members import members
from pmr.simulation.excitation import Excitation
from pmr.system.hoist import hoist_of


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ("hoist.section=jib", "hoist.section"),
        ("hoist.on=7.0", "hoist.on"),
        ("hoist.on=rope", "hoist.on"),
        ("hoist.payload=-1.0", "hoist.payload"),
        ("hoist.length=20.0", "hoist"),
        ("hoist.speed=3.0", "hoist.speed"),
        ("hoist.winch.section=jib", "hoist.winch.section"),
        ("hoist.winch={section='fly', at=[6.5, 0.0, 0.0]}", "hoist.winch.at"),
        ("frame.base.rx={kind='sine', amplitude=1.0, frequency=0.1}", "hoist.winch.section"),
        ("frame.base.z={kind='sine', amplitude=1.0, frequency=0.1}", "hoist.pivot_height"),
        ("frame.machine={mass=1e4}", "hoist"),
        ("sections.fly.observe.frequency_response=true", "sections[2].observe.frequency_response"),
        ("simulation.simulators=['exudyn']", "simulation.simulators"),
        ("simulation.full=petsc", "compare.against"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_key(change: str, key: str) -> None:
    with pytest.raises(InputError) as refused:
        pmr.load_scene(plain_machines.HOIST, [change])
    assert refused.value.key == key, refused.value


STANDS = [
    "hoist.winch={section='base', at=[0.0, 0.0, 0.0]}",
    "frame.ground={height=1.6, masses=[{name='m', mass=1e4, at=[0.0, 0.0, 0.0]}], outriggers=["
    "{name='a', at=[2.0, 2.0]}, {name='b', at=[2.0, -2.0]}, {name='c', at=[-4.0, 0.0]}]}",
]


def test_the_hook_of_a_machine_on_outriggers_is_measured_from_their_ground() -> None:
    scene = pmr.load_scene(plain_machines.HOIST, [*STANDS, "hoist.pivot_height=0.0"])
    assert hoist_of(scene).numbers[-1] == 1.6
    with pytest.raises(InputError, match=r"hoist\.pivot_height = 2\.0: frame\.ground\.height, 1\.6, is"):
        pmr.load_scene(plain_machines.HOIST, [*STANDS, "hoist.pivot_height=2.0"])
    lifted = "frame.base.z={kind='sine', amplitude=1.0, frequency=0.1}"
    with pytest.raises(InputError, match=r"frame\.ground\.height = 1\.6: 0 is allowed where frame\.base\.z moves"):
        pmr.load_scene(plain_machines.HOIST, [*STANDS, "hoist.pivot_height=0.0", lifted])


def test_a_head_that_is_not_at_the_tip_is_refused_in_second_order() -> None:
    with pytest.raises(InputError, match=r"hoist\.on"):
        pmr.load_scene(plain_machines.HOIST, ["frame.second_order=true", "hoist.on=5.0"])


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
    rings = "[{at=0.15, faces={bottom=[-0.06], top=[-0.06]}, unilateral=false}]"
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


def test_a_load_chart_refuses_a_hoist(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    refused = called(monkeypatch, capsys, "chart", "hoist", "--up-to", "1000", "--out", str(tmp_path / "chart"))
    assert refused.returncode == 2 and "hoist: none is allowed in a load chart" in refused.stderr
