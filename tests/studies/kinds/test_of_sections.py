"""Each kind of study on a boom of sections: it runs, up to its report, or is refused with the reason."""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path

import pytest
from finished import WORKFLOWS, finished

from pmr.report.studies.finished import FinishedStudy
from pmr.studies import kinds
from pmr.studies.results import StudyResults
from pmr.studies.tasks import cell_number

#: What is changed in a scene of two sections.
CHANGES = {
    "mesh.elements = 40": "mesh.elements = 8",
    "times = [0.5, 4.0, 7.5], values = [0.6, 4.5, 0.6]": "times = [0.0, 0.2], values = [1.0, 1.3]",
    "end = 8.0": "end = 0.2",
    "stiffness = 1e8,": "stiffness = 1e8, unilateral = false,",
    "amplitude = 1000.0, times = [0.0, 8.0], frequencies = [0.2, 3.0]": "amplitude = 4e3, frequency = 9.0",
    'kind = "chirp"': 'kind = "sine"',
}
ASKED = {
    "convergence": "full = [2, 4, 16]",
    "scenes": "grid.time.step = [1e-3, 5e-4]",
    "trade": "coordinates = [1, 3]\nsteps = [2.0, 1.0]\nradii = [1.0]",
}


def text(kind: str, folder: Path) -> str:
    scene = (WORKFLOWS / "boom_two.toml").read_text()
    for old, new in CHANGES.items():
        assert old in scene
        scene = scene.replace(old, new)
    (folder / "two.toml").write_text(scene)
    one = kind == "convergence"
    named = 'scene = "two.toml"' if one else 'scenes = ["two.toml"]'
    return f'kind = "{kind}"\ntitle = "Of sections"\n{named}\n{ASKED[kind]}\n'


def reported(kind: str, folder: Path, results: StudyResults) -> None:
    module = importlib.import_module(f"pmr.report.studies.{kind}")
    assert module.build_chapter(FinishedStudy.load(folder), "part").blocks
    assert results.is_complete


def test_every_kind_is_asked_here() -> None:
    """But for charts, whose boom has a frame (`test_chart`)."""
    assert set(ASKED) | {"chart"} == {module.name for module in pkgutil.iter_modules(kinds.__path__)}


@pytest.mark.slow
def test_a_mesh_of_sections_converges(tmp_path: Path) -> None:
    found = finished(tmp_path, text("convergence", tmp_path))
    errors = {run.key: run.figures["e_abs"] for run in found.runs}
    assert all("pull" in " ".join(run.warnings) for run in found.runs)
    assert cell_number(errors["full-2"]) > 3.0 * cell_number(errors["full-4"]) > 0.0 and errors["full-16"] is None
    reported("convergence", tmp_path, found)


@pytest.mark.slow
def test_sizes_and_steps_of_sections_are_traded(tmp_path: Path) -> None:
    found = finished(tmp_path, text("trade", tmp_path))
    modes, flexible = (run.figures for run in found.runs)
    assert all("pull" in " ".join(run.warnings) for run in found.runs)
    assert cell_number(flexible["total.3.1"]) < cell_number(flexible["total.3.2"])
    assert (
        cell_number(flexible["reduction.3"]) < cell_number(flexible["reduction.1"]) < cell_number(modes["reduction.1"])
    )
    reported("trade", tmp_path, found)


@pytest.mark.slow
def test_a_coarse_mesh_leaves_enough_to_tell_rigid_overlaps_apart(tmp_path: Path) -> None:
    """The base has twelve modes, of which ten are coordinates and two are left for its two rigid rows."""
    study, scene = text("trade", tmp_path), (tmp_path / "two.toml").read_text()
    changes = {"elements = 8": "elements = 6", "rho_inf = 1.0": "rho_inf = 0.8"}
    changes["tail = [{"] = "rigid_overlap = true\ntail = [{"
    for old, new in changes.items():
        assert old in scene
        scene = scene.replace(old, new)
    (tmp_path / "two.toml").write_text(scene)
    modes, flexible = (run.figures for run in finished(tmp_path, study).runs)
    assert cell_number(flexible["reduction.3"]) < 0.01 * cell_number(modes["reduction.3"])


@pytest.mark.slow
def test_sections_are_varied_by_key(tmp_path: Path) -> None:
    found = finished(tmp_path, text("scenes", tmp_path))
    assert [run.status for run in found.runs] == ["done", "done"]
