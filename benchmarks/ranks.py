"""Run a module in processes of its own, on one rank or several, and stop it if it takes too much."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, Any

#: Seconds between two looks at a run's memory, and bytes that are left to all others on the machine.
LOOK, LEFT = 0.5, 2**30
#: This checkout.
HERE = Path(__file__).resolve().parents[1]
_PAGE = os.sysconf("SC_PAGE_SIZE")
MPI_SETTINGS = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "OMPI_MCA_mpi_yield_when_idle": "1",
    "OMPI_MCA_hwloc_base_binding_policy": "none",
    "OMPI_MCA_btl_vader_single_copy_mechanism": "none",
}


@dataclass(frozen=True)
class Bounds:
    """Limits of a run: wall seconds, and bytes of memory of all ranks together (without limit by default)."""

    seconds: float
    memory: float = float("inf")


def record_of(
    module: str, arguments: Sequence[str], ranks: int, bounds: Bounds, checkout: Path = HERE
) -> dict[str, Any]:
    """Run ``python -m module arguments`` on some ranks, and return the last JSON line that it prints.

    If it prints none or is stopped, ``{"notes": [reason]}`` is returned.
    """
    command = [sys.executable, "-m", module, *arguments]
    if ranks > 1:
        command = [_launcher(), "-n", str(ranks), *command]
    environment = os.environ | MPI_SETTINGS | {"OMP_NUM_THREADS": "1"}
    with TemporaryFile("w+") as out, TemporaryFile("w+") as complaints:
        run = subprocess.Popen(
            command, cwd=checkout, env=environment, stdout=out, stderr=complaints, start_new_session=True
        )
        try:
            stopped = _watched(run, bounds)
        finally:
            _end(run)
        lines = [line for line in _lines(out) if line.startswith("{")]
        if stopped is None and lines:
            return json.loads(lines[-1])
        why = stopped or f"failed: {_reason(_lines(complaints)) or f'it ended with {run.returncode}'}"
    return {"notes": [why]}


def _reason(complaints: list[str]) -> str:
    """Last line that names an error, or else the last one with words; launchers frame messages by lines of dashes."""
    in_words = [line for line in complaints if any(letter.isalpha() for letter in line)]
    errors = [line for line in in_words if re.match(r"[\w.]*(Error|Exception)\b", line)]
    return (errors or in_words or [""])[-1]


def _launcher() -> str:
    """Command that launches MPI processes."""
    # The launcher that belongs to this Python's MPI stands beside it, where pip brought MPI along.
    beside = Path(sys.executable).parent / "mpiexec"
    return str(beside) if beside.is_file() else shutil.which("mpirun") or "mpirun"


def _watched(run: subprocess.Popen[bytes], bounds: Bounds) -> str | None:
    """Wait for the end of a run; return why it has to be stopped, or None if it ended by itself."""
    begin = time.perf_counter()
    while True:
        try:
            run.wait(LOOK)
            return None
        except subprocess.TimeoutExpired:
            memory = sum(_resident(process) for process in _session(run.pid))
        if time.perf_counter() - begin > bounds.seconds:
            return f"stopped after {bounds.seconds:g} s"
        if memory > bounds.memory:
            return f"stopped at {memory / 2**30:.1f} GiB of memory"
        if bounds.memory < float("inf") and _available() < LEFT:
            return f"stopped at {memory / 2**30:.1f} GiB of memory: others on the machine needed the rest"


def _end(run: subprocess.Popen[bytes]) -> None:
    """Kill all processes of the run's session that are still there: launchers put ranks into other process groups."""
    if run.poll() is None:
        for process in _session(run.pid):
            try:
                os.kill(process, signal.SIGKILL)
            except ProcessLookupError:
                continue
    run.wait()


def _session(leader: int) -> list[int]:
    """Numbers of the processes in the session of the process `leader`."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:  # gone meanwhile
            continue
        if int(fields[3]) == leader:
            found.append(int(folder.name))
    return found


def _available() -> int:
    """Bytes of the machine's memory that are free for new work."""
    (line,) = [line for line in Path("/proc/meminfo").read_text().splitlines() if line.startswith("MemAvailable")]
    return 1024 * int(line.split()[1])


def _resident(process: int) -> int:
    """Bytes of memory that a process uses; 0 if it has ended."""
    try:
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * _PAGE
    except OSError:
        return 0


def _lines(file: IO[str]) -> list[str]:
    """Lines of a file that are not empty, from its beginning."""
    file.seek(0)
    return [line.strip() for line in file.read().splitlines() if line.strip()]
