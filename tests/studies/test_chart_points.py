"""What a load chart says of its model and warns of, beside full order and a run of the same boom at rest."""

import csv
import json
import re
import tomllib
from pathlib import Path

import numpy as np
import plain_machines
import pytest
from finished import finished
from fuzz import toml
from ways.kinds import RAISED, SPACE, boom, rings

import pmr
from pmr.errors import two_digits
from pmr.report.studies import render_studies
from pmr.report.studies.chart import covered_parts
from pmr.scene import load_any
from pmr.scene.model_ladder import model_comparison
from pmr.simulation.statics.postures import HOISTED, PostureMatrices, PostureSet, with_hook, with_winds
from pmr.studies import tasks
from pmr.studies.allowed import Place, allowed_loads
from pmr.studies.chart_models import compute_richer_postures
from pmr.studies.chart_points import replaced_mass_warnings, unnamed_loads
from pmr.studies.charting import PARTS
from pmr.studies.kinds.chart import Study
from pmr.studies.limits import Limit
from pmr.studies.study import StudyResults
from pmr.studies.tasks import scene_arguments

pytestmark = pytest.mark.slow

EXTENSION, ANGLE, UP_TO = 1.2, 0.3, 2000.0
LIMITS = [{"name": "tip", "of": "deflection", "most": 0.01}, {"name": "pads", "of": "pad", "most": 20e3}]
STUDY = {
    "kind": "chart", "title": "Two thin boxes", "scene": "scene.toml", "up_to": UP_TO, "extensions": [EXTENSION],
    "luffing": [ANGLE], "limits": LIMITS,
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two boxes of 2 m with thin rigid walls, on pads that hold both ways."""
    found = tmp_path_factory.mktemp("chart")
    scene = boom("Two boxes", "beam3d", rings(faces=SPACE), lengths=2.0, elements=10, size=0.2, along=0.4)
    scene["sections"][-1]["masses"] = []
    scene["sections"][-1]["loads"][0]["signal"] = {"kind": "constant", "amount": 0.0}
    for part in scene["sections"]:
        part["body"]["box"]["wall"] = 0.004
    for joint in (scene["section"]["joint"],):
        joint["extension"] = {"kind": "constant", "amount": EXTENSION}
    frame = RAISED | {"luffing": {"kind": "constant", "amount": ANGLE}}
    compare = {"against": [], "model_tolerance": 0.01}
    described = scene | {"frame": frame, "compare": compare, "start": "equilibrium", "gravity": {}}
    (found / "scene.toml").write_text(toml.written(described))
    return found


@pytest.fixture(scope="module")
def chart(folder: Path) -> StudyResults:
    return finished(folder, toml.written(STUDY))


def test_the_bar_has_the_structural_model(chart: StudyResults, folder: Path) -> None:
    """Shells of full order allow what the chart's own load and the model's part of its bar say."""
    (row,) = csv.DictReader((folder / "chart.csv").read_text().splitlines())
    arrays = chart.arrays("row1")
    _, other, called = model_comparison(with_hook(load_any(folder / "scene.toml")))
    at = PostureSet({"fly": np.array([EXTENSION])}, np.array([ANGLE]), np.zeros(1))
    full = tasks.full_system(other)
    postures = PostureMatrices.from_scene(other, full, at)
    place = Place(postures, 0, [float(part not in ("F", HOISTED)) for part in postures.loads.names], 9.80665)
    loads = allowed_loads([Limit.model_validate(one) for one in LIMITS], place, UP_TO)
    assert called == "coarse shell" and "structural model" not in row["not covered"]
    for n, limit in enumerate(LIMITS):
        own, error = arrays["load"][0, n], arrays["error.model"][0, n]
        assert error > 0.01 * own
        assert min(abs(own - error - loads[n]), abs(own + error - loads[n])) < 0.03 * error
        assert float(row[f"{limit['name']} error [kg]"]) >= error
    assert float(row["lower bound [kg]"]) <= min(arrays["load"][0, :2] - arrays["error.model"][0, :2])
    page = render_studies(folder)
    assert "structural model, from shells" in page and "reduction, mesh, model, rotations" in page
    bounds = "Errors that error bars do not contain: "
    assert f"{bounds}{row['not covered']}." in page


def test_a_chart_names_the_pad_that_governs(folder: Path, tmp_path: Path) -> None:
    """It is the one that a run under this load presses the most."""
    limits = [{"name": "pads", "of": "pad", "most": 5e3}]
    (tmp_path / "scene.toml").write_text((folder / "scene.toml").read_text())
    finished(tmp_path, toml.written(STUDY | {"error_bars": False, "limits": limits}))
    (row,) = csv.DictReader((tmp_path / "chart.csv").read_text().splitlines())
    hung = {"name": "hook", "on": "tip", "mass": float(row["load [kg]"])}
    outcome = pmr.run(load_any(folder / "scene.toml", [f"sections.fly.masses=[{toml.value(hung)}]"]))
    assert outcome is not None and row["governed by"] == "pads"
    pads = {pad["name"]: max(-pad["min"], pad["max"]) for pad in outcome.result.summary["pads"]}
    greatest = [name for name, force in pads.items() if force > (1.0 - 1e-6) * max(pads.values())]  # left and right
    assert max(pads.values()) == pytest.approx(5e3, rel=0.01) and row["governing member"] in greatest
    assert f"this limit governs: pads ({row['governing member']})" in render_studies(tmp_path)


def test_the_box_of_the_error_bar_names_what_it_lacks() -> None:
    """The model is unknown for the limit that governs, and the mesh for one that does not."""
    parts = {"load": np.array([[1.0, 2.0]])} | {f"error.{of}": np.zeros((1, 2)) for of in PARTS}
    parts["error.model"][0, 0] = parts["error.mesh"][0, 1] = np.nan
    assert covered_parts([parts]) == "reduction, mesh, rotations, play; without model"


def test_a_chart_warns_as_a_run_of_the_boom_at_rest_does(chart: StudyResults, folder: Path) -> None:
    """Of pads that pull, under the load and by how much, and of the model, in the table, the summary and the report."""
    (record,) = chart.runs
    load = chart.arrays("row1")["load"][0, :2].min()
    hung = {"name": "hook", "on": "tip", "mass": float(load)}
    outcome = pmr.run(load_any(folder / "scene.toml", [f"sections.fly.masses=[{toml.value(hung)}]"]))
    assert outcome is not None
    (pull,) = [one for one in outcome.result.summary["warnings"] if "holds both ways and pulls" in one]
    (said,) = [one for one in record.warnings if "holds both ways and pulls" in one]
    of = re.compile(r"the pad (.*) holds both ways and pulls with up to ([\d.]+) kN")
    (name, force), (of_run, force_of_run) = (of.search(one).groups() for one in (said, pull))
    assert name == of_run and float(force) == pytest.approx(float(force_of_run), rel=0.01)
    assert (
        f"at a boom length of {2.0 + EXTENSION:g} m, raised {np.rad2deg(ANGLE):.4g} degrees, under {load:.4g} kg"
        in said
    )
    arrays = chart.arrays("row1")
    share = arrays["error.model"][0, :2] / arrays["load"][0, :2]
    governs = int(arrays["load"][0, :2].argmin())
    (off,) = [one for one in record.warnings if one.startswith("the model is off by up to")]
    assert f"{two_digits(100.0 * share[governs])} % in the load that {LIMITS[governs]['name']} allows" in off
    assert "its error bar contains this" in off
    (row,) = csv.DictReader((folder / "runs.csv").read_text().splitlines())
    assert row["warnings"] == " | ".join(record.warnings)
    (run,) = json.loads((folder / "summary.json").read_text())["runs"]
    assert run["warnings"] == list(record.warnings)
    assert all(one[:1].upper() + one[1:].partition(" =")[0] in render_studies(folder) for one in record.warnings)


def test_a_chart_names_loads_of_runs_that_no_case_has(folder: Path) -> None:
    described = tomllib.loads((folder / "scene.toml").read_text())
    described["sections"][-1]["loads"][0]["signal"]["amount"] = 300.0
    (folder / "windy.toml").write_text(toml.written(described))
    name = load_any(folder / "windy.toml").sections[-1].loads[0].name
    quick = STUDY | {"scene": "windy.toml", "error_bars": False}
    for cases, warned in (
        ([{"name": "rest"}], True),
        ([{"name": "rest"}, {"name": "wind", "loads": {name: 0.0}}], False),
    ):
        (run,) = finished(folder, toml.written(quick | {"cases": cases})).runs
        assert (
            any(f"the scene's load {name} is in no load case, so not in this chart" in line for line in run.warnings)
            is warned
        )


def test_wind_of_a_case_stands_for_that_of_the_scene() -> None:
    own = ['sections.fly.loads=[{name="storm",acts="wind",signal=100.0}]']
    blown = with_winds(load_any(plain_machines.CRANE, own), {"wind": (0.0, 1.6)})
    assert unnamed_loads(blown, [{"loads": {"wind": 122.5}}]) == ("", True)
    line, has_wind = unnamed_loads(blown, [{"loads": {}}])
    assert line and not has_wind


@pytest.mark.parametrize(("at", "offset"), [([2.0, 0.4, 0.0], "(0, 0.4, 0)"), ([2.5, 0.0, 0.0], "(0.5, 0, 0)")])
def test_a_chart_says_that_its_load_is_not_beside_the_axis_as_the_mass_in_its_place_was(
    folder: Path, at: list[float], offset: str
) -> None:
    described = tomllib.loads((folder / "scene.toml").read_text())
    described["sections"][-1]["masses"] = [
        {"name": "hook", "on": "tip", "mass": 100.0, "at": at},
        {"name": "light", "on": "tip", "mass": 1.0},
    ]
    (folder / "beside.toml").write_text(toml.written(described))
    original = load_any(folder / "beside.toml")
    (line,) = replaced_mass_warnings(original, load_any(folder / "scene.toml"))
    assert f"mass 'hook', in whose place the chart's load acts, is {offset} m from that load" in line
    assert line.endswith(f"point = [{', '.join(f'{x:g}' for x in at)}] in the study takes them along")
    assert replaced_mass_warnings(original, original) == []
    assert replaced_mass_warnings(original, load_any(folder / "scene.toml"), tuple(at)) == []
    keys = {"scene": str(folder / "beside.toml"), "change": {"sections": {"fly": {"masses": []}}}}
    (row, *_) = Study.model_validate(STUDY | keys).plan().runs
    assert row.arguments["warnings"] == [line]


def test_without_a_richer_model_the_reason_is_said(folder: Path) -> None:
    scene = load_any(folder / "scene.toml", ["section.body.model=shell"])
    at = {"extensions": {"fly": [EXTENSION]}, "luffing": [ANGLE], "slewing": [0.0]}
    arrays = compute_richer_postures(scene_arguments(with_hook(scene)) | {"at": at}, {}).arrays
    assert "a shell is the richest model there is" in str(arrays["reason"]) and "model.structure.K" not in arrays


def test_the_bar_has_the_mesh_where_walls_give(folder: Path, tmp_path: Path) -> None:
    """On cells half as long the chart allows loads within the mesh's part of its bar."""
    (tmp_path / "scene.toml").write_text((folder / "scene.toml").read_text())
    results = []
    for size, bars in ((0.16, True), (0.08, False)):
        section = {"body": {"walls": "give"}, "mesh": {"size": size, "along": 2.0 * size, "elements": int(1.6 / size)}}
        asked = STUDY | {"change": {"section": section}, "error_bars": bars}
        results.append(finished(tmp_path, toml.written(asked)).arrays("row1"))
    wide, fine = results
    assert "the mesh" not in str(wide["not_covered"][0])
    off, bar = np.abs(fine["load"][0] - wide["load"][0])[:2], wide["error.mesh"][0][:2]
    assert np.all(off > 0.0) and np.all(off <= bar)
