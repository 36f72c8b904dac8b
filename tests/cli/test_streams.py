"""Standard output that is full or closed: results are computed and stored, and what was not printed is said."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from processes import COMMAND, UNDRAWN
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
