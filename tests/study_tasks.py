"""Small tasks for studies, real functions in processes of their own; also a study of them as a program::

python study_tasks.py FOLDER JOBS          (under mpiexec: the ranks are the workers)
"""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from waiting import wait_until

from pmr.errors import SimulationError
from pmr.studies import workers
from pmr.studies.call import Outcome, compute, save
from pmr.studies.files import Part, Project
from pmr.studies.study import StudyBase
from pmr.studies.tasks import Plan, Task, TaskResult

Needs = Mapping[str, TaskResult]
COUNT, FREE = 12, 6
SLEPT = 0.02  # s that a square takes at least


def square(arguments: Mapping[str, Any], needs: Needs) -> TaskResult:
    """x^2, and a line in the log of calls.

    While there is a folder ``hold`` beside the log, only the first `FREE` calls come to an end; the others leave the
    number of their process there.
    """
    if "log" in arguments:
        with open(arguments["log"], "a") as log:
            log.write(f"{arguments['x']}\n")
        _wait_while_held(Path(arguments["log"]))
    time.sleep(arguments.get("seconds", 0.0))
    x = float(arguments["x"])
    return TaskResult({"square": x * x, "is_large": x > 3.0}, {"powers": x ** np.arange(4)}, {"slept": 0.1})


def _wait_while_held(log: Path) -> None:
    hold = log.with_name("hold")
    if hold.exists() and len(log.read_text().split()) > FREE:
        (hold / str(os.getpid())).touch()
        while hold.exists():
            time.sleep(0.01)


def add(arguments: Mapping[str, Any], needs: Needs) -> TaskResult:
    """Sum of the squares that it needs."""
    total = sum(float(need.arrays["powers"][2]) for need in needs.values())
    return TaskResult({"total": total})


def edit(arguments: Mapping[str, Any], needs: Needs) -> TaskResult:
    """Edit a file, as someone does while a study runs."""
    with open(arguments["file"], "a") as file:
        file.write("\n")
    return TaskResult()


def fail(arguments: Mapping[str, Any], needs: Needs) -> TaskResult:
    raise SimulationError("step 17:\n the bearing broke")


def not_finite(arguments: Mapping[str, Any], needs: Needs) -> TaskResult:
    return TaskResult({"fine": 1.0, "error": np.float64("nan")})


def die(arguments: Mapping[str, Any], needs: Needs) -> TaskResult:
    print("last words", flush=True)
    if arguments["how"] == "exit":
        os._exit(3)
    os.kill(os.getpid(), signal.SIGKILL)
    return TaskResult()


def sleep(arguments: Mapping[str, Any], needs: Needs) -> TaskResult:
    """Leave the number of its process, then take long."""
    Path(arguments["file"]).write_text(str(os.getpid()))
    time.sleep(10_000.0)
    return TaskResult()


def interval(arguments: Mapping[str, Any], needs: Needs) -> TaskResult:
    """When it began and ended, in s of one clock for all processes; with a folder to `meet` in, not before two are."""
    begin = time.monotonic()
    time.sleep(0.05)
    if "meet" in arguments:
        meeting = Path(arguments["meet"])
        (meeting / str(arguments["number"])).touch()
        wait_until(lambda: len(list(meeting.iterdir())) > 1)
    return TaskResult(arrays={"interval": np.array([begin, time.monotonic()])})


def surroundings(arguments: Mapping[str, Any], needs: Needs) -> TaskResult:
    """What the task's process looks like."""
    from mpi4py import MPI

    threads = {os.environ.get(name) for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
    found = {"threads": ",".join(map(str, threads)), "ranks": MPI.COMM_WORLD.size, "input": sys.stdin.read()}
    return TaskResult(found)


class Squares(StudyBase):
    """Numbers, each squared once, sums of neighbours that need them, and what a process looks like."""

    kind: Literal["squares"] = "squares"
    title: str = "Squares"
    log: Path
    seconds: float = 0.0

    def plan(self) -> Plan:
        common = {"log": str(self.log), "seconds": self.seconds}
        squares = [Task(f"x={x}", square, {"x": x} | common, parameters={"x": x}) for x in range(COUNT)]
        sums = [
            Task(f"sum-{x}", add, {}, {"left": f"x={x}", "right": f"x={x + 1}"}, {"x": x}) for x in range(COUNT - 1)
        ]
        return Plan((*sums, *squares[:3], Task("here", surroundings)), tuple(squares[3:]))


def project(*studies: StudyBase) -> Project:
    """Studies as one call; a single one stands alone."""
    names = [""] if len(studies) == 1 else [f"part{i}" for i in range(len(studies))]
    parts = [Part(name, study, study.plan()) for name, study in zip(names, studies, strict=True)]
    return Project("Test", "test", tuple(parts))


def run(folder: Path, *studies: StudyBase, jobs: int = 2) -> Outcome:
    """Compute studies on this machine and write their tables."""
    asked = project(*studies)
    with workers.local_pool(jobs) as pool:
        outcome = compute(asked, folder, pool, lambda progress: None)
    save(asked, outcome, folder)
    return outcome


def main(folder: Path, jobs: int) -> None:
    ranks = workers.launched_ranks()
    with workers.rank_pool() if ranks > 1 else workers.local_pool(jobs) as pool:
        if pool is not None:
            asked = project(Squares(log=folder / "calls", seconds=SLEPT))
            save(asked, compute(asked, folder, pool, lambda progress: None), folder)


if __name__ == "__main__":
    import study_tasks  # the workers import this module by its name

    study_tasks.main(Path(sys.argv[1]), int(sys.argv[2]))
