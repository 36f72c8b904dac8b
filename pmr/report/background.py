"""A second process that helps a run while it goes on."""

from __future__ import annotations

import logging
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context, parent_process

from pmr.errors import environment


@contextmanager
def helper_process() -> Iterator[Executor | None]:
    """Yield an executor of one process, which starts at the first task; yield None if no core is free.

    At the end the process is terminated, and so are all other child processes that multiprocessing has started.
    """
    pool = ProcessPoolExecutor(1, get_context("spawn"), _begin_to_help) if has_free_core() else None
    try:
        yield pool
    finally:
        if pool is not None:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in active_children():  # a run that fails does not wait for its help
                process.terminate()


def _begin_to_help() -> None:
    """Follow the parent, leave its MPI job, and log warnings in the form in which the command line logs them."""
    for name in [name for name in os.environ if name.startswith(environment.MPI_VARIABLES)]:
        del os.environ[name]
    _follow_parent()
    logging.basicConfig(format="%(levelname)s %(message)s")


def has_free_core() -> bool:
    """Whether a second process would have a core for itself.

    This is so if this process may use several cores and a launcher of MPI started no other process together with it.
    Other programs, which may use the cores as well, are not looked at.
    """
    return environment.available_cores() > 1 and environment.launched_process_count() == 1


def _follow_parent() -> None:
    """Ignore interrupts (SIGINT) in this process, and end it as soon as its parent has ended, for whatever reason."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Wait until the parent process ends, then exit this process with status 1; blocks, so a thread runs it."""
    if (parent := parent_process()) is not None:
        parent.join()
        os._exit(1)
