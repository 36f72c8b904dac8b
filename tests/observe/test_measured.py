"""Observers and measurements in files, and the command that joins them."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from oscillator import OUTPUTS, H, history, measured, oscillator

import pmr
from pmr import InputError, Observer
from pmr.observe.budget import output_errors
from pmr.observe.measured import Observation, ObserverFile, describe_faults, read_measurements
from pmr.observe.observer import Sensor, UnknownLoad

FILE = """
estimate = ["tip"]
step = 2e-3

[[sensors]]
output = "acceleration of fly: tip z"
noise = 0.02

[[sensors]]
output = "base: force of cylinder"
noise = 200.0

[payload]
input = "fly.tip force"
acceleration = "acceleration of fly: tip z"
deviation = 100.0
"""
PADS = "[{at=0.15,stiffness=1e8,unilateral=false,faces={bottom=[0.0],top=[0.0]}}]"
BOOM = [
    "section.mesh.elements=8", "section.reduction.coordinates=3", "section.reduction.estimate=false",
    f"section.joint.tail={PADS}", f"section.joint.mouth={PADS}", "start='equilibrium'", "time.end=0.1",
    "time.rho_inf=0.9",
    "sections.base.supports=[{kind='pinned'},{name='cylinder',on=1.5,directions=['z'],stiffness=5e7}]",
    "section.joint.extension={kind='smooth_ramp',times=[0.0,0.1],values=[0.8,0.9]}",
    "sections.fly.loads=[{name='tip force',on='tip',direction='z',signal=0.0}]",
]  # fmt: skip


def test_a_table_of_measurements_is_read(tmp_path: Path) -> None:
    file = tmp_path / "day.csv"
    file.write_text('t [s],a [m/s^2],"force, of b [N]"\n0.1,1,\n0.2,2.5,-3\n')
    data = read_measurements(file)
    assert list(data) == ["a", "force, of b"]
    np.testing.assert_array_equal(data["a"][0], [0.1, 0.2])
    np.testing.assert_array_equal(data["force, of b"][1], [np.nan, -3.0])


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", "columns"), ("a,b\n1,2\n2,3\n", "columns"), ("t,a,a\n1,2,3\n2,3,4\n", "columns"),
        ("t [s],a [kN]\n1,2\n2,3\n", "columns"), ("t [ms],a [N]\n1,2\n2,3\n", "columns"),
        ("t,a\n1,2\n\n2,x\n", "line 4, a"), ("t,a\n1,2\n2\n", "line 3"), ("t,a\n2,2\n1,3\n", "t"),
        ("t,a\nnan,2\n1,3\n", "t"),
    ],
)  # fmt: skip
def test_a_table_that_is_none_is_refused(tmp_path: Path, text: str, named: str) -> None:
    file = tmp_path / "day.csv"
    file.write_text(text)
    with pytest.raises(InputError) as refused:
        read_measurements(file)
    assert refused.value.key == named and "day.csv" in str(refused.value)
    with pytest.raises(InputError):
        read_measurements(tmp_path / "none.csv")


def test_a_table_in_another_encoding_is_called_so(tmp_path: Path) -> None:
    file = tmp_path / "day.csv"
    file.write_bytes("t [s],a [m/s²]\n0.1,1\n0.2,2\n".encode("cp1252"))
    with pytest.raises(InputError, match="a table of text in UTF-8 is allowed"):
        read_measurements(file)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (("noise = 0.02", "noise = 'much'"), "sensors.0.noise"),
        (("noise = 0.02", "nois = 0.02"), "sensors.0"),
        (("deviation = 100.0", "deviation = nan"), "payload.deviation"),
        (('estimate = ["tip"]', ""), "estimate"),
        (("[payload]", "[payload"), ""),
    ],
)
def test_an_observer_that_is_none_is_refused(tmp_path: Path, change: tuple[str, str], named: str) -> None:
    file = tmp_path / "sensors.toml"
    file.write_text(FILE)
    assert ObserverFile.read(file).step == 2e-3
    file.write_text(FILE.replace(*change))
    with pytest.raises(InputError) as refused:
        ObserverFile.read(file)
    assert str(refused.value.key).startswith(named) and "sensors.toml" in str(refused.value)


def test_units_are_those_of_the_outputs(tmp_path: Path) -> None:
    file = tmp_path / "day.csv"
    for heading, units, wrong in (
        ("t [s],force [N],a [m/s²]", {"force": "N", "a": "m/s^2"}, ""),
        ("t [s],force [N],a [mm]", {"force": "N", "a": "mm"}, ""),  # a probe's displacement
        ("t [s],force [N],a [mm]", {"force": "N", "a": "m"}, "a [mm]"),
        ("t [s],force [m],a [m/s²]", {"force": "N", "a": "m/s^2"}, "force [m]"),
        ("t [Hz],force [N],a", {}, "t [Hz]"),
    ):
        file.write_text(f"{heading}\n0.1,1,2\n0.2,2,3\n")
        if wrong:
            with pytest.raises(InputError) as refused:
                read_measurements(file, units)
            assert refused.value.value == wrong
        else:
            assert list(read_measurements(file, units)) == ["force", "a"]


def test_few_measurements_have_no_whiteness_and_a_sensor_alone_is_not_left_out(tmp_path: Path) -> None:
    model, rng = oscillator(60), np.random.default_rng(1)
    sensors = [Sensor(OUTPUTS[0], 0.05), Sensor(OUTPUTS[1], 1e-5), Sensor(OUTPUTS[2], 500.0)]
    every = measured(model, history(model, np.ones(60)), np.array([0.05, 1e-5, 500.0]), rng)
    for of_sensor in ({}, {OUTPUTS[1]: 1}, {OUTPUTS[1]: 6}):
        few = {name: (every[name][0][:n], every[name][1][:n]) for name, n in of_sensor.items()}
        data = {OUTPUTS[0]: every[OUTPUTS[0]], **few}
        observation = Observation.compute(Observer(model, sensors), data, leave_out=True)
        _, figures = observation.write(tmp_path)
        summary = json.loads(figures.read_text())
        assert [name for name, p in summary["whiteness"].items() if p is not None] == [OUTPUTS[0]]
        assert (OUTPUTS[0] in summary["without_sensor"]) == bool(few)


def test_a_payload_has_the_gravity_of_its_scene(tmp_path: Path) -> None:
    file, scene = tmp_path / "sensors.toml", pmr.load_scene("boom_three", [*BOOM, "gravity.inclination=30.0"])
    file.write_text(FILE)
    with pytest.raises(InputError, match=r"payload.gravity = 9.80665: 8.49281 m/s\^2 is allowed"):
        ObserverFile.read(file).observer(scene, pmr.System({}, ()), {})


def test_a_longer_step_has_a_larger_error() -> None:
    model, summary = oscillator(5), {"step": {"tip": 1e-5}}
    assert output_errors(summary, model, H / 4.0)["step"]["tip"] == pytest.approx(1.6e-4)


def test_it_is_written_which_sensor_matters(tmp_path: Path) -> None:
    model, rng = oscillator(150), np.random.default_rng(1)
    y = history(model, 60.0 * rng.standard_normal(150))
    sensors = [Sensor(OUTPUTS[0], 0.05), Sensor(OUTPUTS[1], 1e-5), Sensor(OUTPUTS[2], 500.0)]
    data = measured(model, y, np.array([0.05, 1e-5, 500.0]), rng)
    observation = Observation.compute(Observer(model, sensors, [UnknownLoad("push", 60.0, 1e-3)]), data, leave_out=True)
    table, figures = observation.write(tmp_path)
    summary = json.loads(figures.read_text())
    without = summary["without_sensor"]
    assert without[OUTPUTS[1]]["tip"] > 5.0 > 1.2 > without[OUTPUTS[2]]["tip"] >= 1.0
    assert summary["not_covered"] == sorted(OUTPUTS) and summary["observability"]["push"] < 1.0
    with table.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 150 and float(rows[-1]["tip [m]"]) == pytest.approx(summary["last"]["tip"]["mean"], rel=1e-6)
    assert float(rows[9][f"measured {OUTPUTS[1]}"]) == pytest.approx(data[OUTPUTS[1]][1][9], rel=1e-6)


@pytest.mark.slow
def test_the_command_estimates_a_payload(tmp_path: Path, undrawn: None, run_command) -> None:
    """Measured is the motion of a boom with 60 kg more, marched by itself."""
    heavy = pmr.load_scene("boom_three", [*BOOM, "sections.fly.masses=[{name='payload',on='tip',mass=310.0}]"])
    response = pmr.simulate(heavy, pmr.reduce(heavy).reduced)
    names = [each.name for each in response.outputs]
    tip, force = (response.column(names.index(name)) for name in ("fly: tip z", "base: force of cylinder"))
    acceleration = np.gradient(np.gradient(tip, response.t), response.t)
    with (tmp_path / "day.csv").open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(["t", "acceleration of fly: tip z", "base: force of cylinder"])
        writer.writerows(np.column_stack([response.t, acceleration, force])[3:-3].tolist())
    (tmp_path / "sensors.toml").write_text(FILE)
    rows = [f"{t!r},60.0,{y!r}" for t, y in zip(response.t.tolist(), tip.tolist(), strict=True)]
    (tmp_path / "true.csv").write_text("\n".join(["t,payload [kg],fly: tip z [m]", *rows]))
    pmr.reduce(pmr.load_scene("boom_three", BOOM)).system.save(tmp_path / "system.npz")
    files = ["--measured", str(tmp_path / "day.csv"), "--observer", str(tmp_path / "sensors.toml")]
    files += ["--out", str(tmp_path / "out"), "--scene", "boom_three", "--truth", str(tmp_path / "true.csv")]
    changes = [part for change in BOOM for part in ("--set", change)]
    done = run_command("observe", str(tmp_path / "system.npz"), *files, *changes)
    assert done.returncode == 0, done.stderr
    figures = json.loads((tmp_path / "out" / "observe.json").read_text())
    last, shares = figures["last"], figures["coverage"]
    assert shares.keys() == {"payload", "fly: tip z"} and shares["payload"] > 0.8
    assert "of the true values lie" in (tmp_path / "out" / "report.html").read_text()
    assert abs(last["payload"]["mean"] - 60.0) < 0.5 and last["payload"]["deviation"] < 5.0
    assert abs(last["fly: tip z"]["mean"] / tip[-1] - 1.0) < 1e-3
    (tmp_path / "sensors.toml").write_text(FILE.replace("fly: tip z", "fly: tip x"))
    refused = run_command("observe", str(tmp_path / "system.npz"), *files, *changes)
    assert refused.returncode == 2 and "fly: tip x" in refused.stderr
    (tmp_path / "summary.json").write_text("{")
    refused = run_command("observe", str(tmp_path / "system.npz"), *files, *changes)
    assert refused.returncode == 2 and "summary.json: JSON is allowed: Expecting property" in refused.stderr


def test_faults_are_said_with_their_times() -> None:
    figures = {"first_alarm": {"tip": 2.0}, "excluded": {"tip": [[2.25, 5.5], [7.0, None]]}, "payload_drift": 4.0}
    t = np.array([0.0, 8.0])
    assert describe_faults({**figures, "beyond": {"tip": 3}}, t) == [
        "tip disagrees with the model, is stuck or silent from 2 s on",
        "tip was at fault and was not used from 2.25 s to 5.5 s, from 7 s on",
        "the payload's estimate drifts at 4 s: the payload changes, or a sensor has an error that grows slowly",
        "3 measured values of tip are not used, beyond the times of the scene's motion, 0 to 8 s",
    ]
    assert describe_faults({"first_alarm": {}, "excluded": {}, "payload_drift": None, "beyond": {}}, t) == []


def test_values_beyond_the_motion_are_counted(tmp_path: Path) -> None:
    model = oscillator(60)
    t, y = np.arange(90) * H, np.sin(np.arange(90.0))  # from 0 s on; the model's steps are 0.01 s to 0.6 s
    y[[65, 70]] = np.nan  # nothing was measured
    observer = Observer(model, [Sensor(OUTPUTS[0], 0.05), Sensor(OUTPUTS[1], 1e-5)])
    data = {OUTPUTS[0]: (t, y), OUTPUTS[1]: (t[:62], y[:62])}
    _, figures = Observation.compute(observer, data).write(tmp_path)
    summary = json.loads(figures.read_text())
    assert summary["beyond"] == {OUTPUTS[0]: 27, OUTPUTS[1]: 1}
    assert summary["faults"][-2].startswith(f"27 measured values of {OUTPUTS[0]} are not used")
