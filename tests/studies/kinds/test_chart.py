"""Load charts of a planar telescope, beside its full order; what is refused."""

import csv
import json
import re
from collections.abc import Mapping
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import plain_machines
import pytest
from finished import WORKFLOWS, finished
from numpy.typing import NDArray

from pmr import InputError
from pmr.errors.environment import plugin_objects
from pmr.report.blocks import END_OF_SCREEN, SCREEN
from pmr.report.document import _without_screen
from pmr.report.figures import HALF, WIDE
from pmr.report.studies import render_studies
from pmr.report.studies.chart import governing_pages
from pmr.report.studies.tables import FinishedStudy
from pmr.scene import load_any
from pmr.studies import call, tasks
from pmr.studies.call import Progress, compute_results, save
from pmr.studies.kinds.chart import Study
from pmr.studies.limits import Limit
from pmr.studies.load_cases import LoadCase
from pmr.studies.study import RunRecord, StudyResults
from pmr.studies.workers import local_pool
from pmr.system.from_scene import force_names

pytestmark = pytest.mark.slow

SCENE = Path(__file__).with_name("telescope.toml").read_text()
STUDY = """
kind = "chart"
title = "Chart of a telescope"
scene = "scene.toml"
up_to = 5000.0
extensions = { least = 1.0, most = 4.0, count = 3 }
luffing = { least = 0.0, most = 70.0, count = 4 }
stops = [{ of = "luffing", speed = 2.0, within = 0.6, class_factor = 1.5 }]
hoist = { speed = 0.4, rope_stiffness = 8e5, hoisting_class = "HC1" }

[[limits]]
name = "pads"
of = "pad"
most = 60e3
factor = 1.5
[[limits]]
name = "tip"
of = "deflection"
most = 0.4
[[limits]]
name = "buckling"
of = "buckling"
least = 3.0
[[limits]]
name = "cylinder"
of = "support"
most = 90e3
[[limits]]
name = "tipping"
of = "overturning"
polygon = [[2.0, 2.0], [-2.0, 2.0], [-2.0, -2.0], [2.0, -2.0]]
machine = [{ name = "carrier", mass = 6000.0, at = [-0.5, 0.0, 0.0] }]
[[limits]]
name = "frequency"
of = "frequency"
least = 0.2

[[cases]]
name = "calm"
[[cases]]
name = "gust"
standard = "a standard of mine"
hoisting_class = "HC2"
hoisting_speed = 0.5
wind = { speed = 20.0, density = 1.25, on = [{ load = "gust", area = 1.25, shape = -1.6 }] }
[[cases]]
name = "storm"
load = 0.0
wind = { speed = 40.0, on = [{ load = "gust", area = 1.25, shape = -1.6 }] }
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("chart")
    (found / "scene.toml").write_text(SCENE)
    return found


@pytest.fixture(scope="module")
def small(folder: Path) -> StudyResults:
    return finished(folder, STUDY)


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "chart.csv").open() as stream:
        return list(csv.DictReader(stream))


def test_the_table_has_the_least_load_and_the_limit_that_governs(small: StudyResults, folder: Path) -> None:
    found = rows(folder)
    assert len(found) == 12
    names = ("pads", "tip", "buckling", "cylinder", "tipping", "frequency", "stability")
    for row in found:
        own = {name: float(row[f"{name} [kg]"]) for name in names if row[f"{name} [kg]"]}
        assert row["governed by"] == min(own, key=lambda name: own[name])
        assert float(row["load [kg]"]) == min(own.values()) < 5000.0
        assert 0.0 <= float(row["lower bound [kg]"]) <= float(row["load [kg]"])
        assert row["case"] in ("calm", "gust")
    out = np.array([[float(row[f"{name} [kg]"]) for name in ("cylinder", "pads", "tipping")] for row in found[::4]])
    assert (np.diff(out, axis=0) < 0.0).all()  # level, the further out the less
    moved = [float(row["radius under load [m]"]) - float(row["radius [m]"]) for row in found]
    raised = [move for move, row in zip(moved, found, strict=True) if float(row["luffing [degrees]"]) > 0.0]
    assert all(move > 0.0 for move in raised)  # a boom that sinks is farther out
    most = json.loads((folder / "summary.json").read_text())["figures"]["outward.most"]
    assert max(moved) == pytest.approx(most) == pytest.approx(0.4 * np.sin(np.deg2rad(70.0)), rel=1e-6)  # of the tip
    assert np.hypot(float(found[-1]["radius [m]"]), float(found[-1]["height [m]"])) == pytest.approx(14.0)
    assert float(found[0]["radius [m]"]) == pytest.approx(8.0) and float(found[0]["height [m]"]) == 0.0


def test_rows_of_extensions_may_name_the_sections_in_any_order(tmp_path: Path) -> None:
    """Their columns were those of the first row's order."""
    written = STUDY.replace(
        "{ least = 1.0, most = 4.0, count = 3 }", "[{ middle = 1.5, fly = 3.0 }, { fly = 3.0, middle = 1.5 }]"
    ).replace("count = 4 }", "count = 1 }")
    (tmp_path / "scene.toml").write_text(SCENE)
    finished(tmp_path, "error_bars = false\n" + written)
    first, second = rows(tmp_path)
    assert first == second and float(first["extension middle [m]"]) == 1.5 and float(first["extension fly [m]"]) == 3.0


def test_the_factor_of_the_load_multiplies_the_weight_of_a_hoisted_mass(tmp_path: Path) -> None:
    """It takes (f - w) m / f from the load, with the factors f of the load and w of the boom's weight."""
    case = '[[cases]]\nname = "hoisting"\nweight = 1.1\nload = 1.4\n'
    static = STUDY[: STUDY.index('[[limits]]\nname = "frequency"')]  # a frequency does not follow from weights
    loads, words = list[np.ndarray](), list[str]()
    for hoisted in (", hoisted = true", ""):
        (tmp_path / "scene.toml").write_text(
            f'{SCENE}masses = [{{ name = "hook", on = "tip", mass = 150.0{hoisted} }}]\n'
        )
        results = finished(tmp_path, f"error_bars = false\n{static}{case}")
        loads.append(np.concatenate([results.arrays(run.key)["load"] for run in results.runs]))
        words.append(dict(results.arrays("row1")["at.definitions"])["load"])
    carries = loads[0] > 0.0
    assert carries.sum() > 30
    assert loads[0][carries] == pytest.approx(loads[1][carries] - 150.0 * 0.3 / 1.4, rel=1e-9)
    assert [text.rpartition("hook, 150 kg, with the factor of ")[2] for text in words] == [
        "the load", "the weight of the boom",
    ]  # fmt: skip


def test_a_hoisted_load_pulls_with_more_than_its_weight(small: StudyResults, folder: Path) -> None:
    """On any boom with less than on a tip that does not move; nothing is hoisted where nothing is carried."""
    figures, found = json.loads((folder / "summary.json").read_text())["figures"], rows(folder)
    factors = [float(row["hoisting factor"]) for row in found if row["hoisting factor"]]
    loads = [float(row["load [kg]"]) for row in found if row["hoisting factor"]]
    assert len(factors) == sum(float(row["load [kg]"]) > 0.0 for row in found) == 9
    assert all(1.0 < f < 1.0 + 0.4 * np.sqrt(8e5 / m) / 9.80665 for f, m in zip(factors, loads, strict=True))
    assert figures["hoist.most"] == pytest.approx(max(factors)) and figures["hoist.class"] == pytest.approx(1.118)
    page = unescape(render_studies(folder)).replace("\u00a0", " ")
    shown = page[page.index("Which motions are in the loads") :]
    assert (
        "in the loads, by the factor 1.27, of the class HC2 at 0.5 m/s (gust); beside the loads: hoisted off the "
        in shown
    )
    assert "times its weight, computed at each point without damping; class HC1 of EN 13001-2 has 1.12" in shown
    stop = (
        "a stop from 2 of the scene's unit a second within 0.6 s does at the points on the pages of limits, beside the "
    )
    assert f"not in the loads; beside the loads: what {stop}study's own factor 1.5" in shown


def test_what_is_met_at_no_load_or_never_is_told(small: StudyResults, folder: Path) -> None:
    """Far out the tip is too deep without any load; where nothing presses along the boom, nothing buckles it."""
    figures = json.loads((folder / "summary.json").read_text())["figures"]
    assert figures["at_no_load.tip"] == 3 and figures["at_no_load.pads"] == 0
    assert figures["never.stability"] == 12 and figures["never.cylinder"] == 0
    assert sum(figures[f"governs.{name}"] for name in ("tip", "cylinder")) == 12 == figures["points"]


def test_cases_are_made_of_classes_and_winds(small: StudyResults, folder: Path) -> None:
    """phi2 = 1.10 + 0.34 v, F = rho v^2 / 2 A c; out of service nothing hangs, and what it exceeds is named."""
    project = call.load(folder / "study.toml")
    study = project.parts[0].study
    assert isinstance(study, Study)
    calm, gust, storm = (case.acting_amounts(study.classes) for case in study.cases)
    assert calm["load"] == 1.0 and calm["loads"] == {}
    assert gust["load"] == pytest.approx(1.27) and gust["loads"] == {"gust": pytest.approx(-500.0)}
    assert storm["load"] == 0.0 and storm["loads"] == {"gust": pytest.approx(-2000.0)}
    found, figures = rows(folder), json.loads((folder / "summary.json").read_text())["figures"]
    passed = [row["storm, passed"] for row in found]
    assert figures["stands.storm"] == passed.count("none") and 0 < passed.count("none") < 12
    assert all("tip" in one for one, row in zip(passed, found, strict=True) if row["tip [kg]"] == "0")
    text = render_studies(folder)
    assert "a standard of mine" in text and "1.27 (HC2)" in text and "250" in text and "storm" in text


def test_error_bars_are_the_sum_of_their_parts(small: StudyResults, folder: Path) -> None:
    names = ("error", "error.reduction", "error.mesh", "error.rotation", "error.model")
    arrays = {n: np.concatenate([small.arrays(run.key)[n] for run in small.runs]) for n in names}
    parts = [arrays[f"error.{of}"] for of in ("reduction", "mesh", "rotation")]
    assert np.isnan(arrays["error.model"]).all()  # of beams that slide on points there are no shells
    assert np.isfinite(arrays["error"]).all() and (arrays["error"] == parts[0] + parts[1] + parts[2]).all()
    assert all((part >= 0.0).all() and (part > 0.0).any() for part in parts)
    assert "large rotations" in render_studies(folder)


def test_pages_of_governing_points_say_what_the_boom_does_there(small: StudyResults, folder: Path) -> None:
    """The limit is all used; pads carry what statics say; the tip is where the limit of deflection has it."""
    text = render_studies(folder)
    assert "If luffing at 2°/s stops within 0.6" in text and "own factor is 1.5" in text
    assert "Governed by cylinder<" in text and "Governed by pads<" not in text
    found = 0
    for run in small.runs:
        arrays = small.arrays(run.key)
        for n, k in enumerate(arrays["at.place"].tolist()):
            if k < 0:
                continue
            found += 1
            used = arrays["at.used"][n]
            factor, rest, steady, most, speed = arrays["at.stops"][n, 0]
            assert speed == pytest.approx(np.deg2rad(2.0)) and 0.1 < factor <= 2.2
            assert rest == pytest.approx(used[n]) and most > rest and steady > rest
            assert used[n] == pytest.approx(1.0, abs=1e-3) and (used <= used[n] + 1e-6).all()
            tip = arrays["at.bent"][n][(arrays["at.bent.section"] == 2) & (arrays["at.bent.x"] == 6.0)]
            assert float(np.linalg.norm(tip)) == pytest.approx(0.4 * used[1], rel=1e-6)
            names, forces = arrays["at.forces.names"].tolist(), arrays["at.forces"][n]
            pads = [float(f) for name, f in zip(names, forces, strict=True) if "tail" in name or "mouth" in name]
            assert max(map(abs, pads)) == pytest.approx(used[0] * 60e3 / 1.5, rel=1e-6)
    assert found >= 3


def test_pages_of_governing_points_name_the_slewing_angle_of_a_boom_that_slews(
    small: StudyResults, folder: Path
) -> None:
    study = FinishedStudy.load(folder)
    names = [*(str(limit["name"]) for limit in study.study_file["limits"]), "stability"]
    parts = [small.arrays(run.key) for run in small.runs]
    assert all(set(part["at.slewed"][part["at.place"] >= 0]) == {0.0} for part in parts)
    turned = [
        part | {"at.slewing": np.array([0.0, 90.0]), "at.slewed": np.full(len(names), np.pi / 2.0)} for part in parts
    ]
    for arrays, is_named in ((parts, False), (turned, True)):
        texts = [block.text for block in governing_pages(study, names, arrays, "chart")]
        assert texts and all(("°, slewed by 90°, " in text) is is_named for text in texts)


def test_cut_off_and_called_again_it_is_the_same_to_the_byte(folder: Path, tmp_path: Path) -> None:
    """By workers: what was there stays, what was not is computed, and the table is that of a chart made at once."""
    (folder / "resumed.toml").write_text(
        STUDY.replace("count = 4 }", "count = 1 }").replace("count = 3 }", "count = 4 }")
    )
    project, made, cut = call.load(folder / "resumed.toml"), tmp_path / "made", tmp_path / "cut"

    def leave(progress: Progress) -> None:
        if progress.done > 2:  # what all four rows need, and the first of them
            raise KeyboardInterrupt

    with local_pool(1) as pool, pytest.raises(KeyboardInterrupt):
        compute_results(project, cut, pool, leave)
    there = {file: file.stat().st_mtime_ns for file in (cut / "tasks").glob("*.npz")}
    assert 3 <= len(there) <= 4  # another row was on its way
    with local_pool(1) as pool:
        again = compute_results(project, cut, pool, lambda progress: None)
        save(project, again, cut)
        save(project, compute_results(project, made, pool, lambda progress: None), made)
    assert again.computed == 6 - len(there) and again.is_complete
    assert {file: file.stat().st_mtime_ns for file in there} == there
    assert (cut / "chart.csv").read_bytes() == (made / "chart.csv").read_bytes()


def test_a_row_whose_process_was_killed_is_missing_alone(small: StudyResults, folder: Path, tmp_path: Path) -> None:
    """The table has the points of the other rows; without any row an old table goes.

    The duty table goes with the first missing row: at its radii it would have the loads of shorter booms alone.
    """
    study, killed = call.load(folder / "study.toml").parts[0].study, RunRecord("row2", "failed", {}, {}, {}, "died")
    arrays = {run.key: small.arrays(run.key) for run in small.runs}

    class Partly(StudyResults):
        def arrays(self, key: str) -> Mapping[str, NDArray[Any]]:
            return arrays[key]

    whole = Partly(tmp_path, small.runs)
    whole.save({}, study.tables(whole))
    assert (tmp_path / "duty.csv").exists()
    partly = Partly(tmp_path, (small.runs[0], killed, small.runs[2]))
    partly.save({}, study.tables(partly))
    assert rows(tmp_path) == [*rows(folder)[:4], *rows(folder)[8:]] and not (tmp_path / "duty.csv").exists()
    nothing = Partly(tmp_path, tuple(replace(run, status="failed") for run in small.runs))
    nothing.save({}, study.tables(nothing))
    assert not (tmp_path / "chart.csv").exists()


def test_who_waits_is_told_what_it_carries(small: StudyResults, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    study = call.load(folder / "study.toml").parts[0].study
    known = [float(row["lower bound [kg]"]) for row in rows(folder)]
    permitted = [load for load in known if load]
    line = study.summary_line(small)
    carried, missing = line.split(", error bars taken off; errors that no bar contains: ")
    empty = len(known) - len(permitted)
    assert carried == (
        f"not permitted, even empty, at {empty} of 12 points; use {int(min(permitted))} to "
        f"{int(max(known))} kg at the other {12 - empty}, by all limits"
    )
    unbarred = study.model_copy(update={"error_bars": False}).summary_line(small)
    assert "points; the limits allow " in unbarred and unbarred.endswith("by all limits, without error bars")
    assert missing.startswith("the structural model: a point slides on beam2d only")
    assert missing in render_studies(folder) and all(row["not covered"] == missing for row in rows(folder))
    table = study.table(small)
    unreached = table | {"load": np.full_like(table["load"], np.nan)}
    monkeypatch.setattr(Study, "table", lambda self, results: unreached)
    unmet = "no limit is reached up to 5000 kg at any of 12 points"
    assert study.summary_line(small) == unmet
    said = study.model_copy(update={"limits": ()}).summary_line(small)
    assert said == f"{unmet}; only buckling of the boom was evaluated; [[limits]] of the study adds others"


@pytest.mark.parametrize(("allowed", "is_said"), [(0.0, True), (400.0, True), (500.0, False)])
def test_the_terminal_says_that_a_run_lifts_more_than_is_allowed(
    allowed: float, is_said: bool, small: StudyResults, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where the boom is not permitted even empty."""
    figures = {"payload": 500.0, "payload.load": allowed, "payload.limit": "tip"}
    monkeypatch.setattr(Study, "_payload_figures", lambda self, results: figures)
    line = call.load(folder / "study.toml").parts[0].study.summary_line(small)
    assert (
        line.endswith(f"lifts 500 kg, and the chart allows {allowed:.0f} kg in one of its postures, by tip") is is_said
    )


def test_a_payload_is_judged_only_where_its_scene_prescribes_the_motion(
    small: StudyResults, folder: Path, tmp_path: Path
) -> None:
    """Without the study's `change` a scene may have no frame, or compute its luffing angle."""
    study, angle = call.load(folder / "study.toml").parts[0].study, 'luffing = { kind = "constant", amount = 30.0 }'
    laden = SCENE + 'masses = [{ name = "payload", on = "tip", mass = 100.0, payload = true }]\n'
    free = laden.replace(angle, 'luffing = "free"\nluffing_start = 30.0').replace(", stiffness = 1e8", "")
    still = laden.replace(laden[laden.index("[frame]") : laden.index("[section]")], "")
    for name, text, count in (("laden", laden, 6), ("free", free, 0), ("still", still, 0)):
        (tmp_path / f"{name}.toml").write_text(text)
        changed = study.model_copy(update={"scene": tmp_path / f"{name}.toml"})
        figures = changed.figures(small)
        assert sum(key.startswith("payload") for key in figures) == count
        assert len({*changed.figure_names} ^ {*figures}) == (0 if count else 6)  # published values may name all of them


def test_the_report_shows_the_picture_with_values_at_the_pointer(small: StudyResults, folder: Path) -> None:
    text = render_studies(folder)
    assert text.count("<title>radius") == 12
    assert "buckling of the boom: limit not reached" in text and "not met" not in text
    assert "Limits with the letters of pictures" in text and "Elsewhere use " in text
    assert "Point at the picture" in text and "Point at the picture" not in _without_screen(text)  # on paper


def test_pictures_and_tables_of_a_chart_fit_a_narrow_window(small: StudyResults, folder: Path) -> None:
    """A second picture for a narrow window is not printed; no table is left that only scrolls there."""
    text = render_studies(folder)
    drawings = re.findall(r'class="wide fits">\n<div class="drawing">(.*?)</div>', text, re.DOTALL)
    assert len(drawings) >= 3 and 'class="wide">' not in text
    for drawn in drawings:
        widths = [float(width) for width in re.findall(r'<svg viewBox="0 0 ([\d.]+)', drawn)]
        assert widths == pytest.approx([72.0 * WIDE, 72.0 * HALF])
        printed = re.sub(f"{SCREEN}.*?{END_OF_SCREEN}", "", drawn, flags=re.DOTALL)
        assert printed.count("<svg") == 1 and "<title>" not in printed
    names = re.findall(r' id="([^"]+)"', text)
    assert len(set(names)) == len(names)
    ways = re.findall(r'<table class="grid (\w+)', text)
    assert ways.count("blocks") == 3 and ways.count("small") == 2 and ways.count("scrolls") == 1  # that of the effort
    for table in re.findall(r'<table class="grid blocks[^"]*">(.*?)</table>', text, re.DOTALL):
        heads = re.findall(r"<th scope=\"col\"[^>]*>(.*?)</th>", table)
        labels = re.findall(r'<td class="number" data-label="([^"]+)"', table)
        assert len(labels) == table.count("<td") and {*map(unescape, labels)} == {*map(unescape, heads[1:])}


BOOM_LIFT = f"""
extends = "{WORKFLOWS / "studies" / "chart_boom_lift.toml"}"
luffing = [0.0]
extensions = [{{ mid = 3.5227, fly = 3.2177 }}, {{ mid = 4.1944, fly = 3.8894 }}, {{ mid = 4.8661, fly = 4.5611 }}]
error_bars = false
"""


def test_a_level_boom_lift_carries_on_its_pads_what_moments_about_a_tail_say(tmp_path: Path) -> None:
    """F d = g (P a + sum of m r), from the middle section's tail, d its overlap: the load P where F is 80 kN."""
    finished(tmp_path, BOOM_LIFT)
    (lengths, masses), found = zip(*((4.785, 74.5897), (4.478, 59.1528)), strict=True), rows(tmp_path)
    for row in found:
        d, fly = 5.09 - float(row["extension mid [m]"]), float(row["extension fly [m]"])
        own = masses[0] * lengths[0] / 2.0 + masses[1] * (fly + lengths[1] / 2.0)
        expected = (80e3 * d / 9.80665 - own) / (fly + lengths[1]) - 182.0
        assert float(row["pads [kg]"]) == pytest.approx(max(expected, 0.0), rel=1e-6)
    assert [row["governed by"] for row in found] == ["stress", "tip", "pads"]
    assert found[-1]["load [kg]"] == "0"  # fully out it may not be lowered so far


OWN = """
def largest_pad(at):
    return max(abs(force) for name, force in at.forces.items() if "ring" not in name and "cylinder" not in name)

def nothing(at):
    return at.forces["none such"]
"""
ASKED = """
[[limits]]
name = "own"
of = "function"
function = "largest pad"
most = 60e3
factor = 1.5
"""


def test_a_limit_of_the_users_own_is_what_its_function_says(
    small: StudyResults, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A function that does what a limit of pads does allows the same; one that is not there or fails is named."""
    (tmp_path / "own_limits.py").write_text(OWN)
    info = tmp_path / "own_limits-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own-limits\nVersion: 1.0\n")
    points = "[pmr.limits]\nlargest pad = own_limits:largest_pad\nnothing = own_limits:nothing\n"
    (info / "entry_points.txt").write_text(points)
    monkeypatch.syspath_prepend(tmp_path)
    plugin_objects.cache_clear()
    (tmp_path / "scene.toml").write_text(SCENE)
    try:
        finished(tmp_path, STUDY.replace("[[cases]]", f"{ASKED}\n[[cases]]", 1))
        assert [row["own [kg]"] for row in rows(tmp_path)] == [row["pads [kg]"] for row in rows(folder)]
        assert any(row["own [kg]"] for row in rows(tmp_path)) and "function" in render_studies(tmp_path)
        limit = Limit(name="own", of="function", function="nowhere", most=1.0)
        with pytest.raises(InputError, match="own.function = 'nowhere': one of largest pad, nothing is allowed"):
            limit.check(load_any(tmp_path / "scene.toml"))
    finally:
        plugin_objects.cache_clear()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("least = 3.0", "most = 3.0", "buckling takes least"),
        ('of = "pad"', 'of = "pads"', "limits[0].of"),
        ('of = "pad"', 'of = "expression"', "expression belongs to a limit of 'expression', which needs one"),
        ('of = "pad"', 'of = "expression"\nexpression = "__import__(\'os\')"',
         "is not allowed: numbers, + - * / **, load"),
        ('of = "pad"', 'of = "rope"', "there is no rope"),
        ('name = "tip"', 'name = "pads"', "names of limits must differ"),
        ('name = "tip"', 'name = "stability"', "names of limits must differ"),
        ("up_to = 5000.0", "up_to = 0.0", "up_to"),
        ("most = 4.0, count", "most = 6.5, count", "less than 6 m is allowed"),
        ("most = 4.0, count", "most = 5.8, count", "extensions[2] = 5.8: the overlap of middle and base shrinks to"),
        ('[{ load = "gust"', '[{ load = "guts"', "cases[1].wind.on[0].load = 'guts': gust of the scene are allowed"),
        ("density = 1.25, on", "shape = 1.2, on", "cases[1].wind.shape = 1.2: a wind without `on` is allowed with it"),
        ('name = "calm"', 'name = "calm"\nwind = { speed = 9.0, azimuth = 90.0 }', "side wind does not move"),
        ('hoisting_class = "HC2"', 'hoisting_class = "HC5"', "hoisting_class = 'HC5': one of HC1, HC2, HC3, HC4"),
        ("hoisting_speed = 0.5", "", "hoisting_class and hoisting_speed go together"),
        ('standard = "', 'loads = { gust = 1.0 }\nstandard = "', "loads and wind.on name the same load: gust"),
        ('name = "calm"\n', 'name = "calm"\nload = -1.0\n', "cases[0].load"),
        ('hoisting_class = "HC1"', 'hoisting_class = "HC0"', "hoist.hoisting_class = 'HC0'"),
        ('of = "luffing", speed', 'of = "slewing", speed', "stops = 'slewing': a scene whose [frame] has a slewing"),
        ("within = 0.6", "within = 0.0", "stops[0].within"),
        ("most = 60e3\nfactor = 1.5", "most = 60e3\nfactor = -1.5", "limits[0].factor"),
        ("[[2.0, 2.0], [-2.0, 2.0], [-2.0, -2.0], [2.0, -2.0]]", "[[2.0, 2.0], [-2.0, 2.0]]", "a polygon with an area"),
        ("luffing = { least = 0.0, most = 70.0, count = 4 }", "luffing = []", "luffing: at least one angle"),
        ("luffing = { least = 0.0, most = 70.0", "luffing = { least = 80.0, most = 70.0", "at least 80"),
        ('name = "pads"', 'name = "pads"\nwhich = ["*bottom*"]', "names among middle tail above, middle tail below"),
        ('name = "pads"', 'name = "pads"\nwhich = ["fly *", "nose"]', "limits.pads.which = 'fly *, nose': names among"),
        ('name = "pads"', 'name = "pads"\nwhich = ["fly tail"]', "'fly tail': did you mean 'fly tail *'? names among"),
        ('name = "pads"', 'name = "pads"\nwhich = []', "limits[0].which = []: a list of at least 1 is allowed"),
        ('name = "cylinder"', 'name = "cylinder"\nwhich = ["ram"]', "names among base pin x"),
        ('of = "pad"', 'of = "cylinder"\nwhich = ["ram"]', "names among cylinder of middle, cylinder of fly are"),
        ('of = "pad"', 'of = "stress"', "there is no stress"),
        ('of = "pad"', 'of = "expression"\nexpression = "2 * force[\'fly tail\']"', "did you mean 'fly tail below'"),
        ('of = "pad"', 'of = "expression"\nexpression = "output[\'nose\']"', "limits.pads.expression = 'nose': output"),
    ],
)  # fmt: skip
def test_bad_tables_and_limits_of_what_is_not_there_are_refused_before_anything_is_computed(
    folder: Path, old: str, new: str, said: str
) -> None:
    assert old in STUDY
    (folder / "bad.toml").write_text(STUDY.replace(old, new, 1))
    with pytest.raises(InputError, match=re.escape(said)):
        call.load(folder / "bad.toml")


def test_a_boom_on_a_slope_is_slewed_where_its_scene_slews_alone(folder: Path) -> None:
    """It had the slope of its first direction at all slewing angles, though the machine below had its own."""
    legs = ", ".join(f"{{ name = 'leg {x} {y}', at = [{x}, {y}] }}" for x in (2.0, -2.0) for y in (2.0, -2.0))
    ground = f"\n[frame.ground]\nheight = 1.0\nslope = [2.0, 0.0]\noutriggers = [{legs}]\n"
    (folder / "slope.toml").write_text(SCENE.replace("\n[section]\n", f"{ground}\n[section]\n", 1))
    (folder / "slewed.toml").write_text(
        STUDY.replace("scene.toml", "slope.toml").replace("up_to =", "slewing = [0.0, 90.0]\nup_to =", 1)
    )
    with pytest.raises(InputError, match=r"slewing = 90.0: 0 is allowed, or .*: frame.ground.slope counts as the boom"):
        call.load(folder / "slewed.toml")


def test_a_counterweight_slews_where_its_scene_slews_alone(folder: Path) -> None:
    """It stayed behind the first direction of the boom: 2254 kg tipped a machine over its rear in place of 3471 kg."""
    legs = ", ".join(f"{{ name = 'leg {x} {y}', at = [{x}, {y}] }}" for x in (2.0, -2.0) for y in (2.0, -2.0))
    weight = "masses = [{ name = 'weight', mass = 4000.0, at = [-1.5, 0.0, -1.0], slews = true }]"
    ground = f"\n[frame.ground]\nheight = 1.0\n{weight}\noutriggers = [{legs}]\n"
    (folder / "weight.toml").write_text(SCENE.replace("\n[section]\n", f"{ground}\n[section]\n", 1))
    study = STUDY.replace("scene.toml", "weight.toml")
    (folder / "turned.toml").write_text(study.replace("up_to =", "slewing = [0.0, 90.0]\nup_to =", 1))
    with pytest.raises(InputError, match=r"slewing = 90.0: 0 is allowed, or .*: frame.ground.masses\[0\].slews counts"):
        call.load(folder / "turned.toml")
    (folder / "turned.toml").write_text(study)
    call.load(folder / "turned.toml")


def test_sections_that_follow_are_where_they_follow(folder: Path) -> None:
    scene = SCENE.replace('name = "fly"', 'name = "fly"\njoint = { follows = "middle", ratio = 0.5, offset = 0.2 }')
    (folder / "follows.toml").write_text(scene)
    study, evenly = STUDY.replace("scene.toml", "follows.toml"), "{ least = 1.0, most = 4.0, count = 3 }"
    for extensions in (evenly, "[1.0, 2.5, 4.0]", "[{ fly = 0.7, middle = 1.0 }, { middle = 2.5 }, 4.0]"):
        (folder / "following.toml").write_text(study.replace(evenly, extensions))
        plan = call.load(folder / "following.toml").parts[0].plan
        runs, shown = plan.runs, call._progress({task.key: task for task in plan}, set(), {}, 1.0, [*plan][1:3])
        assert shown.text.endswith("; now the richer model for error bars, loads at extensions 1 + 0.7 m")
        rows = [(run.parameters["extension.middle"], run.parameters["extension.fly"]) for run in runs]
        assert rows == [(1.0, 0.7), (2.5, 1.45), (4.0, 2.2)]
    (folder / "following.toml").write_text(study.replace(evenly, "[{ middle = 1.0, fly = 1.0 }]"))
    with pytest.raises(InputError, match=r"extensions\[0\].fly = 1.0: 0.7 m is allowed, as it follows middle"):
        call.load(folder / "following.toml")


def test_pads_stay_where_the_model_has_them(folder: Path) -> None:
    path = '{ kind = "ramp", times = [0.0, 1.0], values = [2.0, 3.5] }'
    pads = "at = 0.15\nfaces = { bottom = [0.0], top = [0.0] }"
    scene = SCENE.replace('{ kind = "constant", amount = 3.0 }', path).replace("at = 0.15", pads)
    (folder / "pads.toml").write_text(scene)
    study = STUDY.replace("scene.toml", "pads.toml")
    (folder / "padded.toml").write_text(study.replace("{ least = 1.0, most = 4.0, count = 3 }", "[2.0, 5.0, 1.9]"))
    with pytest.raises(InputError, match=r"extensions\[2\] = 1.9: at least 2 m of middle is allowed: the scene's ext"):
        call.load(folder / "padded.toml")


def test_degrees_are_refused_where_the_scene_says_no_unit(folder: Path) -> None:
    """As runs refuse them: the angles of the study are in the unit of the scene, which is rad unless it says so."""
    (folder / "radians.toml").write_text(SCENE.replace('unit = "degrees"', "").replace("amount = 30.0", "amount = 0.5"))
    for old, new, key in (("", "", "luffing = 70"), ("most = 70.0", "most = 1.2", "slewing = 90")):
        text = STUDY.replace("scene.toml", "radians.toml").replace(old, new)
        (folder / "bad.toml").write_text(text.replace("up_to =", "slewing = [0.0, 90.0]\nup_to =", 1))
        with pytest.raises(InputError, match=f"{key}.0: an angle of more than a turn needs its unit"):
            call.load(folder / "bad.toml")


def test_names_that_limits_may_choose_are_those_of_the_models() -> None:
    """Of the crane, whose pads lie on faces, and of a planar telescope that has none there."""
    crane = load_any(plain_machines.CRANE, ["compare.against=[]"])
    planar = load_any("boom_two", ["section.body.model='beam2d'", "compare.against=[]"])
    for scene in (crane, planar):
        scene = scene.model_copy(update={"frame": crane.frame, "gravity": crane.gravity})
        system, names = tasks.full_system(scene), force_names(scene)
        for kind in ("pad", "cylinder"):
            assert names[kind] == [one.name for one in system.contacts if one.kind == kind]


def test_wind_on_an_area_is_a_force_and_no_load_with_another_unit() -> None:
    windy = LoadCase.model_validate(
        {"name": "a", "wind": {"speed": 20.0, "on": [{"load": "wind", "area": 2.4, "shape": 1.6}]}}
    )
    windy.check_loads("cases[0]", {"wind": True})
    with pytest.raises(InputError, match=r"cases\[0\].wind.on\[0\].load = 'wind': no forces of the scene are allowed"):
        windy.check_loads("cases[0]", {"wind": False})
