"""Judge many mutations in a process of its own, and start another one if a mutation ended it."""

import atexit
import json
import os
import select
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from fuzz.verdict import PATIENCE, Verdict
from fuzz.worker import COMPILED, READY

TESTS = Path(__file__).parents[1]
#: What the process is told: nothing until one has compiled what all of them take.
_told: list[str] = []
#: It, as long as it lives: it ends with its input.
_workers: list[subprocess.Popen[bytes]] = []


def verdicts(kind: str, count: int, first: int = 0) -> Iterator[Verdict]:
    """Yield the verdict on each mutation, in order."""
    number = first
    while number < first + count:
        for verdict in _one_process(kind, number, first + count):
            yield verdict
            number = verdict.number + 1
        if number < first + count:
            yield Verdict(number, "died", 0.0, "the process ended, or hung")
            number += 1


def summary(found: list[Verdict]) -> str:
    """Counts of verdicts, and every fault with its number."""
    counts = Counter(verdict.kind for verdict in found)
    faults = [f"\n--- {v.number}: {v.kind} after {v.seconds:.1f} s\n{v.detail}" for v in found if not v.is_sound]
    slowest = max((v.seconds for v in found), default=0.0)
    return f"{len(found)} mutations: {dict(counts)}; the slowest took {slowest:.1f} s" + "".join(faults)


def _one_process(kind: str, number: int, end: int) -> Iterator[Verdict]:
    """Yield verdicts of one process, until all are judged or it ends or hangs."""
    child = _workers.pop() if _workers and _workers[-1].poll() is None else _started()
    assert child.stdin is not None and child.stdout is not None
    judged = number
    try:
        child.stdin.write(f"{' '.join([kind, str(number), str(end), *_told])}\n".encode())
        said = child.stdout.readline().decode().strip()
        assert said in (READY, COMPILED), f"what is compiled for {kind} could not be prepared"
        if said == COMPILED:
            _told[:] = [COMPILED]
        while judged < end and select.select([child.stdout], [], [], 2 * PATIENCE)[0]:
            if not (line := child.stdout.readline()):
                break
            judged += 1
            yield Verdict(**json.loads(line))
    finally:
        if judged == end:
            _workers.append(child)
        else:
            child.kill()
            child.wait()


@atexit.register
def _ended() -> None:
    """End the processes that are still there."""
    for child in _workers:
        child.communicate()


def _started() -> subprocess.Popen[bytes]:
    """Start a process that judges."""
    paths = [str(TESTS), str(TESTS.parent), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths), "OMP_NUM_THREADS": "1"}
    pipes: dict = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
    # no line waits unseen
    return subprocess.Popen([sys.executable, "-m", "fuzz.worker"], env=environment, bufsize=0, **pipes)


if __name__ == "__main__":
    asked, many, start = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]) if len(sys.argv) > 3 else 0
    everything = []
    for each in verdicts(asked, many, start):
        everything.append(each)
        if each.number % 50 == 49:
            print(f"{each.number + 1} judged", flush=True)
        if not each.is_sound:
            print(f"--- {each.number}: {each.kind} after {each.seconds:.1f} s\n{each.detail}", flush=True)
    print(summary(everything).partition("\n")[0])
