"""The play of pads in the error bars of a load chart, beside charts and runs at rest of booms that have this play."""

import csv
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from finished import finished
from fuzz import toml
from ways.kinds import RAISED, boom, rings

import pmr
from pmr.report.studies import render_studies
from pmr.report.studies.chart import covered_parts
from pmr.report.studies.chart_tables import present_parts
from pmr.scene import load_any
from pmr.studies import call
from pmr.studies.charting import PARTS
from pmr.studies.study import StudyResults

pytestmark = pytest.mark.slow

EXTENSION, ANGLE, SIDE, GAP = 1.2, 0.3, 400.0, 1e-3  # m, rad, N, m
FACES = {"bottom": [-0.06, 0.06], "top": [-0.06, 0.06], "left": [-0.1, 0.1], "right": [-0.1, 0.1]}
LIMITS = [{"name": "tip", "of": "deflection", "most": 0.02}, {"name": "pads", "of": "pad", "most": 20e3}]
STUDY: dict[str, Any] = {
    "kind": "chart", "title": "Boxes with play", "scene": "scene.toml", "up_to": 6000.0, "extensions": [EXTENSION],
    "luffing": [ANGLE], "limits": LIMITS, "cases": [{"name": "wind", "loads": {"F": SIDE}}],
}  # fmt: skip


def scene_text(clearance: float = 0.0, **ring: Any) -> str:
    """Scene of two boxes that a load pushes to the side, on pads that only push; all `clearance` is at top and left."""
    keys = {"faces": FACES, "unilateral": True} | ring
    gaps = {"clearance": {"top": clearance, "left": clearance}} if clearance else {}
    scene = boom("Two boxes", "beam3d", rings(**keys, **gaps), lengths=2.0, elements=10)
    fly = scene["sections"][-1]
    fly["masses"] = []
    fly["loads"][0] |= {"direction": "y", "signal": {"kind": "constant", "amount": SIDE}}
    scene["section"]["joint"]["extension"] = {"kind": "constant", "amount": EXTENSION}
    frame = RAISED | {"luffing": {"kind": "constant", "amount": ANGLE}}
    compare = {"against": [], "richer": "none"} | ({"play": GAP} if keys["unilateral"] and not gaps else {})
    return toml.written(scene | {"frame": frame, "compare": compare, "start": "equilibrium", "gravity": {}})


def chart(folder: Path, scene: str, **keys: Any) -> StudyResults:
    (folder / "scene.toml").write_text(scene)
    return finished(folder, toml.written(STUDY | keys))


def row(folder: Path) -> dict[str, str]:
    (only,) = csv.DictReader((folder / "chart.csv").read_text().splitlines())
    return only


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("chart")


@pytest.fixture(scope="module")
def with_bars(folder: Path) -> StudyResults:
    return chart(folder, scene_text())


def test_the_part_is_what_the_play_of_another_boom_changes(
    with_bars: StudyResults, folder: Path, tmp_path: Path
) -> None:
    """A chart of the boom with this clearance allows other loads, which differ by this part; the bar contains it."""
    arrays = with_bars.arrays("row1")
    load, error = arrays["load"][0, :2], arrays["error.play"][0, :2]
    assert "play beyond error bars" in dict(arrays["at.left_out"])["pads"]
    with_play = chart(tmp_path, scene_text(GAP), error_bars=False).arrays("row1")["load"][0, :2]
    assert error == pytest.approx(np.abs(with_play - load), rel=1e-6) and np.all(
        error > [0.2 * load[0], 5e-4 * load[1]]
    )
    assert np.all(arrays["error"][0, :2] > error)
    parts = [np.nan_to_num(arrays[f"error.{of}"][0]) for of in PARTS]
    assert arrays["error"][0] == pytest.approx(np.sum(parts, axis=0), rel=1e-12)
    assert float(row(folder)["lower bound [kg]"]) <= min(load - error)


def test_a_run_at_rest_with_this_clearance_reaches_the_limit_under_the_load_less_this_part(
    with_bars: StudyResults, tmp_path: Path
) -> None:
    arrays = with_bars.arrays("row1")
    (tmp_path / "scene.toml").write_text(scene_text(GAP))
    for load, reaches in ((arrays["load"] - arrays["error.play"], True), (arrays["load"], False)):
        hung = {"name": "hook", "on": "tip", "mass": float(load[0, 0])}
        outcome = pmr.run(load_any(tmp_path / "scene.toml", [f"sections.fly.masses=[{toml.value(hung)}]"]))
        assert outcome is not None
        tip = [outcome.result.responses["reduced"].of("tip", direction=axis)[0, -1] for axis in "yz"]
        assert (np.linalg.norm(tip) == pytest.approx(0.02, rel=1e-3)) == reaches


def test_the_play_of_the_scene_is_taken_away(folder: Path, with_bars: StudyResults, tmp_path: Path) -> None:
    arrays = chart(tmp_path, scene_text(GAP)).arrays("row1")
    without = with_bars.arrays("row1")["load"][0, :2]
    assert arrays["error.play"][0, :2] == pytest.approx(np.abs(without - arrays["load"][0, :2]), rel=1e-6)
    assert "the change of loads without play" in render_studies(tmp_path)


@pytest.mark.parametrize("has_play", [True, False])
def test_no_play_is_left_out_and_pads_that_hold_both_ways_have_none(tmp_path: Path, has_play: bool) -> None:
    arrays = chart(tmp_path, scene_text(unilateral=has_play), change={"compare": {"play": 0.0}}).arrays("row1")
    assert np.isnan(arrays["error.play"]).all() and np.isfinite(arrays["error"]).all()
    assert ("the play of pads: compare.play = 0" in row(tmp_path)["not covered"]) == has_play
    page = render_studies(tmp_path)
    assert "sum of four parts" in page and "play of pads</th>" not in page and "without model" in page


def test_points_whose_play_no_load_takes_up_are_counted_over_all_rows(tmp_path: Path) -> None:
    """A boom that stands upright has no weight that presses pads on top of its tail and below its mouth."""
    out = 'kind = "smooth_ramp", times = [0.0, 0.05], values = [1.0, 1.2]'
    tail, mouth = scene_text().replace('kind = "constant", amount = 1.2', out).rsplit("mouth", 1)
    scene = tail.replace("bottom = [-0.06, 0.06], ", "") + "mouth" + mouth.replace("top = [-0.06, 0.06], ", "")
    results = chart(tmp_path, scene, luffing=[ANGLE, np.pi / 2], extensions=[1.0, EXTENSION])
    loose = "the play of pads that no load takes up"
    told = [row["not covered"] for row in csv.DictReader((tmp_path / "chart.csv").read_text().splitlines())]
    assert [text.endswith(loose) for text in told] == [False, True, False, True]
    assert f"{loose} at 2 of 4 points" in render_studies(tmp_path)
    study = call.load(tmp_path / "study.toml").parts[0].study
    assert study.summary_line(results).endswith(f"{loose} at 2 of 4 points")


def test_the_page_has_the_play_and_a_chart_of_an_earlier_version_is_drawn_without_it(
    with_bars: StudyResults, folder: Path
) -> None:
    page, arrays = render_studies(folder), dict(with_bars.arrays("row1"))
    assert "sum of five parts" in page and "another play of pads" in page and "1 mm of play from face to face" in page
    assert re.search(r"<th[^>]*>play of pads</th>", page)
    assert covered_parts([arrays]) == "reduction, mesh, rotations, play; without model"
    arrays.pop("error.play")
    assert covered_parts([arrays]) == "reduction, mesh, rotations; without model"
    assert present_parts([arrays]) == [*PARTS[:-1]]
