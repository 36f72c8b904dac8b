"""Where tasks are spread: over processes of this machine, or over the ranks that MPI launched.

Both are executors of `concurrent.futures`; a local thread or a rank only looks after the child process of one worker.
"""

from __future__ import annotations

import atexit
import queue
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass

from pmr.errors import InputError, environment
from pmr.studies.engine.worker import Answer, Order, Worker


@dataclass(frozen=True)
class Pool:
    """Something that has orders done some time, `slots` at a time."""

    slots: int
    submit: Callable[[Order], Future[Answer]]


@contextmanager
def local_pool(jobs: int) -> Iterator[Pool]:
    """Workers on this machine, each looked after by a thread, started as they are needed and gone in the end."""
    workers = [Worker(sys.path) for _ in range(jobs)]
    idle: queue.SimpleQueue[Worker] = queue.SimpleQueue()
    for worker in workers:
        idle.put(worker)

    def run(order: Order) -> Answer:
        worker = idle.get()
        try:
            return worker.run(order)
        finally:
            idle.put(worker)

    executor = ThreadPoolExecutor(jobs)
    try:
        yield Pool(jobs, lambda order: executor.submit(run, order))
    finally:
        executor.shutdown(wait=False, cancel_futures=True)
        for worker in workers:
            worker.close()


@contextmanager
def rank_pool() -> Iterator[Pool | None]:
    """On rank 0 a pool of the other ranks; there this yields None, once they are no longer needed."""
    from mpi4py import MPI
    from mpi4py.futures import MPICommExecutor

    with MPICommExecutor(MPI.COMM_WORLD, root=0, main=False) as executor:
        if executor is None:
            yield None
        else:
            yield Pool(MPI.COMM_WORLD.size - 1, lambda order: executor.submit(run_on_rank, order, sys.path))


def launched_ranks() -> int:
    """Number of ranks that a launcher started, 1 without one; MPI is started only if there are several.

    Raises InputError if the launcher belongs to another MPI than mpi4py, so that each process would take itself for the
    only one.
    """
    ranks = environment.launched()
    if ranks == 1:
        return 1
    from mpi4py import MPI

    size = int(MPI.COMM_WORLD.size)
    if size == 1:
        library = MPI.Get_library_version().split(",")[0].split("\n")[0]
        raise InputError(
            "command line", "mpiexec", ranks, f"the launcher of this Python's own MPI is allowed ({library.strip()})"
        )
    return size


_of_rank: list[Worker] = []


def run_on_rank(order: Order, path: list[str]) -> Answer:
    """Have an order done by the child process of this rank."""
    if not _of_rank:
        _of_rank.append(Worker(path))
        atexit.register(_of_rank[0].close)
    return _of_rank[0].run(order)
