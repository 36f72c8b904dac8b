"""Each kind of study on a boom of sections: it runs, up to its report, or is refused with the reason."""

from __future__ import annotations

import importlib
import pkgutil
from pathlib import Path

import pytest
from finished import WORKFLOWS, finished

from pmr import scene as scenes
from pmr.errors import InputError
from pmr.pipeline import run
from pmr.report.studies.finished import FinishedStudy
from pmr.studies import files, kinds, subjects
from pmr.studies.engine.task import number
from pmr.studies.results import StudyResults

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
    "combinations": "combinations = [[3, 3]]",
    "convergence": "full = [2, 4, 16]",
    "error_map": "most_snapshots = 3",
    "histories": "",
    "residual": "coordinates = [1, 2, 4]",
    "scenes": "grid.time.step = [1e-3, 5e-4]",
    "speed": "coordinates = [1, 2]\nrepeats = 1",
    "trade": "coordinates = [1, 3]\nsteps = [2.0, 1.0]\nradii = [1.0]",
}


def text(kind: str, folder: Path) -> str:
    scene = (WORKFLOWS / "boom_two.toml").read_text()
    for old, new in CHANGES.items():
        assert old in scene
        scene = scene.replace(old, new)
    (folder / "two.toml").write_text(scene)
    one = kind in ("combinations", "convergence", "error_map")
    named = 'scene = "two.toml"' if one else 'scenes = ["two.toml"]'
    return f'kind = "{kind}"\ntitle = "Of sections"\n{named}\n{ASKED[kind]}\n'


def reported(kind: str, folder: Path, results: StudyResults) -> None:
    module = importlib.import_module(f"pmr.report.studies.sections.{kind}")
    assert module.content(FinishedStudy.load(folder), "part").blocks
    assert results.is_complete


def test_every_kind_is_asked_here() -> None:
    assert set(ASKED) == {module.name for module in pkgutil.iter_modules(kinds.__path__)}


@pytest.mark.parametrize("kind", sorted(subjects.OF_ONE_BODY))
def test_what_sections_have_no_use_for_is_refused_with_the_reason(kind: str, tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(text(kind, tmp_path))
    with pytest.raises(InputError) as caught:
        files.load(tmp_path / "study.toml")
    assert subjects.OF_ONE_BODY[kind] in str(caught.value)


@pytest.mark.slow
def test_a_mesh_of_sections_converges(tmp_path: Path) -> None:
    found = finished(tmp_path, text("convergence", tmp_path))
    errors = {run.key: run.figures["e_abs"] for run in found.runs}
    assert number(errors["full-2"]) > 3.0 * number(errors["full-4"]) > 0.0 and errors["full-16"] is None
    reported("convergence", tmp_path, found)


@pytest.mark.slow
def test_more_modes_of_sections_are_better_and_flexibility_is_worth_most(tmp_path: Path) -> None:
    """And the estimate is above the true error, by a quarter."""
    found = finished(tmp_path, text("residual", tmp_path))
    modes, flexible = (run.figures for run in found.runs)
    for r in (1, 2, 4):
        assert number(flexible[f"beam.{r}"]) < 0.1 * number(modes[f"beam.{r}"]) and modes[f"estimate.{r}"] is None
        assert number(flexible[f"estimate.{r}"]) == pytest.approx(1.25 * number(flexible[f"beam.{r}"]), rel=0.1)
    assert number(flexible["beam.4"]) < number(flexible["beam.2"]) < number(flexible["beam.1"])
    reported("residual", tmp_path, found)


@pytest.mark.slow
def test_sizes_and_steps_of_sections_are_traded(tmp_path: Path) -> None:
    found = finished(tmp_path, text("trade", tmp_path))
    modes, flexible = (run.figures for run in found.runs)
    assert number(flexible["total.3.1"]) < number(flexible["total.3.2"])
    assert number(flexible["reduction.3"]) < number(flexible["reduction.1"]) < number(modes["reduction.1"])
    reported("trade", tmp_path, found)


@pytest.mark.slow
def test_sections_are_varied_by_key(tmp_path: Path) -> None:
    found = finished(tmp_path, text("scenes", tmp_path))
    assert [run.status for run in found.runs] == ["done", "done"]


@pytest.mark.slow
def test_full_and_reduced_sections_are_timed_by_size(tmp_path: Path) -> None:
    found = finished(tmp_path, text("speed", tmp_path))
    approaches = ["full-march", "reduced-march-1", "reduced-march-2", "reduced-exudyn-1", "reduced-exudyn-2"]
    assert [run.parameters["approach"] for run in found.runs] == approaches
    sizes = [number(run.figures["coordinates"]) for run in found.runs]
    assert sizes[0] > sizes[2] > sizes[1] == sizes[3] and sizes[2] == sizes[4]
    assert all(
        run.figures["steps"] == found.runs[0].figures["steps"] and run.seconds["repeat1"] > 0 for run in found.runs
    )
    reported("speed", tmp_path, found)
    figures = FinishedStudy.load(tmp_path).figures
    ratio = figures["two.seconds.full-march"] / figures["two.seconds.reduced-march-1"]
    assert number(figures["two.full_over_reduced.1"]) == pytest.approx(ratio)


@pytest.mark.slow
def test_histories_of_sections_stand_beside_the_full_ones(tmp_path: Path) -> None:
    """Errors are those of a run of the scene."""
    found = finished(tmp_path, text("histories", tmp_path))
    outcome = run(scenes.load_any(tmp_path / "two.toml"))
    assert outcome is not None
    errors = outcome.result.summary["errors"]["reduced_vs_full"]
    for place in ("tip", "beam"):
        assert number(found.runs[0].figures[f"errors.reduced_vs_full.{place}"]) == pytest.approx(
            errors[place], rel=1e-6
        )
    reported("histories", tmp_path, found)
