"""Names that are imported when they are first asked for."""

import os
import re
import subprocess
import sys
from pathlib import Path

import blas
import numpy as np
import pytest
import scipy.linalg
from processes import python

from pmr import InputError
from pmr.cli import app
from pmr.errors import environment, lazy_names
from pmr.fem.compat import PETSc

ROOT = Path(__file__).parents[2]
VERSIONS = ROOT / ".ci" / "versions"


def test_the_code_digest_changes_with_sources_and_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    files = {"run.py": "a = 1", "report/page.py": "b = 2", "cli.py": "c = 3"}
    whole = environment.code_digest(files)
    assert environment.code_digest(dict(reversed(files.items()))) == whole
    without = environment.code_digest(files, ("report/",))
    assert without not in (whole, environment.code_digest(files, ("report/", "cli")))
    assert without == environment.code_digest(files | {"report/page.py": "b = 4"}, ("report/",))
    assert whole != environment.code_digest(files | {"report/page.py": "b = 4"})
    monkeypatch.setattr(environment, "_NUMERICAL", ("numpy",))
    assert environment.code_digest(files) != whole


@pytest.mark.mpi
def test_every_blas_computes_by_the_kernel_that_was_asked_for() -> None:
    """One that the library doesn't have would be passed over in silence, and one kernel tested twice."""
    asked = os.environ.get("OPENBLAS_CORETYPE")
    assert scipy.linalg.det(np.eye(2)) == 1.0 and PETSc.Sys.getVersion()  # NumPy's, SciPy's and PETSc's are loaded
    assert not asked or {library.kernel for library in blas.loaded()} == {asked}


@pytest.mark.slow
@pytest.mark.parametrize("launched", [1, 2])
def test_what_lets_mpi_start_alone_is_gone_afterwards(monkeypatch: pytest.MonkeyPatch, launched: int) -> None:
    """A launcher that is started later would hand it on to processes that do need networks."""
    monkeypatch.setattr(environment, "launched_process_count", lambda: launched)
    monkeypatch.setenv("OMPI_MCA_pml", "as the user has it")
    for name in environment.UNLAUNCHED.keys() - {"OMPI_MCA_pml"}:
        monkeypatch.delenv(name, raising=False)
    before = dict(os.environ)
    with environment.mpi_without_launcher():
        assert os.environ == (before if launched > 1 else environment.UNLAUNCHED | before)
    assert os.environ == before


def test_processes_that_start_mpi_side_by_side_share_no_folder(tmp_path: Path) -> None:
    """Open MPI's session folder is the same one for all isolated processes: one that ends removed it under others."""
    start = (
        "import os, sys; os.environ['TMPDIR'] = folder = sys.argv.pop(); from pmr.fem.compat import MPI; "
        "print(MPI.COMM_WORLD.size, os.listdir(folder))"
    )
    done = python("-c", start, str(tmp_path))
    assert done.stdout == "1 []\n", done.stdout + done.stderr


@pytest.mark.parametrize("text", ["xx", "", "0", "-1", "1.5", "9" * 5000, "٣"])
@pytest.mark.parametrize("variable", environment.LAUNCHED)
def test_a_launchers_variable_that_holds_no_number_of_processes_is_refused(
    monkeypatch: pytest.MonkeyPatch, variable: str, text: str
) -> None:
    monkeypatch.setenv(variable, text)
    with pytest.raises(InputError, match=rf"environment: {variable} = .*the number of processes"):
        environment.launched_process_count()


def test_where_temporary_files_can_not_be_written_one_line_says_so(tmp_path: Path) -> None:
    """Before MPI starts, whose own way to say it takes pages."""
    start = "import os, sys; os.environ['TMPDIR'] = sys.argv.pop(); from pmr.cli import main; main()"
    for folder in (tmp_path / "missing", "/dev/null"):
        done = python("-c", start, "info", str(folder))
        assert done.returncode == 2, done.stderr
        assert done.stderr.startswith("pmr: environment: TMPDIR = '")
        assert "a folder that can be written to is allowed" in done.stderr
        assert done.stderr.count("\n") == 1


def test_in_a_folder_that_was_removed_one_line_says_so(tmp_path: Path) -> None:
    start = "import os, sys; os.chdir(f := sys.argv.pop()); os.rmdir(f); from pmr.cli import main; main()"
    done = python("-c", start, "info", str(tmp_path))
    assert done.returncode == 2 and done.stderr.startswith(
        "pmr: environment: the current folder: a folder that is there"
    )
    assert done.stderr.count("\n") == 1


@pytest.mark.slow
@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_letters_that_a_terminal_lacks_are_spelled_out(encoding: str, tmp_path: Path) -> None:
    (tmp_path / "scene.toml").write_text('extends = "paper_simple"\ntitle = "▲ 漢"\n', encoding="utf-8")
    start = "import io, sys; sys.stdout = io.TextIOWrapper(sys.stdout.buffer, encoding=sys.argv.pop())"
    command = [sys.executable, "-c", f"{start}; from pmr.cli import main; main()", "info", str(tmp_path), encoding]
    done = subprocess.run(command, capture_output=True, check=False, env=dict(os.environ))
    assert done.returncode == 0, done.stderr
    assert r"\u25b2 \u6f22" in done.stdout.decode(encoding)


@pytest.mark.parametrize(
    "error",
    [
        ValueError("numpy.dtype size changed, may indicate binary incompatibility. Expected 96 from C header"),
        ImportError("SciPy needs NumPy 2.3 or less. Got NumPy 9.9."),
    ],
)
def test_packages_that_do_not_fit_together_are_one_line(error: Exception, monkeypatch, run_command) -> None:
    def fail(standalone_mode: bool) -> None:
        raise error

    monkeypatch.setattr(app, "app", fail)
    done = run_command("info")
    assert done.returncode == 2 and done.stderr.count("\n") == 1, done.stderr
    assert str(error) in done.stderr and np.__version__ in done.stderr and "make setup" in done.stderr


@pytest.mark.slow
def test_setup_sees_a_package_of_another_version(tmp_path: Path) -> None:
    def judged(*pins: str) -> str:
        (tmp_path / "pins.txt").write_text("\n".join(pins))
        return subprocess.run(
            [sys.executable, VERSIONS, tmp_path / "pins.txt"], capture_output=True, text=True
        ).stderr.strip()

    fits = [f"numpy=={np.__version__}", 'numpy==0.1; python_version < "3"', "not-there-at-all==1.0"]
    assert judged(*fits) == ""
    assert judged(*fits[1:], "numpy==0.1") == f"not the versions that fit together: numpy {np.__version__}"
    assert f"python {VERSIONS.relative_to(ROOT)} .venv/pins.txt ||" in (ROOT / "Makefile").read_text()


def test_what_pip_adds_to_the_environment_leaves_its_versions() -> None:
    made = Path(sys.prefix)
    if not (made / "pins.txt").is_file():
        pytest.skip("an environment that make setup has not made")
    assert (made / "pip.conf").read_text().split() == ["[install]", "constraint", "=", (made / "pins.txt").as_uri()]
    assert re.search(r"^numpy==[\d.]+$", (made / "pins.txt").read_text(), re.MULTILINE)


def test_a_name_is_looked_up_where_it_stands() -> None:
    find = lazy_names("some", {"Refused": "pmr.errors:InputError"})
    assert find("Refused") is InputError


def test_a_name_that_there_is_not_lists_those_that_there_are() -> None:
    with pytest.raises(AttributeError, match="module 'some' has no public name 'd'; there are b, c$"):
        lazy_names("some", {"c": "json:c", "b": "json:b"})("d")


def test_a_module_that_is_not_imported_yet_is_told_from_a_name_that_there_is_not() -> None:
    with pytest.raises(AttributeError, match=r"^pmr.kernel is a module of its own: import pmr.kernel$"):
        lazy_names("pmr", {})("kernel")


def test_nothing_is_imported_where_it_would_be_in_vain() -> None:
    def missing() -> None:
        raise InputError("environment", "package", "missing", "nothing")

    find = lazy_names("some", {"x": "no_such_module:x"}, before=missing)
    with pytest.raises(InputError):
        find("x")
    with pytest.raises(AttributeError):  # whatever is installed
        find("y")
