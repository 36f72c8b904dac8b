"""The tutorials do what they say: their commands run in order, and the figures on the page are those that come out."""

import csv
import json
import re
import shlex
from collections.abc import Callable
from pathlib import Path

import pytest
from processes import called, python

from pmr.compare.model_part import largest_model_error
from pmr.report.trust import wall_stress_error

PAGES = Path(__file__).parents[1] / "docs" / "tutorials"


def blocks(page: str, language: str = "") -> list[str]:
    fences = re.findall(r"^```(\w*)\n(.*?)^```$", (PAGES / page).read_text(), flags=re.S | re.M)
    return [text for name, text in fences if name == language]


#: For studies: a worker takes seconds to start.
ONE_WORKER = ["--jobs", "1"]
#: Runs of which the page shows no figure need not last.
SHORT = {"reports/heavy": ["--set", "time.end=0.1"], "payloads.toml": ["--set", "change.time.end=0.1", *ONE_WORKER]}
#: Runs of which the page doesn't say what their mesh and model are off by.
NOT_MEASURED = re.compile("reports/(heavy|both_ways|first_order|fields)|payloads.toml")


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_the_first_boom(
    tmp_path: Path, unmeasured: Callable[..., None], monkeypatch: pytest.MonkeyPatch, run_command
) -> None:
    page = (PAGES / "first_boom.md").read_text()
    (study,) = blocks("first_boom.md", "toml")
    (tmp_path / "payloads.toml").write_text(study)
    monkeypatch.chdir(tmp_path)
    for block in blocks("first_boom.md"):
        asked, *answer = block.splitlines()
        refused, command = asked.startswith("$ "), shlex.split(asked.removeprefix("$ "))
        command += next((short for name, short in SHORT.items() if name in asked), [])
        unmeasured(NOT_MEASURED.search(asked) is not None, workers=asked.startswith("pmr study"))
        done = run_command(*command[1:])
        assert done.returncode == (2 if refused else 0), done.stderr
        if refused:
            assert done.stderr.split() == " ".join(answer).split()
    said = json.loads((tmp_path / "reports" / "mine" / "summary.json").read_text())
    shown = {
        key: float(value) for key, value in re.findall(r"^\| reduced against full \| (.+?) \| (\S+) %", page, re.M)
    }
    errors = said["errors"]["reduced_vs_full"]
    found = {"tip": errors["tip"], "beam": errors["beam"], "pad forces": errors["pad_force"]}
    assert shown == {name: pytest.approx(100.0 * value, rel=5e-3) for name, value in found.items()}
    assert f"{1e3 * said['max_displacement']:.3f} mm" in page
    assert f"{100.0 * said['estimate']['tip']:.3g} % at the tip" in page
    assert said["warnings"] == []
    model, mesh = said["budget"]["model"], said["budget"]["mesh"]
    assert largest_model_error(model) <= 0.03 and f"differs by {100.0 * model['beam']:.1f} %" in page
    assert max(mesh[what] for what in ("tip", "beam", "pad_force")) <= 0.05
    assert f"differs by {100.0 * mesh['beam']:.1f} %" in page
    both = json.loads((tmp_path / "reports" / "both_ways" / "summary.json").read_text())
    for summary, pulling in ((said, 0), (both, 1)):
        assert f"{1e-3 * max(pad['max'] for pad in summary['pads']):.2f} kN" in page
        assert sum(" pulls " in line for line in summary["warnings"]) == pulling
    assert said["coordinates"] == {"full": 388, "reduced": 8}
    stress = json.loads((tmp_path / "reports" / "stress" / "summary.json").read_text())
    assert f"{stress['coordinates']['full']:,}" in page
    assert stress["max_von_mises"]["reduced"] == pytest.approx(74.1e6, rel=0.01)
    assert (tmp_path / "reports" / "payloads" / "runs.csv").read_text().count("\n") == 4


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_crane_from_an_empty_folder(
    tmp_path: Path, unmeasured: Callable[..., None], monkeypatch: pytest.MonkeyPatch, run_command
) -> None:
    page = (PAGES / "crane.md").read_text()
    monkeypatch.chdir(tmp_path)
    for block in blocks("crane.md"):
        asked, *answer = block.splitlines()
        refused, command = asked.startswith("$ "), shlex.split(asked.removeprefix("$ "))
        command += ["--set", "time.end=0.5"] if "reports/fields" in asked else []
        unmeasured(NOT_MEASURED.search(asked) is not None, workers=asked.startswith("pmr study"))
        done = run_command(*command[1:])
        assert done.returncode == (2 if refused else 0), done.stderr
        if refused:
            assert done.stderr.split() == " ".join(answer).split()
    written = (tmp_path / "mine" / "scene.toml").read_text()
    for shown in blocks("crane.md", "toml"):
        assert all(line.split("  #")[0] in written for line in shown.splitlines())
    folder = tmp_path / "reports"
    first, second = (json.loads((folder / name / "summary.json").read_text()) for name in ("mine", "first_order"))
    errors = first["errors"]["reduced_vs_full"]
    for what, kind in (("tip", "tip"), ("pad forces", "pad_force")):
        shown = re.search(rf"^\| reduced against full \| {what} \| (\S+) %", page, re.M)
        assert shown and float(shown[1]) == pytest.approx(100.0 * errors[kind], rel=5e-3)
    assert f"{first['coordinates']['reduced']} coordinates stand for {first['coordinates']['full']}" in page
    assert page.count(f"{1e3 * first['max_displacement']:.2f} mm") == 2
    assert f"{1e3 * second['max_displacement']:.2f} mm instead" in page
    assert first["warnings"] == []
    model, mesh = first["budget"]["model"], first["budget"]["mesh"]
    assert largest_model_error(model) <= 0.03 and f"within {100.0 * largest_model_error(model):.2f} %" in page
    largest = max(error for error in mesh.values() if isinstance(error, float))  # "probes" has them by name
    assert largest <= 0.05 and f"by up to {100.0 * largest:.1f} %" in page
    walls, beams = model["wall_stress"]["value"], first["max_von_mises"]["reduced"]
    assert f"the {1e-6 * model['wall_stress']['even']:.0f} MPa that the walls have" in page
    assert f"{1e-6 * walls:.0f} MPa in walls" in page and f"{1e-6 * beams:.0f} MPa of the beams" in page
    assert f"the pad forces, is {1e-6 * walls * (wall_stress_error(first) or 0.0):.0f} MPa." in " ".join(page.split())
    luffing = first["luffing_cylinder"]["force"]
    assert f"up to {1e-3 * luffing['max']:.0f} kN, at {luffing['t_max']:.2f} s and a boom length" in page
    buckling = first["buckling"]
    assert f"by up to {100.0 * buckling['share']:.1f} %" in page
    assert f"{buckling['t']:.1f} s, all axial" in page and f"grow {buckling['factor']:.0f} times" in page
    assert (folder / "fields" / "fields.pvd").is_file()


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_load_chart_from_an_empty_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], run_command
) -> None:
    page, (study,) = " ".join((PAGES / "load_chart.md").read_text().split()), blocks("load_chart.md", "toml")
    (tmp_path / "chart.toml").write_text(study)
    monkeypatch.chdir(tmp_path)
    for block in blocks("load_chart.md"):
        command = shlex.split(block)[1:]
        if command[0] == "chart":  # its study is written, and computed as the other one
            with monkeypatch.context() as patch:
                patch.setattr("pmr.cli.study.study", lambda *_, **__: None)
                called(patch, capsys, *command)
            command = ["study", "reports/chart_mine/chart.toml", "--out", "reports/chart_mine"]
        command += [] if command[0] == "new" else [*ONE_WORKER, "--set", "error_bars=false"]  # shells beside beams
        done = run_command(*command)
        assert done.returncode == 0, done.stderr
    stable, found = (
        json.loads((tmp_path / "reports" / name / "summary.json").read_text()) for name in ("chart_mine", "chart")
    )
    assert (
        stable["figures"]["never.stability"] == stable["figures"]["points"] == 600
    )  # slewed by 0, 45, ..., 180 degrees
    ends = [f"{name} {end}" for name in ("middle", "fly") for end in ("tail", "mouth")]
    walls = sum(stable["figures"][f"governs.walls at pads of {end}"] for end in ends)
    points, cylinder = stable["figures"]["points"], stable["figures"]["governs.luffing cylinder"]
    assert f"Walls at pads govern at {walls} of its {points} points, because" in page
    assert f"The luffing cylinder governs at the other {cylinder}." in page and walls + cylinder == points
    with (tmp_path / "reports" / "chart_mine" / "chart.csv").open() as file:
        rows_of_chart = list(csv.DictReader(file))
    carried = sorted((float(row["load [kg]"]), float(row["radius [m]"])) for row in rows_of_chart)
    least, radius = carried[0]
    assert (
        f"crane carries {int(least):,} kg at a radius of {radius:.1f} m, and up to {int(carried[-1][0]):,} kg where"
        in page
    )
    assert radius == max(float(row["radius [m]"]) for row in rows_of_chart)
    tips, slewing, at = min(
        (float(row["tipping [kg]"]), row["slewing [degrees]"], float(row["radius [m]"]))
        for row in rows_of_chart
        if row["tipping [kg]"]
    )
    assert slewing == "180" and at == radius and f"would limit the load to {1e-3 * tips:.1f} t." in page
    figures = found["figures"]
    assert f"at {figures['governs.luffing cylinder']} of {figures['points']} points" in page
    assert f"tipping at {figures['governs.tipping']}, the deflection of the tip at {figures['governs.tip']}." in page
    assert figures["governs.pads"] == 0
    with (tmp_path / "reports" / "chart" / "chart.csv").open() as file:
        rows = {row["radius [m]"]: row for row in csv.DictReader(file)}
    loads = [round(float(row["load [kg]"])) for row in rows.values()]
    assert f"carries {min(loads):,.0f} kg to {max(loads):,.0f} kg" in page
    tipping = round(float(rows["15"]["tipping [kg]"]))
    assert f"it carries {round(float(rows['15']['load [kg]'])):,} kg; the deflection of the tip limits it" in page
    assert f"{tipping:,} kg." in page
    (code,), (shown,) = blocks("load_chart.md", "python"), blocks("load_chart.md", "text")
    by_hand = python("-c", code, cwd=tmp_path)
    assert by_hand.stdout == shown and f"{tipping} kg\n" == shown
