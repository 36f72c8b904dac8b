"""Every command of the manual is run by a test or by `.ci/manual`, or stands here with why none does."""

import re
import runpy
import shlex
import tomllib
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer

from pmr import scene as scenes
from pmr.cli.app import app
from pmr.cli.console import scene_file, study_file

ROOT = Path(__file__).parents[1]
TUTORIALS = ROOT / "docs" / "tutorials"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")), *sorted(TUTORIALS.glob("*.md"))]
PROGRAM = r"(?:pmr|make|pip|python -m|mpirun|mpiexec|sbatch|ccx)"

#: What is run here, in this order and one folder, and what makes it short; `.ci/manual` runs most blocks of the pages.
RUN = {
    "pmr flexible boom_solid --at 2.5 --to sid --set masses=[]": "--set mesh.size=0.15 --set mesh.along=0.75",
    "pmr schema scene": "",
    "pmr schema supports": "",
    "pmr schema hoist": "",
    "pmr schema hoist.falls": "",
    "pmr schema frame.ground": "",
    "pmr new telescope telescope": "",
    "pmr new platform platform": "",
    "pmr study coordinates --list": "",
}
#: What another test runs, shorter or not.
TESTED = {
    "pmr info evolved/reduced.npz": "tests/cli/test_app.py",
    "pmr study chart.toml": "tests/test_tutorials.py::test_a_load_chart_from_an_empty_folder",
    "pmr chart crane --up-to 20000": "tests/test_tutorials.py::test_a_load_chart_from_an_empty_folder",
    "pmr new crane mine": "tests/test_tutorials.py::test_a_crane_from_an_empty_folder",
    "pmr new telescope mine": "tests/cli/test_start.py::test_a_new_scene_is_accepted_and_has_the_folders_name",
    "pmr new platform mine": "tests/cli/test_start.py::test_a_new_scene_is_accepted_and_has_the_folders_name",
    "pmr matrices job.sti": "tests/peers/test_matrices_in.py",
    "pmr matrices part.pch": "tests/files/test_nastran.py",
    "pmr matrices part.pch --damping-name BAAX": "tests/files/test_foreign.py",
    "pmr run SCENE --tolerance 1%": "tests/compare/accuracy/test_order.py",
    "pmr run SCENE --cache DIR": "tests/ways/test_ways.py",
    "pmr export three.npz --to fmu --platforms all": "tests/export/fmi/test_unit.py",
    "pmr export three.npz --to fmu --sources": "tests/export/fmi/test_unit.py",
    "sbatch --ntasks=65 workflows/study.slurm STUDY.toml": "tests/cli/test_study.py",
    "sbatch --ntasks=65 workflows/study.slurm STUDY.toml reports/study": "tests/cli/test_study.py",
    "sbatch workflows/scale.slurm 0.0125 1 2 4 8 16 32 64": "tests/benchmarks/test_scale.py",
    "mpirun -n 4 pmr run SCENE.toml": "tests/test_run.py",
    "pmr study STUDY.toml --list": "tests/cli/test_study.py",
    "pmr identify SCENE --measured frequencies.csv --fit body.profile.length=0.5": (
        "tests/cli/test_identify.py::test_the_scene_is_written_with_the_values_that_its_frequencies_have"
    ),
    "pmr observe SYSTEM.npz --scene SCENE.toml --measured day.csv --observer sensors.toml --leave-out": (
        "tests/observe/test_measured.py"
    ),
    "pmr export SYSTEM.npz --to fmu --observer sensors.toml": (
        "tests/export/fmi/test_observer.py::test_the_command_writes_it_and_other_formats_refuse_an_observer"
    ),
    "mpiexec -n 65 python -m mpi4py.futures -m pmr study coordinates": "tests/cli/test_study.py",
}
#: Of which something is left out where the text goes on about it.
PARTS = {"pmr new boom", "pmr new crane", "pmr export system.npz"}
MEASURES = "it measures, on a quiet machine: its module is looked up here"
#: What no test runs, and why.
NOT_RUN = {
    "pmr run": "a scene that comes along, half a minute to some minutes: it is loaded here, with what is set",
    "pmr study": "a study that comes along, a minute to an hour: its runs are planned here",
    "make": "it sets up, tests or measures: its target is looked up here",
    "pip install": "it needs an index: its extras are looked up here",
    **dict.fromkeys(
        (
            "python -m benchmarks",
            *(f"python -m benchmarks.{name}" for name in ("walls", "before_after", "kernel", "latency")),
        ),
        MEASURES,
    ),
    "ccx": "it is another program, which make test-peers runs",
    "pmr --install-completion": "it changes the shell of who calls it",
}


@cache
def commands() -> dict[str, list[str]]:
    """All commands that say what they are done to, a line or a piece of code each, with the pages that have them."""
    found = dict[str, list[str]]()
    for page in PAGES:
        text = page.read_text()
        lines = re.findall(rf"^(?: {{4}})?(?:\$ )?({PROGRAM} [^#\n]*)", text, flags=re.M)
        pieces = re.findall(rf"`({PROGRAM} [^`]+)`", text.replace("\n", " "))
        for command in (one for text in (*lines, *pieces) for one in text.split(" && ")):
            if not mentioned(command := " ".join(command.split())):
                found.setdefault(command, []).append(page.name)
    return found


def mentioned(command: str) -> bool:
    """Whether it is a command's name, maybe with an option, without what it is done to."""
    name = r"(mpirun -n 2 )?pmr [a-z]+( --[a-z-]+( [a-z0-9-]+)?)?"
    return re.fullmatch(name, command) is not None or command in PARTS


def in_tutorials() -> set[str]:
    """Commands in blocks of the tutorials, which `test_tutorials` runs one by one."""
    blocks = [
        block
        for page in TUTORIALS.glob("*.md")
        for block in re.findall(r"^```\n(.*?)^```$", page.read_text(), flags=re.S | re.M)
    ]
    return {" ".join(block.splitlines()[0].removeprefix("$ ").split()) for block in blocks}


@cache
def in_fresh_environments() -> set[str]:
    """Commands that `.ci/manual` runs as they stand."""
    manual = runpy.run_path(str(ROOT / ".ci" / "manual"))
    said = [(page, one.text) for page in PAGES for one in manual["steps"](page) if not one.file]
    return {text for page, text in said if not manual["left"](page, text)}


@pytest.mark.parametrize("command", commands())
def test_a_command_is_run_or_it_is_said_why_not(command: str) -> None:
    if command in RUN or command in in_tutorials() or command in in_fresh_environments():
        return
    if command in TESTED:
        file, _, name = TESTED[command].partition("::")
        assert (ROOT / file).exists()
        assert not name or f"def {name}(" in (ROOT / file).read_text()
        return
    reason = [start for start in NOT_RUN if f"{command} ".startswith(f"{start} ")]
    assert reason, f"{commands()[command]}: run it in RUN of this file, or say in TESTED or NOT_RUN who does or why not"
    words = shlex.split(command)
    if command.startswith("pmr run "):
        changes = [words[k + 1] for k, word in enumerate(words) if word == "--set"]
        assert scenes.load_any(scene_file(Path(words[2])), changes).title
    elif command.startswith("pmr study "):
        assert study_file(ROOT / words[2] if "/" in words[2] else Path(words[2])).is_file()  # test_workflows plans each
    elif command.startswith("make "):
        assert re.search(rf"^{words[1]}:", (ROOT / "Makefile").read_text(), flags=re.M)
    elif words[:2] == ["pip", "install"] and words[2].startswith("."):
        extras = re.findall(r"[a-z]+", words[2])
        assert set(extras) <= set(
            tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
        )
    elif command.startswith("pip install "):
        assert (
            words[2] in (ROOT / "pyproject.toml").read_text() or words[2] in (ROOT / "docs" / "matrices.md").read_text()
        )
    elif command.startswith("python -m benchmarks"):
        parts = words[2].split(".")
        assert (ROOT / Path(*parts)).is_dir() or (ROOT / Path(*parts)).with_suffix(".py").is_file()


def test_commands_have_the_options_that_the_manual_gives_them() -> None:
    group: Any = typer.main.get_command(app)
    for command in (one for one in commands() if one.startswith("pmr ")):
        words = shlex.split(command)
        found = group if words[1].startswith("-") else group.commands[words[1]]
        known = {name for one in found.params for name in (*one.opts, *one.secondary_opts)}
        assert {word for word in words if word.startswith("--")} <= known, command


def test_what_stands_here_is_in_the_manual() -> None:
    own = {"pmr new telescope telescope", "pmr new platform platform", "pmr study coordinates --list"}
    assert {*RUN, *TESTED} - own <= set(commands()) | in_tutorials()


def test_what_fresh_environments_leave_out_is_in_the_manual() -> None:
    manual = runpy.run_path(str(ROOT / ".ci" / "manual"))
    said = [f"{page.stem}: {one.text}" for page in PAGES for one in manual["steps"](page) if not one.file]
    run = [one for one in said if not any(re.fullmatch(pattern, one) for pattern in manual["LEFT"])]
    assert {"first_boom: pmr run mine", "saved_models: pip install .", "README: python of_README.py"} <= set(run)
    for pattern in (*manual["LEFT"], *manual["LONG"]):
        assert any(re.fullmatch(pattern, one) for one in said), pattern


def test_no_page_brings_in_the_package_of_someone_else() -> None:
    """On the public index `pmr` is another project; ours is pmr-booms."""
    pages = [
        *(ROOT / "docs").rglob("*.md"),
        *ROOT.glob("*.md"),
        *(ROOT / "pmr").rglob("*.py"),
        *(ROOT / "docs").rglob("*.py"),
    ]
    assert not [page for page in pages if re.search(r"""pip install ["']?pmr["'\[ ]""", page.read_text())]


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_commands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, run_command) -> None:
    monkeypatch.chdir(tmp_path)
    for command, short in RUN.items():
        done = run_command(*shlex.split(f"{command} {short}")[1:])
        assert done.returncode == 0, (command, done.stderr)
    assert (tmp_path / "body.SID_FEM").is_file()
