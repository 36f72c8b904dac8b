"""A worker: a child process that runs one task after the other, replaced when it dies.

Tasks never run in the process that plans, nor in one that MPI launched.  So a task that brings its process down (a
crash in compiled code, no memory left) fails alone, it sees the same single thread and the same single MPI process
whether the study runs on one machine or on many, and it computes the same bits.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any, Literal

from pmr.errors import environment

#: Libraries read these when they are loaded.
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS")
#: By these a process takes itself for a rank of its parent's MPI job.
OF_MPI = ("OMPI_", "ORTE_", "PRTE_", "PMIX_", "PMI_", "PMI2_", "HYDI_", "HYDRA_", "MPI_LOCAL", "SLURM_")
#: What no task computes with, by the beginnings of paths within pmr.
NOT_COMPUTING = ("report/", "cli/")
PATIENCE = 10.0  # s for a child to leave by itself
#: What a child runs: it finds modules where its parent does.
START = "import sys; sys.path[:] = sys.argv[1:]; from pmr.studies.engine.execute import main; main()"
LAST_LINES = 20  # that a child which dies leaves behind


@dataclass(frozen=True)
class Order:
    """A task as text: what to call, with what, and where results are.

    `code` is the digest of the code that it was planned by, see `code_of_tasks`; empty where any will do.
    """

    key: str
    digest: str
    address: str
    arguments: Mapping[str, Any]
    needs: Mapping[str, str]  # name for the function -> digest
    store: str
    code: str = ""


def code_of_tasks() -> str:
    """Digest of the code that tasks compute with, as it stands in its files now."""
    return environment.code_digest(environment.sources(), NOT_COMPUTING)


@dataclass(frozen=True)
class Answer:
    """How it went; the result itself is in the store.

    `reason` is one line, the same wherever the task fails; `detail` is what helps to find out why.
    """

    status: Literal["done", "failed"]
    seconds: float
    reason: str = ""
    detail: str = ""


class Worker:
    """The parent's side of one child process; `path` is where the child finds modules, as in ``sys.path``."""

    def __init__(self, path: Sequence[str]) -> None:
        self._path = list(path)
        self._log = tempfile.TemporaryFile("a+b")
        self._child: subprocess.Popen[str] | None = None

    def run(self, order: Order) -> Answer:
        """Have a task done; the result is in the store when this returns ``"done"``."""
        child = self._child if self._child is not None and self._child.poll() is None else self._start()
        self._log.seek(0)  # the child writes where its parent has stopped to read
        self._log.truncate()
        begin = time.perf_counter()
        assert child.stdin is not None and child.stdout is not None
        try:
            child.stdin.write(json.dumps(asdict(order)) + "\n")
            child.stdin.flush()
            line = child.stdout.readline()
        except BrokenPipeError:
            line = ""
        if line:
            return Answer(**json.loads(line))
        code = child.wait()
        return Answer("failed", time.perf_counter() - begin, f"its process died ({_cause(code)})", self._last_words())

    def close(self) -> None:
        """Let the child leave; it takes no part of a task with it that is not done."""
        if self._child is not None:
            assert self._child.stdin is not None
            with suppress(BrokenPipeError):
                self._child.stdin.close()
            try:
                self._child.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                self._child.kill()
                self._child.wait()

    def _start(self) -> subprocess.Popen[str]:
        variables = {name: value for name, value in os.environ.items() if not name.startswith(OF_MPI)}
        variables |= dict.fromkeys(ONE_THREAD, "1")
        self._child = subprocess.Popen(
            [sys.executable, "-c", START, *self._path],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
            env=variables,
        )
        return self._child

    def _last_words(self) -> str:
        self._log.seek(0)
        return "\n".join(self._log.read().decode(errors="replace").splitlines()[-LAST_LINES:])


def _cause(code: int) -> str:
    if code >= 0:
        return f"exit code {code}"
    name = signal.Signals(-code).name
    return f"{name}, no memory left?" if name == "SIGKILL" else name
