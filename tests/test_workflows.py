"""The scenes and meshes that come with the package."""

import itertools
import os
import re
import runpy
import tomllib
from pathlib import Path

import numpy as np
import pytest

import pmr
from pmr import run, scene
from pmr.compare.step_error import STEP_LIMIT
from pmr.models.mesh_drawing import read_nodes
from pmr.studies import call

ROOT = Path(__file__).parents[1]
#: How a file begins: its schema for editors, then what it is.
SAYS = r"#:schema \S*schemas/(scene|study)\.json\n# "
STUDIES = [file for file in (ROOT / "workflows").rglob("*.toml") if "kind" in tomllib.loads(file.read_text())]
#: Studies, of which one plans so many scenes that it takes a second and more.
PLANNED = [
    pytest.param(file, id=file.stem, marks=[pytest.mark.slow] * (file.stem == "sections")) for file in sorted(STUDIES)
]
SIX = sorted({*(ROOT / "workflows" / "residual").glob("*.toml")} - {ROOT / "workflows" / "residual" / "base.toml"})
COMPLETE = sorted({*(ROOT / "workflows").glob("*.toml")} - {*STUDIES, ROOT / "workflows" / "paper_base.toml"}) + SIX
RESIDUAL = [ROOT / "workflows" / f"{name}_residual.toml" for name in ("simple", "evolved")] + SIX

COORDINATES = (5, 6, 10)
#: `PMR_SWEEP=full` takes each scene with each number of coordinates.
ESTIMATED = (
    list(itertools.product(RESIDUAL, COORDINATES))
    if os.environ.get("PMR_SWEEP") == "full"
    else list(zip(RESIDUAL, itertools.cycle(COORDINATES)))
)


@pytest.mark.parametrize("file", COMPLETE, ids=lambda file: file.stem)
def test_every_scene_is_valid_and_says_what_it_is(file: Path) -> None:
    assert scene.load_any(file).title and re.match(SAYS, file.read_text())


@pytest.mark.parametrize("file", PLANNED)
def test_every_study_can_be_planned(file: Path) -> None:
    project = call.load(file)
    assert project.title and re.match(SAYS, file.read_text())
    assert project.parts and all(part.plan.runs for part in project.parts)


def test_the_mesh_is_what_its_script_writes(tmp_path: Path) -> None:
    script = runpy.run_path(str(ROOT / "meshes" / "graded_beam.py"))
    script["write"](tmp_path / "again.msh")
    kept = read_nodes(ROOT / "meshes" / "graded_beam.msh", 5.0)
    assert np.array_equal(kept, read_nodes(tmp_path / "again.msh", 5.0))
    assert set(np.round(np.diff(kept), 9)) == {0.0625, 0.125} and {1.25, 3.75} <= set(np.round(kept, 9))


@pytest.mark.slow
def test_a_crane_whose_last_section_is_a_shell_moves_as_that_of_beams() -> None:
    """The walls of the beams give way as its own do: within 1 % of the deflection."""
    short = ["time.end=4.0", "time.step=1e-2", "section.mesh.elements=12", "section.reduction.estimate=false"]
    short += ["section.mesh.size=0.14", "section.mesh.along=0.4"]
    tips = []
    for name in ("crane", "crane_shell"):
        asked = scene.load_any(ROOT / "workflows" / f"{name}.toml", short)
        tips.append(pmr.simulate(asked, pmr.reduce(asked).reduced).of("tip", None, "z")[:, -1])
    beams, shell = tips
    assert shell == pytest.approx(beams, abs=0.01 * np.abs(beams).max())


@pytest.mark.slow
def test_the_graded_mesh_runs() -> None:
    short = ["time.end=0.5", "slider.path={kind='ramp',times=[0.1,0.4],values=[1.25,1.6]}"]
    outcome = run(scene.load(ROOT / "workflows" / "graded_mesh.toml", short))
    assert outcome is not None
    assert outcome.reduced.provenance["scene"]["mesh"]["file"] == "graded_beam.msh"
    assert outcome.result.summary["coordinates"] == {"full": 183, "reduced": 20}
    assert outcome.result.summary["errors"]["reduced_vs_full"]["beam"] < 1e-3


def assert_estimated(summary: dict) -> None:
    for place in ("tip", "beam"):
        assert 1.0 < summary["estimate"][place] / summary["errors"]["reduced_vs_full"][place] < 1.6


@pytest.mark.slow
@pytest.mark.parametrize(("file", "coordinates"), ESTIMATED, ids=lambda value: getattr(value, "stem", value))
def test_the_estimate_is_the_error_and_a_margin(file: Path, coordinates: int) -> None:
    choice = [f"reduction.coordinates={coordinates}", "simulation.simulators=['march']", "simulation.repeats=1"]
    outcome = run(scene.load(file, choice))
    assert outcome is not None and len(SIX) == 6
    summary = outcome.result.summary
    assert_estimated(summary)
    said = " ".join(summary["warnings"])
    assert (
        ("first truncated mode" in said)
        == (summary["estimate"]["chi"] > 0.5)
        == (file.stem == "tip_impact" and coordinates < 8)
    )
    coarse = file.stem in ("sine_sweep", "steel_boom", "tip_impact")
    assert ("too coarse" in said) == (summary["step"]["beam"] > STEP_LIMIT) == coarse and summary["step"]["settled"]


def test_a_folder_of_results_does_not_hide_the_workflow_of_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As `pmr run boom_two --out boom_two` leaves it; one with a scene is what was asked for."""
    monkeypatch.chdir(tmp_path)
    Path("boom_two").mkdir()
    Path("boom_two", "summary.json").write_text("{}")
    assert scene.load_any("boom_two").title == "Boom of two sections"
    Path("boom_two", "scene.toml").write_text('extends = "boom_two"\ntitle = "Mine"')
    assert scene.load_any("boom_two").title == "Mine"
