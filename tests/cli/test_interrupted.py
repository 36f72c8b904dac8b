"""A run that is killed, or has no room left, leaves the results that were there or its own, whole."""

import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from processes import UNDRAWN, undrawn

from pmr import ReducedModel, RunResult
from pmr.files.whole import finish_swap

SIMPLE = "workflows/paper_simple.toml"
SHORT = ["--set", "mesh.elements=20", "--set", "time.step=0.01", "--set", "compare.against=['full']"]
OLD, NEW = 19, 20  # coordinates
#: Twenty kills take six minutes; `PMR_SWEEP=full` has them all.
KILLS = range(20) if os.environ.get("PMR_SWEEP") == "full" else (1,)
#: The command where files may have so many bytes: enough for a reduced model, too few for trajectories.
NO_ROOM = """
import resource, sys
from pmr.cli.app import main
import pmr.fem.compat  # MPI has files of its own
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
sys.argv[0] = "pmr"
main()
"""


def command(folder: Path, coordinates: int) -> list[str]:
    return ["run", SIMPLE, "--out", str(folder), *SHORT, "--set", f"reduction.coordinates={coordinates}"]


def ran(folder: Path, coordinates: int) -> None:
    undrawn(*command(folder, coordinates)).check_returncode()


def digests(folder: Path) -> dict[str, str]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def coordinates(folder: Path) -> set[int]:
    """What each of the files in a folder says of their number."""
    result = RunResult.load(folder)
    found = {ReducedModel.load(folder / "reduced.npz").size, result.body.shapes.shapes.shape[1]}
    found |= {result.scene.reduction.coordinates, result.summary["coordinates"]["reduced"]}
    return found | {json.loads((folder / "scene.json").read_text())["reduction"]["coordinates"]}


@dataclass(frozen=True)
class Old:
    """Results that are there already, and the seconds that they took."""

    folder: Path
    took: float


@pytest.fixture(scope="module")
def old(tmp_path_factory: pytest.TempPathFactory) -> Old:
    folder, begin = tmp_path_factory.mktemp("old"), time.perf_counter()
    ran(folder, OLD)
    took = time.perf_counter() - begin
    (folder / "notes.txt").write_text("mine")
    assert coordinates(folder) == {OLD}
    return Old(folder, took)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_run_may_be_killed_at_any_time(old: Old, tmp_path: Path, run_command) -> None:
    rng = np.random.default_rng(19)
    before, outcomes = digests(old.folder), []
    for k in KILLS:
        folder = tmp_path / str(k)
        shutil.copytree(old.folder, folder)
        process = subprocess.Popen([sys.executable, "-c", UNDRAWN, *command(folder, NEW)], stdout=subprocess.DEVNULL)
        if k % 2:  # while it writes
            while process.poll() is None and not list(folder.glob(".pmr-new-*")):
                time.sleep(0.0005)
            time.sleep(rng.uniform(0.0, 0.05))
        else:
            time.sleep(old.took * rng.uniform())
        process.send_signal(signal.SIGKILL)
        process.wait()
        finish_swap(folder)
        found = coordinates(folder)
        outcomes.append(found)
        assert found in ({OLD}, {NEW})
        if found == {OLD}:
            assert {name: value for name, value in digests(folder).items() if "checkpoint" not in name} == before
        assert run_command(*command(folder, NEW)).returncode == 0
        assert coordinates(folder) == {NEW}
        left = {path.name for path in folder.iterdir()}
        assert left == {path.name for path in old.folder.iterdir()}  # no rest, and the notes
    print(f"old {outcomes.count({OLD})}, new {outcomes.count({NEW})}")  # noqa: T201  (counts of a sweep)


@pytest.mark.slow
def test_no_room_is_one_line_and_leaves_the_old_results(old: Old, tmp_path: Path) -> None:
    folder = tmp_path / "full"
    shutil.copytree(old.folder, folder)
    left = subprocess.run(
        [sys.executable, "-B", "-c", NO_ROOM, *command(folder, NEW)], check=False, capture_output=True, text=True
    )
    assert left.returncode == 1
    assert left.stderr.splitlines()[-1] == f"pmr: {folder} could not be written: File too large"  # behind stages
    assert digests(folder) == digests(old.folder)
