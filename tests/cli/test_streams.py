"""Standard output that is full or closed: results are computed and stored, and what was not printed is said.
What a run prints while it computes, where there is no terminal.
The command of earlier versions, which scripts may still call.
"""

import subprocess
import sys
from pathlib import Path

import pytest
from processes import COMMAND, UNDRAWN, called
from waiting import PATIENCE

FULL = "pmr: standard output: No space left on device; results that go to files are there\n"
SHORT = ["mesh.elements=8", "reduction.coordinates=9", "time.end=0.1", "simulation.simulators=['march']"]


def under(redirection: str, *arguments: str, code: str = COMMAND) -> subprocess.CompletedProcess[str]:
    """The command with its streams redirected as a shell does it."""
    shell = ["sh", "-c", f'exec "$@" {redirection}', "sh", sys.executable, "-c", code, *arguments]
    return subprocess.run(shell, capture_output=True, text=True, check=False, timeout=PATIENCE)


LONG = [pytest.param(one, marks=pytest.mark.slow) for one in (["schema"], ["study", "coordinates", "--list"])]


@pytest.mark.parametrize("arguments", [["--version"], *LONG])
def test_what_a_full_disk_does_not_take_is_said(arguments: list[str]) -> None:
    done = under(">/dev/full", *arguments)
    assert (done.returncode, done.stderr) == (1, FULL)


def test_help_names_the_places_that_need_room() -> None:
    done = under(">/dev/full", "--help")
    assert done.returncode == 1 and done.stderr.count("\n") == 1
    assert done.stderr.startswith("pmr: No space left on device: free space is needed for standard output")


@pytest.mark.slow
@pytest.mark.parametrize("redirection", [">&-", "2>&-", "<&- >&- 2>&-", "2>/dev/full"])
def test_a_stream_that_is_closed_or_full_changes_no_exit_code(redirection: str) -> None:
    assert under(redirection, "schema" if redirection == ">&-" else "--version").returncode == 0
    wrong = under(redirection, "run", "nowhere.toml")
    assert wrong.returncode == 2
    assert wrong.stderr == ("pmr: nowhere.toml: no such scene file\n" if redirection == ">&-" else "")


@pytest.mark.slow
@pytest.mark.parametrize(("redirection", "code", "says"), [(">/dev/full", 1, FULL), (">&-", 0, "")])
def test_a_run_stores_all_it_computes(redirection: str, code: int, says: str, tmp_path: Path) -> None:
    keys = [part for key in [*SHORT, "compare.against=[]"] for part in ("--set", key)]
    done = under(redirection, "run", "paper_simple", "--out", str(tmp_path), *keys, code=UNDRAWN)
    assert (done.returncode, done.stderr) == (code, says)
    assert {"summary.json", "report.html", "report.pdf", "trajectories.npz"} <= {
        file.name for file in tmp_path.iterdir()
    }


SHORT_PROGRESS = ("--set", "compare.against=[]", "--set", "time.end=0.05", "--set", "mesh.elements=10")


def stages(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], folder: Path, quiet: float
) -> list[str]:
    """Stages of a short run, as the lines on standard error name them."""
    monkeypatch.setattr("pmr.cli.run.QUIET", quiet)
    done = called(monkeypatch, capsys, "run", "boom_beam", *SHORT_PROGRESS, "--out", str(folder))
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stderr.splitlines() if line.startswith(("boom_beam: ", "report: "))]
    return [line.partition(", after ")[0] for line in lines]


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_long_run_says_each_stage_once_and_a_short_one_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], unmeasured
) -> None:
    unmeasured(True)
    found = stages(monkeypatch, capsys, tmp_path, quiet=0.0)
    assert found[0] == "boom_beam: now assembly of the full model" and found[-1] == "report: now pages and figures"
    assert len(found) == len(set(found)) > 4
    assert not stages(monkeypatch, capsys, tmp_path, quiet=1000.0)


def test_nothing_is_to_be_compiled(run_command) -> None:
    done = run_command("compile")
    assert done.returncode == 0 and done.stdout.startswith("nothing is to be compiled")
