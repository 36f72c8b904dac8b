"""The command ``pmr study``, and the batch scripts around it, as a user calls them."""

import os
import shutil
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
from processes import UNDRAWN, python, undrawn
from waiting import PATIENCE, wait_until

from pmr.studies.study import Store, StudyResults

ROOT = Path(__file__).parents[2]
HELD = str(Path(__file__).with_name("held.py"))
COORDINATES = ROOT / "workflows" / "studies" / "coordinates.toml"
SMALL = f"""
extends = "{COORDINATES}"
[change]
time.end = 0.5
mesh.elements = 20
slider.path = {{ kind = "ramp", times = [0.1, 0.4], values = [1.25, 1.6] }}
[grid]
reduction.basis = ["eigenmodes"]
reduction.coordinates = [10, 20]
"""


def pmr(*arguments: str, ranks: int = 1) -> subprocess.CompletedProcess[str]:
    return python("-m", "pmr", "study", *arguments, ranks=ranks)


def tables(folder: Path) -> list[bytes]:
    return [(folder / name).read_bytes() for name in ("runs.csv", "runs.npz")]


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study of two short runs."""
    file = tmp_path_factory.mktemp("study") / "small.toml"
    file.write_text(SMALL)
    return file


@pytest.fixture(scope="module")
def done(small: Path) -> Path:
    """Its results."""
    folder = small.parent / "out"
    finished = undrawn("study", str(small), "--out", str(folder), "--jobs", "1")
    assert finished.returncode == 0, finished.stderr
    lines = finished.stdout.splitlines()
    first, table = lines[:4], [line for line in lines[4:] if not line.startswith("warning: ")]
    assert first == [
        f"table  {folder}/runs.csv",
        f"report {folder}/report.html",
        f"report {folder}/report.pdf",
        "2 of 2 runs are done",
    ]
    assert sum("error along the beam" in line and line.count("%") == 2 for line in table) == 1
    assert max(map(len, table)) <= 80 and "runs.csv" in table[-1]
    assert all(" tasks done" in line for line in finished.stderr.splitlines())  # of a slow machine
    return folder


@pytest.mark.slow
def test_a_study_leaves_what_the_help_says(done: Path) -> None:
    expected = {"report.html", "report.pdf", "runs.csv", "runs.npz", "seconds.csv", "summary.json", "tasks"}
    assert expected == {file.name for file in done.iterdir()}
    results = StudyResults.load(done)
    assert [run.key for run in results.runs] == ["basis=eigenmodes,coordinates=10", "basis=eigenmodes,coordinates=20"]
    ten, twenty = results.column("errors.reduced_vs_full.beam")
    assert 0.0 < twenty < 0.1 * ten


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_called_again_it_goes_on(small: Path, done: Path, run_command) -> None:
    before = tables(done)
    again = run_command("study", str(small), "--out", str(done))
    assert again.returncode == 0 and "2 of 2 runs are done, all of them earlier" in again.stdout
    assert tables(done) == before


@pytest.mark.slow
def test_runs_can_be_named_and_computed_one_by_one(small: Path, done: Path, run_command) -> None:
    names = [f"basis=eigenmodes,coordinates={r}" for r in (10, 20)]
    assert run_command("study", str(small), "--list").stdout.split() == names
    before = tables(done)
    one = run_command("study", str(small), "--out", str(done), "--only", names[1])
    assert one.returncode == 0 and one.stdout == "1 of 1 runs are done, all of them earlier\n"
    assert tables(done) == before


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_failing_run_leaves_exit_code_1_and_the_other_runs(small: Path, done: Path, run_command) -> None:
    more = "change.reduction.snapshots=21"  # more than the mesh has nodes for
    asked = ("study", str(small), "--out", str(done.with_name("failed")), "--set", more, "--jobs", "1")
    failed = run_command(*asked)
    assert failed.returncode == 1 and "0 of 2 runs are done" in failed.stdout
    both = "basis=eigenmodes,coordinates=10, basis=eigenmodes,coordinates=20"
    assert f"failed: {both}: InputError: scene: reduction.snapshots" in failed.stderr
    assert failed.stderr.count("failed: ") == 1
    assert "at most 20 fit on the mesh's nodes" in failed.stderr and "Traceback" not in failed.stderr
    assert (done.with_name("failed") / "runs.csv").read_text().count("failed") == 2


BAD = [
    (["nowhere.toml"], "nowhere.toml: no such study file"),
    ([__file__], "not valid TOML"),
    ([str(COORDINATES), "--set", "grid.reduction.modes=[0]"], "--set: grid.reduction.modes = 0: input should be"),
    ([str(COORDINATES), "--out", "pyproject.toml"], "a folder that can be written to"),
    ([str(COORDINATES), "--only", "coordinates=10"], "no such run; did you mean 'basis="),
]


@pytest.mark.parametrize(("arguments", "says"), BAD, ids=[" ".join(a[-2:]) for a, _ in BAD])
def test_bad_input_ends_with_one_line_and_exit_code_2(arguments: list[str], says: str, run_command) -> None:
    done = run_command("study", *arguments)
    assert done.returncode == 2
    assert done.stdout == "" and len(done.stderr.strip().splitlines()) == 1
    assert says in done.stderr


@pytest.mark.slow
def test_bad_input_is_said_once_on_several_ranks() -> None:
    done = pmr("nowhere.toml", ranks=2)
    assert done.returncode != 0 and done.stderr.count("no such study file") == 1
    with_jobs = pmr(str(COORDINATES), "--jobs", "2", ranks=2)
    assert with_jobs.returncode != 0 and "--jobs = 2: under MPI all ranks but" in with_jobs.stderr


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_killed_and_started_again_it_makes_the_same_table(small: Path, done: Path, tmp_path: Path, run_command) -> None:
    arguments, count = ["study", str(small), "--out", str(tmp_path), "--jobs", "1"], 2
    child = subprocess.Popen([sys.executable, HELD, str(count), *arguments])
    wait_until(lambda: len(list(tmp_path.glob("tasks/*.npz"))) == count, child)
    child.kill()
    child.wait()
    stored = {file: file.stat().st_mtime_ns for file in tmp_path.glob("tasks/*.npz")}
    again = run_command(*arguments)
    assert again.returncode == 0, again.stderr
    assert len(stored) >= count and all(file.stat().st_mtime_ns == at for file, at in stored.items())
    assert tables(tmp_path) == tables(done)


@pytest.mark.slow
def test_interrupted_by_the_keyboard_it_says_how_to_go_on(small: Path, tmp_path: Path) -> None:
    command = [sys.executable, HELD, "1", "study", str(small), "--out", str(tmp_path), "--jobs", "1"]
    heard = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)  # a shell's background jobs inherit a deaf ear
    child = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, preexec_fn=heard)
    wait_until(lambda: list(tmp_path.glob("tasks/*.npz")), child)
    child.send_signal(signal.SIGINT)
    _, printed = child.communicate(timeout=PATIENCE)
    *progress, last = printed.splitlines()
    assert child.returncode == 130 and last == "interrupted; the same command goes on from here"
    assert all(" tasks done" in line for line in progress)  # of a slow machine


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """With `pmr`, whose reports are empty, `python` and `mpiexec` of this stack on PATH."""
    command = tmp_path / "bin" / "pmr"
    command.parent.mkdir()
    (command.parent / "undrawn.py").write_text(UNDRAWN)
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{command.parent}/undrawn.py" "$@"\n')
    command.chmod(0o755)
    path = [str(command.parent), str(Path(sys.executable).parent), os.environ["PATH"]]
    return {**os.environ, "PATH": os.pathsep.join(path)}


def script(*command: str, cwd: Path, env: dict[str, str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE, cwd=cwd, env=env)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_the_plain_loop_makes_the_same_table(
    small: Path, done: Path, tmp_path: Path, environment: dict[str, str]
) -> None:
    script("sh", str(ROOT / "workflows" / "study.sh"), str(small), "out", cwd=tmp_path, env=environment)
    assert tables(tmp_path / "out") == tables(done)


@pytest.mark.slow
def test_snakemake_makes_the_same_table(small: Path, done: Path, tmp_path: Path, environment: dict[str, str]) -> None:
    """Also after a change of the scene, which the study's file names."""
    own = ROOT / ".venv-snakemake" / "bin" / "snakemake"
    snakemake = str(own) if own.exists() else shutil.which("snakemake")
    if snakemake is None:
        pytest.skip("Snakemake is not installed: make test does it")
    (tmp_path / "study.toml").write_text(SMALL.replace("[change]", 'scenes = ["scene.toml"]\n[change]'))
    original = f'extends = "{ROOT / "workflows" / "paper_evolved.toml"}"\n'
    for change in ("body.profile.mass_per_length = 80.0\n", ""):
        (tmp_path / "scene.toml").write_text(original + change)
        options = ["--cores", "2", "--config", "study=study.toml", "out=out"]
        script(snakemake, "--snakefile", str(ROOT / "workflows" / "Snakefile"), *options, cwd=tmp_path, env=environment)
        assert (tables(tmp_path / "out") == tables(done)) is (not change)


@pytest.mark.slow
def test_the_slurm_script_makes_the_same_table_under_mpiexec(
    small: Path, done: Path, tmp_path: Path, environment: dict[str, str]
) -> None:
    text = (ROOT / "workflows" / "study.slurm").read_text()
    settings = [line for line in text.splitlines() if line.startswith("#SBATCH")]
    first_command = text.index("set -euo")
    assert all(text.index(line) < first_command for line in settings) and "#SBATCH --requeue" in settings
    with_mpi = environment | {"PMR_LAUNCH": "mpiexec -n 2"}
    script("bash", str(ROOT / "workflows" / "study.slurm"), str(small), "out", cwd=tmp_path, env=with_mpi)
    assert tables(tmp_path / "out") == tables(done)


def test_the_slurm_script_queues_a_job_again_before_its_time_limit(tmp_path: Path, environment: dict[str, str]) -> None:
    for name, content in {"scontrol": 'echo "$@" > queued', "launch": "kill -USR1 $PPID\nsleep 3"}.items():
        (tmp_path / "bin" / name).write_text(f"#!/bin/sh\n{content}\n")
        (tmp_path / "bin" / name).chmod(0o755)
    job = environment | {"PMR_LAUNCH": "launch", "SLURM_JOB_ID": "17"}
    script = ["bash", str(ROOT / "workflows" / "study.slurm"), "study.toml", "out"]
    subprocess.run(script, check=False, timeout=PATIENCE, cwd=tmp_path, env=job)
    assert (tmp_path / "queued").read_text() == "requeue 17\n"


@pytest.mark.parametrize("name", ["tasks", "tasks/0123456789abcdef01234567.npz", "runs.csv", "summary.json"])
def test_what_stands_in_the_place_of_results_is_told_before_work(
    name: str, small: Path, tmp_path: Path, monkeypatch, run_command
) -> None:
    monkeypatch.chdir(tmp_path)
    there = Path(name)
    there.parent.mkdir(exist_ok=True)
    there.write_text("") if name == "tasks" else there.mkdir()
    refused = run_command("study", str(small), "--out", ".", "--jobs", "1")
    assert refused.returncode == 2 and refused.stdout == "" and refused.stderr.count("\n") == 1
    assert refused.stderr.startswith("pmr: command line: --out = ") and name in refused.stderr
    assert "can be written to is allowed (" in refused.stderr


def test_a_folder_that_is_called_as_an_unfinished_task_is_left_alone(tmp_path: Path) -> None:
    left = tmp_path / "tasks" / "0123.npz.12.part"
    left.mkdir(parents=True)
    os.utime(left, (0, 0))
    Store(left.parent).prepare()
    assert left.is_dir()
