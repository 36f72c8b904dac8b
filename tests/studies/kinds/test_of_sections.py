"""Each kind of study on a boom of sections: it runs, up to its report, or is refused with the reason."""

from __future__ import annotations

import importlib
import pkgutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from finished import WORKFLOWS, finished
from oracle import nrms_error
from scipy.linalg import eigh, null_space

from pmr import scene as scenes
from pmr.compare.evaluation import respond
from pmr.compare.runs import run_from_start
from pmr.errors import InputError
from pmr.pipeline import run
from pmr.report.studies.finished import FinishedStudy
from pmr.scene.members import TAIL
from pmr.simulation import Excitation
from pmr.studies import files, kinds
from pmr.studies.booms import built_of, full_of
from pmr.studies.engine.task import number
from pmr.studies.results import StudyResults
from pmr.system.assembly import Assembly
from pmr.system.from_scene import system_of
from pmr.system.projection import projected

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
    "combinations": "combinations = [[3, 3], [3, 4]]",
    "convergence": "full = [2, 4, 16]",
    "error_map": "most_snapshots = 3\nmost_modes = 6\nbudget = 9\naveraged = 2\nsmallest_pool = 6",
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
    """But for charts, whose boom has a frame (`test_chart`)."""
    assert set(ASKED) | {"chart"} == {module.name for module in pkgutil.iter_modules(kinds.__path__)}


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
@pytest.mark.parametrize(("kind", "figure"), [("residual", "beam.4"), ("trade", "reduction.3")])
def test_a_coarse_mesh_leaves_enough_to_tell_rigid_overlaps_apart(tmp_path: Path, kind: str, figure: str) -> None:
    """The base has twelve modes, of which ten are coordinates and two are left for its two rigid rows."""
    study, scene = text(kind, tmp_path), (tmp_path / "two.toml").read_text()
    changes = {"elements = 8": "elements = 6", "rho_inf = 1.0": "rho_inf = 0.8"}
    changes["tail = [{"] = "rigid_overlap = true\ntail = [{"
    for old, new in changes.items():
        assert old in scene
        scene = scene.replace(old, new)
    (tmp_path / "two.toml").write_text(scene)
    modes, flexible = (run.figures for run in finished(tmp_path, study).runs)
    assert number(flexible[figure]) < 0.01 * number(modes[figure])


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


def recomputed(file: Path, snapshots: int, modes: int, coordinates: int) -> float:
    """The error along the boom on a basis that NumPy makes of modes that SciPy finds."""
    boom = scenes.load_any(file)
    excitation = Excitation.of(boom)
    full = full_of(boom, built_of(boom))
    assembly, reach = Assembly(full), boom.reach(excitation.times)
    pool = []
    for goal in np.linspace(reach.min(), reach.max(), snapshots):
        step = int(np.argmin(np.abs(reach - goal)))
        rows = assembly.at(full.coordinates(dict(zip(full.paths, excitation.s[step], strict=True))))
        rigid = np.all(rows.F == 0.0, axis=1)
        Z, soft = null_space(rows.C[rigid]), rows.of(~rigid)
        K = assembly.K.toarray() + soft.C.T @ np.linalg.inv(soft.F) @ soft.C
        pool.append(Z @ eigh(Z.T @ K @ Z, Z.T @ assembly.M.toarray() @ Z, subset_by_index=[0, modes - 1])[1])
    bodies = {}
    for name, body in full.bodies.items():
        own = np.hstack(pool)[assembly.coordinates[name]]
        moves = np.abs(own).max(axis=1) > 1e-6 * np.abs(own).max()
        V = np.zeros((body.size, coordinates))
        V[assembly.free[name][moves]] = np.linalg.svd(own[moves], full_matrices=False)[0][:, :coordinates]
        held = [k for k, row in enumerate(body.row_names) if k not in body.rows.fixed and row != TAIL]
        bodies[name] = replace(projected(body, V), carriers=body.carriers.on(V)).with_rows(held)
    found, reference = (
        respond(one, run_from_start(one, excitation)).displacement for one in (system_of(boom, bodies), full)
    )
    return nrms_error(found, reference)


@pytest.mark.slow
def test_bases_of_modes_of_a_boom_held_at_extensions_are_mapped(tmp_path: Path) -> None:
    """Errors are those of models made elsewhere; snapshots at one extension alone are worst."""
    found = finished(tmp_path, text("error_map", tmp_path))
    errors = {run.key: number(run.figures["dropped.error"]) for run in found.runs}
    assert set(errors) == {f"{n}x{m}" for n in (1, 2, 3) for m in range(1, 7) if n * m >= 6}
    expected = np.mean([recomputed(tmp_path / "two.toml", 3, 4, r) for r in (8, 9)])
    assert errors["3x4"] == pytest.approx(expected, rel=1e-5)
    assert max(errors, key=errors.__getitem__) == "1x6" and min(errors.values()) < 1e-3
    reported("error_map", tmp_path, found)


@pytest.mark.slow
def test_combinations_of_snapshots_and_modes_of_a_boom_are_compared(tmp_path: Path) -> None:
    found = finished(tmp_path, text("combinations", tmp_path))
    errors = {run.key: run.figures for run in found.runs}
    for r in (5, 9):
        expected = recomputed(tmp_path / "two.toml", 3, 4, r)
        assert errors[f"3x4-{r}"]["dropped.beam"] == pytest.approx(expected, rel=1e-5)
    assert number(errors["3x4-9"]["dropped.beam"]) < 0.1 * number(errors["3x4-4"]["dropped.beam"])
    assert number(errors["3x4-9"]["dropped.strain"]) < number(errors["3x4-4"]["dropped.strain"])
    reported("combinations", tmp_path, found)


def test_more_snapshots_than_a_boom_has_extensions_are_refused(tmp_path: Path) -> None:
    study = text("error_map", tmp_path).replace("most_snapshots = 3", "most_snapshots = 900")
    (tmp_path / "study.toml").write_text(study)
    with pytest.raises(InputError, match="most_snapshots = 900: as many snapshots as a boom has extensions"):
        files.load(tmp_path / "study.toml")
