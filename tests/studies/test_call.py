"""Whole studies of small tasks: sharing, interruption, failures, and tables that do not depend on any of it."""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pytest
import study_tasks
from processes import python
from pydantic import Field
from study_tasks import COUNT, FREE, SLEPT, Squares, run
from waiting import is_alive, wait_until

from pmr.cli import study as cli_study
from pmr.errors import duration_text
from pmr.files import npz
from pmr.studies.call import Progress
from pmr.studies.study import Store, StudyBase, StudyResults
from pmr.studies.tasks import Plan, Task

PROGRAM = str(Path(study_tasks.__file__))
TABLES = ("runs.csv", "runs.npz")
ONCE = [str(x) for x in range(COUNT)]
RUNS = COUNT - 1 + 3 + 1


class Listed(StudyBase):
    """A study of the tasks given in Python."""

    kind: Literal["listed"] = "listed"
    title: str = "Listed"
    model_config = StudyBase.model_config | {"arbitrary_types_allowed": True}
    tasks: Annotated[Plan, Field(exclude=True)]  # functions are not for summary.json

    def plan(self) -> Plan:
        return self.tasks


def calls(folder: Path) -> list[str]:
    return sorted((folder / "calls").read_text().split(), key=int)


def stored(folder: Path) -> dict[str, Path]:
    """Files of results, by the key of the task."""
    store = Store(folder / "tasks")
    return {npz.pop_header(npz.read(file))["key"]: file for file in store.folder.glob("*.npz")}


def tables(folder: Path) -> list[bytes]:
    return [(folder / name).read_bytes() for name in TABLES]


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The study of squares, on two workers."""
    folder = tmp_path_factory.mktemp("done")
    run(folder, Squares(log=folder / "calls", seconds=SLEPT))
    assert calls(folder) == ONCE
    return folder


@pytest.mark.slow
def test_all_runs_have_the_figures_of_what_they_need(done: Path) -> None:
    results = StudyResults.load(done)
    assert results.is_complete and len(results.runs) == RUNS
    assert results.column("total")[3:6].tolist() == [1.0, 5.0, 13.0] and np.isnan(results.column("total")[-1])


@pytest.mark.slow
def test_a_task_has_one_thread_and_one_rank_of_its_own(done: Path) -> None:
    assert StudyResults.load(done).runs[-1].figures == {"threads": "1", "ranks": 1, "input": ""}


def test_the_table_holds_the_plan_in_its_order(done: Path) -> None:
    lines = (done / "runs.csv").read_text().splitlines()
    assert lines[0] == "run,status,reason,x,square,is_large,total,threads,ranks,input,warnings"
    assert lines[4] == "sum-0,done,,0,,,1.0,,,," and lines[3] == "x=2,done,,2,4.0,false,,,,,"
    with np.load(done / "runs.npz", allow_pickle=False) as table:
        assert list(table) == lines[0].split(",")
        assert table["x"][:-1].tolist() == [0, 1, 2, *range(COUNT - 1)] and table["run"][3] == "sum-0"
    seconds = (done / "seconds.csv").read_text().splitlines()
    assert seconds[0] == "run,task,slept" and float(seconds[1].split(",")[1]) >= SLEPT


def test_the_summary_holds_one_record_a_run(done: Path) -> None:
    summary = json.loads((done / "summary.json").read_text())
    assert summary["kind"] == "squares" and summary["versions"]["pmr"]
    last = summary["runs"][2]
    assert (last["key"], last["status"], last["parameters"]) == ("x=2", "done", {"x": 2})
    assert last["figures"] == {"square": 4.0, "is_large": False} and last["seconds"]["slept"] == 0.1
    assert StudyResults.load(done).arrays("x=2")["powers"].tolist() == [1.0, 2.0, 4.0, 8.0]


@pytest.mark.slow
def test_one_worker_makes_the_same_table_as_two(done: Path, tmp_path: Path) -> None:
    run(tmp_path, Squares(log=tmp_path / "calls"), jobs=1)
    assert tables(tmp_path) == tables(done)


@pytest.mark.slow
def test_ranks_make_the_same_table(done: Path, tmp_path: Path) -> None:
    finished = python("-m", "mpi4py.futures", PROGRAM, str(tmp_path), "1", ranks=3)
    assert finished.returncode == 0, finished.stderr
    assert tables(tmp_path) == tables(done) and calls(tmp_path) == ONCE


@pytest.mark.slow
def test_plain_mpiexec_does_too(done: Path, tmp_path: Path) -> None:
    finished = python(PROGRAM, str(tmp_path), "1", ranks=2)
    assert finished.returncode == 0, finished.stderr
    assert tables(tmp_path) == tables(done) and calls(tmp_path) == ONCE


@pytest.mark.slow
def test_killed_half_way_it_goes_on_and_repeats_nothing(done: Path, tmp_path: Path) -> None:
    hold = tmp_path / "hold"
    hold.mkdir()
    child = subprocess.Popen([sys.executable, PROGRAM, str(tmp_path), "2"])
    wait_until(lambda: len(list(hold.iterdir())) == 2, child)
    workers = [int(file.name) for file in hold.iterdir()]
    child.kill()
    child.wait()
    wait_until(lambda: not any(map(is_alive, workers)))  # they go by themselves
    before, interrupted = set(stored(tmp_path)), calls(tmp_path)
    assert FREE <= len(before) < 2 * COUNT and not (tmp_path / "runs.csv").exists()
    shutil.rmtree(hold)
    again = python(PROGRAM, str(tmp_path), "2")
    assert again.returncode == 0, again.stderr
    assert tables(tmp_path) == tables(done)
    repeated = {x for x in calls(tmp_path) if calls(tmp_path).count(x) > 1}
    assert not repeated & {key.removeprefix("x=") for key in before}
    assert repeated <= set(interrupted)


def test_called_again_it_computes_nothing(done: Path) -> None:
    before = tables(done), calls(done)
    outcome = run(done, Squares(log=done / "calls", seconds=SLEPT))
    assert outcome.computed == 0 and outcome.is_complete
    assert (tables(done), calls(done)) == before


def copied(done: Path, folder: Path) -> Squares:
    """The study whose results `folder` then holds."""
    shutil.copytree(done, folder, dirs_exist_ok=True)
    return Squares(log=done / "calls", seconds=SLEPT)


@pytest.mark.slow
def test_only_what_a_missing_run_needs_is_computed_again(done: Path, tmp_path: Path) -> None:
    study, file = copied(done, tmp_path), stored(tmp_path)
    file["x=5"].unlink()  # nobody asks for its row
    assert run(tmp_path, study).computed == 0
    file["sum-5"].unlink()
    assert run(tmp_path, study, jobs=1).computed == 2


@pytest.mark.slow
def test_a_damaged_result_is_computed_again(done: Path, tmp_path: Path) -> None:
    """Cut off, with flipped bits, emptied, and that of another task."""
    study, file = copied(done, tmp_path), stored(tmp_path)
    cut, flipped, another = (bytearray(file[key].read_bytes()) for key in ("sum-3", "sum-4", "sum-7"))
    flipped[len(flipped) // 2] ^= 0xFF
    damaged = {"sum-3": cut[:-40], "sum-4": flipped, "sum-5": b"", "sum-6": another}
    for key, content in damaged.items():
        file[key].write_bytes(content)
    assert run(tmp_path, study, jobs=1).computed == len(damaged)
    assert tables(tmp_path) == tables(done)


@pytest.mark.slow
def test_a_failing_run_is_recorded_and_the_others_go_on(tmp_path: Path) -> None:
    square, add, fail = study_tasks.square, study_tasks.add, study_tasks.fail
    plan = Plan(
        (
            Task("bad", fail, parameters={"x": 1}),
            Task("good", square, {"x": 2}),
            Task("sum", add, {}, {"a": "broken", "b": "good"}),
            Task("sum-of-sum", add, {}, {"a": "sum"}),
            Task("nan", study_tasks.not_finite),
        ),
        shared=(Task("broken", fail, {"other": True}, label="the bearing"),),
    )
    outcome = run(tmp_path, Listed(tasks=plan), jobs=1)
    assert not outcome.is_complete
    found = {r.key: (r.status, r.reason) for r in outcome.results[""].runs}
    broke = "SimulationError: step 17: the bearing broke"
    assert found["bad"] == ("failed", broke) and found["good"] == ("done", "")
    assert found["sum"] == found["sum-of-sum"] == ("skipped", f"needs the bearing, which failed: {broke}")
    assert found["nan"] == ("failed", "ValueError: error = nan is not finite")
    assert (tmp_path / "runs.csv").read_text().splitlines()[1] == f"bad,failed,{broke},1,,,"
    (bad,) = [r for r in json.loads((tmp_path / "summary.json").read_text())["runs"] if r["key"] == "bad"]
    assert "study_tasks.py" in bad["detail"] and "Traceback" in bad["detail"]


@pytest.mark.slow
def test_a_worker_that_dies_fails_its_own_task_only(tmp_path: Path) -> None:
    squares = [Task(f"x={x}", study_tasks.square, {"x": x}) for x in range(6)]
    reasons = {"exit": "exit code 3", "kill": "SIGKILL, no memory left?"}
    dying = [Task(how, study_tasks.die, {"how": how}) for how in reasons]
    outcome = run(tmp_path, Listed(tasks=Plan((*squares[:3], *dying, *squares[3:]))))
    records = {record.key: record for record in outcome.results[""].runs}
    for how, reason in reasons.items():
        dead = records.pop(how)
        assert (dead.status, dead.reason) == ("failed", f"its process died ({reason})") and dead.detail == "last words"
    assert {record.status for record in records.values()} == {"done"}


@pytest.mark.slow
def test_studies_of_one_call_share_what_is_equal(tmp_path: Path) -> None:
    log = tmp_path / "calls"
    outcome = run(tmp_path, Squares(log=log), Squares(log=log, title="Again"), jobs=1)
    assert calls(tmp_path) == ONCE and outcome.is_complete
    assert tables(tmp_path / "part0") == tables(tmp_path / "part1")
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["studies"] == ["part0", "part1"] and len(summary["runs"]) == 2 * RUNS
    assert StudyResults.load(tmp_path).arrays("part1/x=2")["powers"][3] == 8.0
    assert StudyResults.load(tmp_path / "part1").arrays("x=2")["powers"][3] == 8.0


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0 s"), (59.4, "59 s"), (90.0, "2 min"), (3599.0, "60 min"), (9000.0, "2.5 h")]
)
def test_seconds_are_said_as_people_say_them(seconds: float, text: str) -> None:
    assert duration_text(seconds) == text


def test_progress_in_one_line() -> None:
    assert Progress(0, 0, 9, 1.0, None).text == "0 of 9 tasks done after 1 s"
    assert Progress(3, 2, 9, 60.0, 120.0).text == "3 of 9 tasks done, 2 failed or skipped after 1 min, about 2 min left"
    assert Progress(1, 0, 9, 1.0, None, ("row1", "row2")).text == "1 of 9 tasks done after 1 s; now row1, row2"
    assert Progress(9, 0, 9, 60.0, 0.0).text == "9 of 9 tasks done after 1 min"


def test_a_log_gets_a_line_for_each_stage_and_now_and_then(capsys: pytest.CaptureFixture[str]) -> None:
    """One stage begins at once and one after 20 s; later tasks of a stage, and stages of a short study, get no line."""
    with cli_study._show_progress() as watch:
        for second in range(1, 101):
            watch(Progress(1, 0, 2, float(second), None, stages=frozenset({"row"} if second >= 20 else {"postures"})))
    lines = capsys.readouterr().err.splitlines()
    assert lines == [f"1 of 2 tasks done after {text}" for text in ("10 s", "20 s", "50 s", "1 min")]
