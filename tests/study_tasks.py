"""Small tasks for studies, as functions in processes of their own; also a study of them as a program::

python study_tasks.py FOLDER JOBS          (under mpiexec: the ranks are the workers)
"""

import os
import signal
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pmr import SimulationError
from pmr.studies import workers
from pmr.studies.call import Outcome, PlannedStudy, Project, compute_results, save
from pmr.studies.study import StudyBase
from pmr.studies.tasks import Plan, Task, TaskResult

Needs = Mapping[str, TaskResult]
COUNT, FREE = 12, 6
SLEPT = 0.02  # s that a square takes at least


def square(arguments: Mapping[str, Any], needs: Needs) -> TaskResult:
    """Square x, and write a line to the log of calls if there is one.

    While a folder ``hold`` is beside the log, only the first `FREE` calls end; the others write the numbers of their
    processes into it and wait.
    """
    if "log" in arguments:
        with open(arguments["log"], "a") as log:
            log.write(f"{arguments['x']}\n")
        _wait_while_held(Path(arguments["log"]))
    time.sleep(arguments.get("seconds", 0.0))
    x = float(arguments["x"])
    return TaskResult({"square": x * x, "is_large": x > 3.0}, {"powers": x ** np.arange(4)}, {"slept": 0.1})


def _wait_while_held(log: Path) -> None:
    """Wait while a folder ``hold`` is beside the log, unless this is one of the first `FREE` calls."""
    hold = log.with_name("hold")
    if hold.exists() and len(log.read_text().split()) > FREE:
        (hold / str(os.getpid())).touch()
        while hold.exists():
            time.sleep(0.01)


def add(arguments: Mapping[str, Any], needs: Needs) -> TaskResult:
    """Add the squares that the task needs."""
    total = sum(float(need.arrays["powers"][2]) for need in needs.values())
    return TaskResult({"total": total})


def edit(arguments: Mapping[str, Any], needs: Needs) -> TaskResult:
    """Append to a file, as a user may do while a study runs."""
    with open(arguments["file"], "a") as file:
        file.write("\n")
    return TaskResult()


def fail(arguments: Mapping[str, Any], needs: Needs) -> TaskResult:
    """Raise a SimulationError."""
    raise SimulationError("step 17:\n the bearing broke")


def not_finite(arguments: Mapping[str, Any], needs: Needs) -> TaskResult:
    """Return a value that is NaN."""
    return TaskResult({"fine": 1.0, "error": np.float64("nan")})


def die(arguments: Mapping[str, Any], needs: Needs) -> TaskResult:
    """End the process, by exit code 3 or by a signal."""
    print("last words", flush=True)
    if arguments["how"] == "exit":
        os._exit(3)
    os.kill(os.getpid(), signal.SIGKILL)
    return TaskResult()


def sleep(arguments: Mapping[str, Any], needs: Needs) -> TaskResult:
    """Write the number of the process into a file, then sleep for hours."""
    Path(arguments["file"]).write_text(str(os.getpid()))
    time.sleep(10_000.0)
    return TaskResult()


def surroundings(arguments: Mapping[str, Any], needs: Needs) -> TaskResult:
    """Return threads, ranks and standard input of the task's process."""
    from mpi4py import MPI

    threads = {os.environ.get(name) for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}
    found = {"threads": ",".join(map(str, threads)), "ranks": MPI.COMM_WORLD.size, "input": sys.stdin.read()}
    return TaskResult(found)


class Squares(StudyBase):
    """Study of numbers, each squared once, of sums of neighbours that need these squares, and of a task's process."""

    kind: Literal["squares"] = "squares"
    title: str = "Squares"
    log: Path
    seconds: float = 0.0

    def plan(self) -> Plan:
        """Tasks of the study."""
        common = {"log": str(self.log), "seconds": self.seconds}
        squares = [Task(f"x={x}", square, {"x": x} | common, parameters={"x": x}) for x in range(COUNT)]
        sums = [
            Task(f"sum-{x}", add, {}, {"left": f"x={x}", "right": f"x={x + 1}"}, {"x": x}) for x in range(COUNT - 1)
        ]
        first, last = squares[:3], [Task("here", surroundings)]
        return Plan((*first, *sums, *last), tuple(squares[3:]))


def project(*studies: StudyBase) -> Project:
    """Studies as the parts of one call; a single study has no name."""
    names = [""] if len(studies) == 1 else [f"part{i}" for i in range(len(studies))]
    parts = [PlannedStudy(name, study, study.plan()) for name, study in zip(names, studies, strict=True)]
    return Project("Test", "test", tuple(parts))


def run(folder: Path, *studies: StudyBase, jobs: int = 2) -> Outcome:
    """Compute studies on this machine, write their tables, and return the outcome."""
    asked = project(*studies)
    with workers.local_pool(jobs) as pool:
        outcome = compute_results(asked, folder, pool, lambda progress: None)
    save(asked, outcome, folder)
    return outcome


def main(folder: Path, jobs: int) -> None:
    """Compute the study of squares in a folder, by the ranks of MPI or by `jobs` processes."""
    ranks = workers.count_ranks()
    with workers.rank_pool() if ranks > 1 else workers.local_pool(jobs) as pool:
        if pool is not None:
            asked = project(Squares(log=folder / "calls", seconds=SLEPT))
            save(asked, compute_results(asked, folder, pool, lambda progress: None), folder)


if __name__ == "__main__":
    import study_tasks  # the workers import this module by its name

    study_tasks.main(Path(sys.argv[1]), int(sys.argv[2]))
