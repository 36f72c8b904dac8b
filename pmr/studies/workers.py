"""Workers: child processes that run one task after the other, on this machine or on the ranks that MPI launched.

Tasks never run in the process that plans them, nor in a process that MPI launched.  So a task that ends its process (a
crash in compiled code, no memory left) fails alone.  A task sees one thread and one MPI process whether the study runs
on one machine or on many, and computes the same bits.  A local thread or a rank, called by an executor of
`concurrent.futures`, only passes orders to the child process of one worker.
"""

from __future__ import annotations

import atexit
import importlib
import json
import logging.handlers
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from pmr.errors import InputError, environment
from pmr.studies.study import Store
from pmr.studies.tasks import Failure, TaskResult

#: Environment variables for the number of threads, which libraries read when they are loaded.
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS")
#: Folders of pmr with code that no task computes with.
NOT_COMPUTING = ("report/", "cli/")
PATIENCE = 10.0  # s that a child has to end by itself
#: Program of a child, which finds modules where its parent does.
START = "import sys; sys.path[:] = sys.argv[1:]; from pmr.studies.workers import serve; serve()"
LAST_LINES = 20  # lines of output that are shown of a child that dies
OTHER_CODE = "pmr was edited since the study was planned, or is another one on this machine; call the study again"


@dataclass(frozen=True)
class Order:
    """A task as text: its function, arguments, the digests of results that it needs, and the folder of the store.

    `address` is ``"module:name"`` of the function.  `code` is the digest of the code that planned the task (see
    `code_of_tasks`); if empty, any code may run it.
    """

    key: str  # of the task
    digest: str  # of everything that decides the result; names the file of the result
    address: str
    arguments: Mapping[str, Any]
    needs: Mapping[str, str]  # name that the function uses -> digest of the result
    store: str
    code: str = ""


def code_of_tasks() -> str:
    """Return the digest of the code that tasks compute with, as its files are now."""
    return environment.code_digest(environment.source_texts(), NOT_COMPUTING)


class Worker:
    """One child process, as its parent sees it: started at the first order, and again at the next if it has ended.

    `path` is where the child finds modules, as in ``sys.path``.
    """

    def __init__(self, path: Sequence[str]) -> None:
        self._path = list(path)
        self._log = tempfile.TemporaryFile("a+b")
        self._child: subprocess.Popen[str] | None = None

    def run(self, order: Order) -> Failure | None:
        """Have the child run a task and wait for the end; return None if the result is stored, else the failure.

        If the child dies meanwhile, the failure says so, with the child's last output.
        """
        child = self._child if self._child is not None and self._child.poll() is None else self._start()
        self._log.seek(0)  # parent and child share the file position: the child writes from here on
        self._log.truncate()
        assert child.stdin is not None and child.stdout is not None
        try:
            child.stdin.write(json.dumps(asdict(order)) + "\n")
            child.stdin.flush()
            line = child.stdout.readline()
        except BrokenPipeError:
            line = ""
        if line:
            answer = json.loads(line)
            return None if answer is None else Failure(**answer)
        return Failure(f"its process died ({_exit_cause(child.wait())})", self._last_output())

    def close(self) -> None:
        """Have the child end, and kill it if it still runs after `PATIENCE` seconds.

        A task that runs leaves no result.
        """
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
        """Start a child in which each library has one thread, without environment variables of an MPI launcher."""
        variables = {
            name: value for name, value in os.environ.items() if not name.startswith(environment.MPI_VARIABLES)
        }
        variables |= dict.fromkeys(ONE_THREAD, "1")
        command, pipe = [sys.executable, "-c", START, *self._path], subprocess.PIPE
        self._child = subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=self._log, text=True, env=variables)
        return self._child

    def _last_output(self) -> str:
        """Return the last `LAST_LINES` lines that the child printed since its present order."""
        self._log.seek(0)
        return "\n".join(self._log.read().decode(errors="replace").splitlines()[-LAST_LINES:])


def _exit_cause(code: int) -> str:
    """Return in words why a process ended, from its exit code; a negative `code` is the number of a signal."""
    if code >= 0:
        return f"exit code {code}"
    name = signal.Signals(-code).name
    return f"{name}, no memory left?" if name == "SIGKILL" else name


@dataclass(frozen=True)
class Pool:
    """Workers that run `slots` orders at a time.

    `submit` takes an order and returns a future, whose result is the order's failure, or None if it is done.
    """

    slots: int
    submit: Callable[[Order], Future[Failure | None]]


@contextmanager
def local_pool(jobs: int) -> Iterator[Pool]:
    """Yield a pool of `jobs` worker processes on this machine, each served by one thread; all end with the context."""
    thread, workers = threading.local(), [Worker(sys.path) for _ in range(jobs)]
    unused = iter(workers)

    def start_thread() -> None:
        """Assign the next worker process to the thread that calls this function."""
        thread.worker = next(unused)

    executor = ThreadPoolExecutor(jobs, initializer=start_thread)
    try:
        yield Pool(jobs, lambda order: executor.submit(lambda: thread.worker.run(order)))
    finally:
        executor.shutdown(wait=False, cancel_futures=True)
        for worker in workers:
            worker.close()


@contextmanager
def rank_pool() -> Iterator[Pool | None]:
    """Yield a pool on rank 0, whose workers are all other ranks; yield None on the other ranks.  Collective.

    The other ranks run orders until the context of rank 0 ends.  Only then is None yielded on them.
    """
    from mpi4py import MPI
    from mpi4py.futures import MPICommExecutor

    with MPICommExecutor(MPI.COMM_WORLD, root=0, main=False) as executor:
        if executor is None:
            yield None
        else:
            yield Pool(MPI.COMM_WORLD.size - 1, lambda order: executor.submit(run_on_rank, order, sys.path))


def count_ranks() -> int:
    """Return the number of ranks that a launcher started; 1 if there was no launcher.

    MPI is started only if there are several.  Raises InputError if the launcher belongs to another MPI library than
    mpi4py, so that each process would consider itself the only one.
    """
    ranks = environment.launched_process_count()
    if ranks == 1:
        return 1
    from mpi4py import MPI

    size = int(MPI.COMM_WORLD.size)
    if size == 1:
        library = MPI.Get_library_version().split(",")[0].split("\n")[0].strip()
        allowed = f"the launcher of this Python's own MPI is allowed ({library})"
        raise InputError("command line", "mpiexec", ranks, allowed)
    return size


def run_on_rank(order: Order, path: list[str]) -> Failure | None:
    """Run an order in the child process of this rank; return the failure, or None if the order is done.

    `path` is where the child finds modules.
    """
    return _worker_of_rank(tuple(path)).run(order)


@lru_cache(1)
def _worker_of_rank(path: tuple[str, ...]) -> Worker:
    """Return the worker of this rank, made at the first call; its child ends with this process.

    `path` is where the child finds modules.
    """
    worker = Worker(path)
    atexit.register(worker.close)
    return worker


def serve() -> None:
    """Run the orders of the parent, one per line on standard input; answer each by a line with null or the failure.

    Runs as the child process of a worker until its input ends.  All output of libraries goes to the error stream, so
    that it can't mix with the answers.  When the parent dies, the child ends, too.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides when the child ends
    lines, answers = os.fdopen(os.dup(0)), os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    notes = logging.handlers.BufferingHandler(sys.maxsize)
    notes.setLevel(logging.WARNING)
    logging.getLogger().addHandler(notes)
    orders: queue.SimpleQueue[str | None] = queue.SimpleQueue()
    is_busy = threading.Event()

    def listen() -> None:
        """Queue the orders; end the process if the input ends while a task runs."""
        for line in lines:
            orders.put(line)
        if is_busy.is_set():
            os._exit(1)  # no parent is left that could get the failure
        orders.put(None)

    threading.Thread(target=listen, daemon=True).start()
    while (line := orders.get()) is not None:
        is_busy.set()
        failure = _run_order(Order(**json.loads(line)), notes)
        is_busy.clear()
        try:
            print(json.dumps(failure and asdict(failure)), file=answers, flush=True)  # noqa: T201  (the answer)
        except BrokenPipeError:
            os._exit(1)


def _run_order(order: Order, notes: logging.handlers.BufferingHandler) -> Failure | None:
    """Run an order and write its result into the store; return the failure, or None if all went well.

    If pmr was edited since the order was made, the result is not stored.  `notes` collects the warnings that are logged
    meanwhile, which are added to the warnings of the result.
    """
    notes.flush()
    try:
        needs = {name: _read_result(order.store, digest) for name, digest in order.needs.items()}
        module, _, name = order.address.partition(":")
        function = getattr(importlib.import_module(module), name)
        begin = time.perf_counter()
        result: TaskResult = function(order.arguments, needs)
        seconds = {"task": time.perf_counter() - begin} | dict(result.seconds)
        warnings = dict.fromkeys((*result.warnings, *(record.getMessage() for record in notes.buffer)))
        if order.code not in ("", code_of_tasks()):  # the task's imports may come from edited files
            return Failure(OTHER_CODE)
        complete = replace(result, seconds=seconds, warnings=tuple(warnings))
        Store(Path(order.store)).write(order.digest, order.key, complete)
    except (Exception, SystemExit) as error:
        return Failure.from_error(error)
    return None


@lru_cache(8)  # the next tasks may need the same result
def _read_result(store: str, digest: str) -> TaskResult:
    """Read the result with this digest from the store in the folder `store`."""
    return Store(Path(store)).read(digest)
