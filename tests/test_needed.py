"""Packages that only a part of the work needs: what is said where they are missing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from processes import WITHOUT_FIGURES, Called, called

from pmr import scene
from pmr.compare import responses
from pmr.errors import InputError
from pmr.errors.environment import check_installed, import_package
from pmr.pipeline import reduce

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
def test_without_a_library_of_weasyprint_all_but_the_report_is_there(tmp_path: Path, monkeypatch, capsys) -> None:
    hidden = hide("weasyprint", "raise OSError('cannot load library libpango')", tmp_path)
    forget("weasyprint", hidden, monkeypatch)
    monkeypatch.chdir(tmp_path)
    short = ["--set", "time.end=0.1", "--set", "mesh.elements=10", "--set", "compare.against=['full']"]
    short += ["--set", "slider.path=1.25"]
    scene = str(WORKFLOWS / "paper_simple.toml")
    found = called(monkeypatch, capsys, "run", scene, "--out", "results", *short)
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
EXTRAS = (
    "jinja2 matplotlib fontTools weasyprint vtkmodules PIL exudyn gmsh pandas ziglang dolfinx petsc4py slepc4py mpi4py"
)


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
