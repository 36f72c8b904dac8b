"""Load charts of a planar telescope, beside its full order; what is refused."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from finished import finished

from pmr.errors import InputError
from pmr.errors.plugins import offered
from pmr.report.studies.document import page
from pmr.scene import load_any
from pmr.simulation.postures import HOOK, WEIGHT, Postures, weights_of, with_hook
from pmr.studies import files, shared
from pmr.studies.allowed import allowed_loads
from pmr.studies.charting import allowed, postures, stands_of
from pmr.studies.figures import boom_arguments
from pmr.studies.limits import Limit
from pmr.studies.results import StudyResults
from pmr.system.from_scene import force_names

pytestmark = pytest.mark.slow

SCENE = """
title = "Telescope"
gravity = {}
time = { end = 1.0, step = 0.01 }

[frame]
pivot = [0.0, 0.0, 0.0]
unit = "degrees"
luffing = { kind = "constant", amount = 30.0 }

[section]
body.model = "beam2d"
body.material = { young = 2e10 }
mesh.elements = 20
reduction.coordinates = 6
joint.extension = { kind = "constant", amount = 3.0 }

[[section.joint.tail]]
at = 0.15
[[section.joint.mouth]]
at = 0.15

[[sections]]
name = "base"
body.box = { length = 6.0, width = 0.30, height = 0.40, wall = 0.008 }
supports = [
  { name = "pin", directions = ["x", "z"] },
  { name = "luffing cylinder", on = 1.5, directions = ["z"], stiffness = 1e8 },
]

[[sections]]
name = "middle"
body.box = { length = 6.0, width = 0.26, height = 0.36, wall = 0.007 }

[[sections]]
name = "fly"
body.box = { length = 6.0, width = 0.22, height = 0.32, wall = 0.006 }
loads = [{ name = "gust", direction = "z", signal = { kind = "constant", amount = 0.0 } }]
"""
STUDY = """
kind = "chart"
title = "Chart of a telescope"
scene = "scene.toml"
up_to = 5000.0
extensions = { least = 1.0, most = 4.0, count = 3 }
luffing = { least = 0.0, most = 70.0, count = 4 }
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
loads = { gust = -500.0 }
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
    assert np.hypot(float(found[-1]["radius [m]"]), float(found[-1]["height [m]"])) == pytest.approx(14.0)
    assert float(found[0]["radius [m]"]) == pytest.approx(8.0) and float(found[0]["height [m]"]) == 0.0


def test_a_hoisted_load_pulls_with_more_than_its_weight(small: StudyResults, folder: Path) -> None:
    """On any boom with less than on a tip that does not move; nothing is hoisted where nothing is carried."""
    figures, found = json.loads((folder / "summary.json").read_text())["figures"], rows(folder)
    factors = [float(row["hoisting factor"]) for row in found if row["hoisting factor"]]
    loads = [float(row["load [kg]"]) for row in found if row["hoisting factor"]]
    assert len(factors) == sum(float(row["load [kg]"]) > 0.0 for row in found) == 9
    assert all(1.0 < f < 1.0 + 0.4 * np.sqrt(8e5 / m) / 9.80665 for f, m in zip(factors, loads, strict=True))
    assert figures["hoist.most"] == pytest.approx(max(factors)) and figures["hoist.class"] == pytest.approx(1.118)
    assert "Hoisted off the ground at 0.4" in page(folder)


def test_what_is_met_at_no_load_or_never_is_told(small: StudyResults, folder: Path) -> None:
    """Far out the tip is too deep without any load; where nothing presses along the boom, nothing buckles it."""
    figures = json.loads((folder / "summary.json").read_text())["figures"]
    assert figures["at_no_load.tip"] == 3 and figures["at_no_load.pads"] == 0
    assert figures["never.stability"] == 12 and figures["never.cylinder"] == 0
    assert sum(figures[f"governs.{name}"] for name in ("tip", "cylinder")) == 12 == figures["points"]


def test_made_twice_it_is_the_same_to_the_byte(small: StudyResults, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text(SCENE)
    finished(tmp_path, STUDY)
    assert (tmp_path / "chart.csv").read_bytes() == (folder / "chart.csv").read_bytes()


def test_the_report_shows_the_picture_with_values_at_the_pointer(small: StudyResults, folder: Path) -> None:
    text = page(folder)
    assert text.count("<title>radius") == 12
    assert "Limits, the number of points" in text and "It carries " in text


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
    offered.cache_clear()
    (tmp_path / "scene.toml").write_text(SCENE)
    try:
        finished(tmp_path, STUDY.replace("[[cases]]", f"{ASKED}\n[[cases]]", 1))
        assert [row["own [kg]"] for row in rows(tmp_path)] == [row["pads [kg]"] for row in rows(folder)]
        assert any(row["own [kg]"] for row in rows(tmp_path)) and "function" in page(tmp_path)
        limit = Limit(name="own", of="function", function="nowhere", most=1.0)
        with pytest.raises(InputError, match="own.function = 'nowhere': one of largest pad, nothing is allowed"):
            limit.check(load_any(tmp_path / "scene.toml"))
    finally:
        offered.cache_clear()


def test_full_order_agrees_within_the_error_bars(tmp_path: Path) -> None:
    """At 20 random places in at least 19, of what all limits allow; the bars are no more than 2 % of the loads."""
    rng = np.random.default_rng(20)
    (tmp_path / "scene.toml").write_text(SCENE.replace("unit = ", "second_order = true\nunit = "))
    scene = with_hook(load_any(tmp_path / "scene.toml"))
    at = {
        "extensions": {name: rng.uniform(0.7, 4.5, 20).tolist() for name in ("middle", "fly")},
        "luffing": rng.uniform(0.0, 1.3, 20).tolist(),
        "slewing": [0.0] * 20,
    }
    asked: dict[str, Any] = {"up_to": 1e5, "error": True}
    made = postures(boom_arguments(scene) | asked | {"at": at}, {})
    limits = [
        Limit(name="pads", of="pad", most=40e3),
        Limit(name="tip", of="deflection", most=0.6),
        Limit(name="buckling", of="buckling", least=3.0),
        Limit(name="frequency", of="frequency", least=0.3),
    ]
    more = {"limits": [one.model_dump(mode="json") for one in limits], "gravity": 9.80665, "rows": [0, 20]}
    cases = [{"weight": 1.0, "load": 1.0, "loads": {}}]
    found = allowed(asked | more | {"cases": cases}, {"postures": made}).arrays
    full = shared.full_system(scene)
    whole = Postures.of(scene, full, stands_of({"at": at}), weights_of(full))
    amounts = [1.0 if part in (WEIGHT, HOOK) else 0.0 for part in whole.parts]
    exact = np.array([allowed_loads(limits, whole, k, amounts, 1e5, 9.80665) for k in range(20)])
    load, error = found["load"], found["error"]
    least, governs = np.nanmin(load, axis=1), np.nanargmin(load, axis=1)
    bars = error[np.arange(20), governs]
    inside = np.abs(np.nanmin(exact, axis=1) - least) <= bars + 1e-6 * least
    assert inside.sum() >= 19
    assert (bars <= 0.02 * least).all()
    assert len(set(governs.tolist())) > 1
    known = np.isfinite(load) & np.isfinite(exact)
    assert (np.abs(exact - load) <= error + 1e-6 * load)[known].mean() >= 0.95


def test_full_order_buckles_within_the_error_bars_sideways_too() -> None:
    """The crane in space at 20 random places: two models' errors of opposite sign cancel where they cross."""
    rng = np.random.default_rng(2)
    changes = ["sections.fly.masses=[]", "frame.second_order=true", "section.mesh.elements=16", "compare.against=[]"]
    scene = with_hook(load_any("crane", changes))
    at = {
        "extensions": {name: rng.uniform(0.7, 4.5, 20).tolist() for name in ("middle", "fly")},
        "luffing": rng.uniform(0.0, 1.3, 20).tolist(),
        "slewing": [0.0] * 20,
    }
    asked: dict[str, Any] = {"up_to": 1e5, "error": True}
    made = postures(boom_arguments(scene) | asked | {"at": at}, {})
    limits = [Limit(name="buckling", of="buckling", least=3.0)]
    more = {"limits": [one.model_dump(mode="json") for one in limits], "gravity": 9.80665, "rows": [0, 20]}
    cases = [{"weight": 1.0, "load": 1.0, "loads": {}}]
    found = allowed(asked | more | {"cases": cases}, {"postures": made}).arrays
    full = shared.full_system(scene)
    whole = Postures.of(scene, full, stands_of({"at": at}), weights_of(full))
    amounts = [1.0 if part in (WEIGHT, HOOK) else 0.0 for part in whole.parts]
    near = found["load"]
    exact = np.array([allowed_loads(limits, whole, k, amounts, 1e5, 9.80665, near[k]) for k in range(20)])
    load, error = found["load"], found["error"]
    known = np.isfinite(load) & np.isfinite(exact)
    assert known.sum() >= 20
    assert (np.abs(exact - load) <= error)[known].all()
    assert (error <= 0.06 * load)[known].all()


def test_full_order_of_a_boom_with_a_shell_agrees_within_the_error_bars() -> None:
    """Pads, deflection and stress where the last section is a shell of 1,900 coordinates, at two random places."""
    rng = np.random.default_rng(7)
    changes = ["sections.fly.masses=[]", "frame.second_order=true", "section.mesh.elements=6"]
    changes += ["sections.fly.mesh={size=0.32,along=1.0}"]
    changes += ["sections.fly.probes=[{name='top',at=[2.0,0.0,0.163],measures=['stress']}]"]
    scene = with_hook(load_any("crane_shell", changes))
    at = {
        "extensions": {name: rng.uniform(0.7, 4.5, 2).tolist() for name in ("middle", "fly")},
        "luffing": rng.uniform(0.0, 1.3, 2).tolist(),
        "slewing": [0.0] * 2,
    }
    asked: dict[str, Any] = {"up_to": 3e4, "error": True}
    made = postures(boom_arguments(scene) | asked | {"at": at}, {})
    limits = [
        Limit(name="pads", of="pad", most=40e3),
        Limit(name="tip", of="deflection", most=0.15),
        Limit(name="top", of="stress", most=60e6),
    ]
    more = {"limits": [one.model_dump(mode="json") for one in limits], "gravity": 9.80665, "rows": [0, 2]}
    cases = [{"weight": 1.0, "load": 1.0, "loads": {}}]
    found = allowed(asked | more | {"cases": cases}, {"postures": made}).arrays
    full = shared.full_system(scene)
    whole = Postures.of(scene, full, stands_of({"at": at}), weights_of(full))
    amounts = [1.0 if part in (WEIGHT, HOOK) else 0.0 for part in whole.parts]
    load, error = found["load"][:, :3], found["error"][:, :3]
    exact = np.array([allowed_loads(limits, whole, k, amounts, 3e4, 9.80665, found["load"][k]) for k in range(2)])
    assert np.isfinite(load).all() and (np.abs(exact[:, :3] - load) <= error).all()
    assert (error[:, :2] <= 1e-3 * load[:, :2]).all()  # stress is local: its bar is 4 % at one of the places


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("least = 3.0", "most = 3.0", "buckling takes least"),
        ('of = "pad"', 'of = "pads"', "limits[0].of"),
        ('of = "pad"', 'of = "expression"', "expression belongs to a limit of 'expression', which needs one"),
        (
            'of = "pad"',
            'of = "expression"\nexpression = "__import__(\'os\')"',
            "is not allowed: numbers, + - * / **, load",
        ),
        ('of = "pad"', 'of = "rope"', "the scene has no rope to look at"),
        ('name = "tip"', 'name = "pads"', "names of limits must differ"),
        ('name = "tip"', 'name = "stability"', "names of limits must differ"),
        ("up_to = 5000.0", "up_to = 0.0", "up_to"),
        ("most = 4.0, count", "most = 6.5, count", "less than 6 m is allowed"),
        ("gust = -500.0", "guts = -500.0", "cases[1].loads.guts = -500.0: gust of the scene are allowed"),
        ("factor = 1.5", "factor = -1.5", "limits[0].factor"),
        ("[[2.0, 2.0], [-2.0, 2.0], [-2.0, -2.0], [2.0, -2.0]]", "[[2.0, 2.0], [-2.0, 2.0]]", "a polygon with an area"),
        ("luffing = { least = 0.0, most = 70.0, count = 4 }", "luffing = []", "luffing: at least one angle"),
        ("luffing = { least = 0.0, most = 70.0", "luffing = { least = 80.0, most = 70.0", "at least 80"),
    ],
)
def test_bad_tables_are_refused_in_one_line(folder: Path, old: str, new: str, said: str) -> None:
    assert old in STUDY
    (folder / "bad.toml").write_text(STUDY.replace(old, new, 1))
    with pytest.raises(InputError, match=r".") as refused:
        files.load(folder / "bad.toml")
    assert said in str(refused.value) and "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('name = "pads"', 'name = "pads"\nwhich = ["*bottom*"]', "names among middle tail above, middle tail below"),
        ('name = "pads"', 'name = "pads"\nwhich = ["fly *", "nose"]', "limits.pads.which = 'fly *, nose': names among"),
        ('name = "cylinder"', 'name = "cylinder"\nwhich = ["ram"]', "names among base pin x"),
        ('of = "pad"', 'of = "cylinder"\nwhich = ["ram"]', "names among cylinder of middle, cylinder of fly are"),
        ('of = "pad"', 'of = "stress"', "the scene has no stress to look at"),
    ],
)
def test_a_limit_of_what_is_not_there_is_refused_before_anything_is_computed(
    folder: Path, old: str, new: str, said: str
) -> None:
    assert old in STUDY
    (folder / "bad.toml").write_text(STUDY.replace(old, new, 1))
    with pytest.raises(InputError, match=r".") as refused:
        files.load(folder / "bad.toml")
    assert said in str(refused.value) and "\n" not in str(refused.value)


def test_names_that_limits_may_choose_are_those_of_the_models() -> None:
    """Of the crane, whose pads lie on faces, and of a planar telescope that has none there."""
    crane = load_any(Path(__file__).parents[3] / "workflows" / "crane.toml", ["compare.against=[]"])
    planar = load_any("boom_two", ["section.body.model='beam2d'", "compare.against=[]"])
    for scene in (crane, planar):
        scene = scene.model_copy(update={"frame": crane.frame, "gravity": crane.gravity})
        system, names = shared.full_system(scene), force_names(scene)
        for kind in ("pad", "cylinder"):
            assert names[kind] == [one.name for one in system.contacts if one.kind == kind]
