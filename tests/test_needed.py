"""Packages that only a part of the work needs: what is said where they are missing.

A body of given matrices goes the whole way without FEniCSx, and without PETSc, and ends where it does with them.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bricks import bricks, on_pads
from processes import FENICSX, PETSC, UNDRAWN, WITHOUT_FIGURES, Called, called, without

from pmr import InputError, from_matrices, reduce, scene
from pmr import pipeline as whole
from pmr import scene as scenes
from pmr.compare import responses
from pmr.errors.environment import check_installed, import_package

WORKFLOWS = Path(__file__).parents[1] / "workflows"

MARCH_ALONE = ["simulation.simulators=['march']", "compare.against=['full']"]


ABSENT = "raise ModuleNotFoundError(\"No module named '{}'\")"


def hide(package: str, content: str, folder: Path) -> str:
    """An entry of the path where the package is one whose import does this."""
    (folder / "hidden").mkdir()
    (folder / "hidden" / f"{package}.py").write_text(content)
    return str(folder / "hidden")


def run_without(package: str, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """`pmr`, its figures empty, in a process in which the package is not there."""
    hidden = hide(package, ABSENT.format(package), folder)
    path = os.pathsep.join([hidden, *filter(None, [os.environ.get("PYTHONPATH")])])
    command = [sys.executable, "-c", WITHOUT_FIGURES, *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": path}, cwd=folder)


def forget(package: str, hidden: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """From now on this process finds the hidden one."""
    monkeypatch.syspath_prepend(hidden)
    monkeypatch.delitem(sys.modules, package, raising=False)


def called_without(
    package: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str
) -> Called:
    """The command in this process, in which the package is not there."""
    forget(package, hide(package, ABSENT.format(package), folder), monkeypatch)
    return called(monkeypatch, capsys, *arguments)


def test_without_gmsh_a_shell_is_refused_in_one_line(tmp_path: Path, monkeypatch, capsys) -> None:
    found = called_without("gmsh", tmp_path, monkeypatch, capsys, "run", str(WORKFLOWS / "boom_shell.toml"))
    assert found.returncode == 2 and "Traceback" not in found.stderr
    assert "pmr: installation: gmsh: not found (No module named 'gmsh')" in found.stderr
    assert "pip install gmsh" in found.stderr


def test_without_exudyn_a_scene_that_asks_for_it_is_refused_in_one_line(tmp_path: Path, monkeypatch, capsys) -> None:
    found = called_without("exudyn", tmp_path, monkeypatch, capsys, "export", str(tmp_path / "reduced.npz"))
    assert found.returncode == 2 and "Traceback" not in found.stderr
    assert "pmr: installation: exudyn: not found (No module named 'exudyn')" in found.stderr
    assert "pip install exudyn" in found.stderr and 'simulation.simulators = ["march"]' in found.stderr


@pytest.mark.slow
def test_without_exudyn_march_does_the_work(tmp_path: Path) -> None:
    """All but the report, which nothing hinders either."""
    short = ["time.end=0.1", "mesh.elements=10", "compare.against=['full']", "slider.path=1.25"]
    overrides = [part for override in [*short, "simulation.simulators=['march']"] for part in ("--set", override)]
    scene = str(WORKFLOWS / "paper_simple.toml")
    found = run_without("exudyn", tmp_path, "run", scene, "--out", "results", *overrides)
    assert found.returncode == 0, found.stderr
    assert (tmp_path / "results" / "report.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.slow
@pytest.mark.usefixtures("without_figures")
def test_without_a_library_of_weasyprint_all_but_the_report_is_there(tmp_path: Path, monkeypatch, run_command) -> None:
    hidden = hide("weasyprint", "raise OSError('cannot load library libpango')", tmp_path)
    forget("weasyprint", hidden, monkeypatch)
    monkeypatch.chdir(tmp_path)
    short = ["--set", "time.end=0.1", "--set", "mesh.elements=10", "--set", "compare.against=['full']"]
    short += ["--set", "slider.path=1.25"]
    scene = str(WORKFLOWS / "paper_simple.toml")
    found = run_command("run", scene, "--out", "results", *short)
    assert found.returncode == 1 and "Traceback" not in found.stderr
    assert "installation: weasyprint: not found (cannot load library libpango)" in found.stderr
    assert "pip install jinja2 matplotlib fonttools weasyprint" in found.stderr
    assert "the results themselves are in results" in found.stderr
    names = {file.name for file in (tmp_path / "results").iterdir()}
    assert {"summary.json", "reduced.npz", "trajectories.npz"} <= names and "report.pdf" not in names


def test_a_missing_package_is_named_before_the_work(monkeypatch: pytest.MonkeyPatch) -> None:
    check_installed("weasyprint")
    assert import_package("weasyprint").HTML
    monkeypatch.setattr(sys, "path", [])
    for name in ("gmsh", "exudyn"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    with pytest.raises(InputError, match="installation: gmsh: not found; it draws .* pip install gmsh"):
        check_installed("gmsh")
    with pytest.raises(InputError, match="installation: exudyn: not found; .* pip install exudyn"):
        responses.check_installed(scene.load(WORKFLOWS / "paper_simple.toml"))
    responses.check_installed(scene.load(WORKFLOWS / "paper_simple.toml", MARCH_ALONE))
    with pytest.raises(InputError, match="installation: gmsh: not found .* pip install gmsh"):
        import_package("gmsh")


#: What extras bring: none of it may be needed to simulate a saved model, or to say what a run found.
EXTRAS = "jinja2 matplotlib fontTools weasyprint PIL exudyn gmsh pandas ziglang dolfinx petsc4py slepc4py mpi4py"


@pytest.mark.slow
def test_a_light_installation_simulates_a_saved_model(tmp_path: Path) -> None:
    small = ["mesh.elements=20", "time.end=0.2", "slider.path=1.5", "compare.against=[]"]
    reduce(scene.load(WORKFLOWS / "boom_beam.toml", small)).reduced.save(tmp_path / "reduced.npz")
    hidden = f"import sys; sys.modules.update(dict.fromkeys({EXTRAS.split()}))\nfrom pmr.cli import main\nmain()"
    overrides = [part for override in small for part in ("--set", override)]
    asked = ["simulate", "reduced.npz", "--scene", "boom_beam", "--out", "shorter", *overrides]
    found = subprocess.run([sys.executable, "-c", hidden, *asked], capture_output=True, text=True, cwd=tmp_path)
    assert found.returncode == 0, found.stderr
    assert (tmp_path / "shorter" / "tables" / "forces.csv").exists()
    found = subprocess.run([sys.executable, "-c", hidden, "run", "boom_beam"], capture_output=True, text=True)
    assert found.returncode == 2 and found.stderr.startswith("pmr: installation: dolfinx: not found; FEniCSx makes")


@pytest.fixture(scope="module")
def scene_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bar")
    return on_pads(folder)


@pytest.mark.slow
@pytest.mark.parametrize("missing", [FENICSX, (*FENICSX, *PETSC)], ids=["fenicsx", "petsc"])
def test_the_whole_way_without(missing: tuple[str, ...], scene_file: Path, tmp_path: Path) -> None:
    """By sparse factors; the full model too."""
    solver = "reduction.solver=slepc"
    done = without(missing, "run", str(scene_file), "--set", solver, "--out", str(tmp_path), code=UNDRAWN)
    assert done.returncode == 0, done.stderr
    outcome = whole.run(scenes.load(scene_file, [solver]))
    assert outcome is not None
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert "dolfinx" not in summary["versions"] and ("PETSc" in summary["versions"]) is (missing == FENICSX)
    errors = summary["errors"]["reduced_vs_full"]
    assert max(errors["tip"], errors["beam"]) < 1e-3
    with np.load(tmp_path / "trajectories.npz") as found:
        for name in ("reduced", "full"):
            expected = outcome.result.responses[name].displacement
            atol = (1e-12 if missing == FENICSX else 1e-9) * np.abs(expected).max()
            np.testing.assert_allclose(found[f"{name}.displacement"], expected, rtol=0.0, atol=atol)


@pytest.mark.slow
def test_a_model_of_forms_is_refused_in_one_line() -> None:
    done = without(FENICSX, "run", "paper_simple")
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert "FEniCSx makes models from forms, all but matrices" in done.stderr


@pytest.mark.slow
def test_several_processes_are_refused_without_mpi(scene_file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PMI_SIZE", "2")
    done = without((*FENICSX, *PETSC), "run", str(scene_file))
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert "mpi4py: with petsc4py and slepc4py it is needed for more than one process" in done.stderr


def test_matrices_without_a_map_are_node_by_node() -> None:
    given = bricks((2, 1, 1), (0.4, 0.1, 0.1))
    again = from_matrices(given.M.toarray(), given.K.toarray(), given.points, {"tip": [3]})
    np.testing.assert_array_equal(again.node, given.node)
    np.testing.assert_array_equal(again.direction, given.direction)
    assert given.M.sum() == pytest.approx(3 * 7850.0 * 0.4 * 0.1 * 0.1, rel=1e-12)
    mask = given.points[:, 0] > 0.3
    masked = from_matrices(given.M, given.K, given.points, {"tip": mask, "twice": [3.0, 3.0, 1.0]})
    np.testing.assert_array_equal(masked.groups["tip"], np.flatnonzero(mask))
    np.testing.assert_array_equal(masked.groups["twice"], [1, 3])  # every node counts alike
    for arguments, says in (
        ({"points": given.points[1:]}, "three or six times the 11 nodes"),
        ({"node": given.node}, "together"),
        ({"groups": {"tip": [12]}}, "groups.tip"),
        ({"groups": {"tip": [0.0, 3.7]}}, "groups.tip: a list of whole numbers is allowed"),
        ({"groups": {"tip": [True, False]}}, "groups.tip: a mask of 12 truth values is allowed"),
        ({"groups": {"tip": ["a"]}}, "groups.tip: "),
        ({"groups": {"tip": [[0, 1], [2, 3]]}}, "groups.tip: a list of whole numbers"),
        ({"groups": {"tip": [np.nan]}}, "groups.tip: a list of whole numbers"),
        ({"node": given.node + 0.5, "direction": given.direction}, "node: a list of whole numbers"),
        ({"K": given.K * 1j}, "K: real numbers are allowed"),
        ({"points": [[0.0, 1.0, 2.0], [0.0]]}, "points: "),
    ):
        with pytest.raises(InputError, match=says):
            from_matrices(**{"M": given.M, "K": given.K, "points": given.points, **arguments})
