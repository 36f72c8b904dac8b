"""Report of a run that a second process draws while the run goes on."""

from __future__ import annotations

import logging
import os
import pickle
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from multiprocessing import active_children, get_context, parent_process
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pmr.errors import environment
from pmr.report.blocks import Figures, ReportFiles
from pmr.results import RunResult

#: Results and their figures, in the order in which the second process drew them; empty in the first process.
_drawings = list[tuple[RunResult, Figures]]()


class BackgroundReport:
    """Report of a run, drawn by a second process while the run goes on.

    If no core is free for a second process, this process draws the report in `write`.
    Results are handed over in files: if a process ends before it has read what is larger than a pipe holds, this one
    would wait for ever (Python before 3.11.5).
    """

    def __init__(self) -> None:
        self._drawn = list[Future[None]]()
        self._pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> BackgroundReport:
        """Start the second process if a core is free, and let it import the modules that draw.

        If no process can be started, this process draws the figures in `write`.
        """
        if has_free_core():
            self._folder = TemporaryDirectory(ignore_cleanup_errors=True)
            pool = ProcessPoolExecutor(1, get_context("spawn"), _follow_parent)
            with suppress(OSError):  # no process can be started: this one draws
                pool.submit(_load)
                self._pool = pool
        return self

    def __exit__(self, *error: object) -> None:
        """Drop results that are not drawn yet, and terminate the second process without waiting for it.

        All other child processes that multiprocessing has started are terminated too.
        """
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)
            for process in active_children():  # a run that fails does not wait for drawings
                process.terminate()
            self._folder.cleanup()

    def draw(self, result: RunResult) -> None:
        """Queue a result for the second process to draw, and return at once; do nothing if there is no second process.

        No figure shows the entry ``budget`` of the result's summary, so this entry may still change until `write` is
        called.
        """
        if self._pool is not None:
            self._drawn.append(self._submit(self._pool, _draw, result))

    def write(self, results: Sequence[RunResult], folder: Path) -> ReportFiles:
        """Write the report of all `results` into `folder` and return its files; blocks until the files are written.

        `results` are the results that `draw` received, in the same order, with their final summaries.  If there is no
        second process, if it was killed, or if results could not be handed over to it, this process draws the figures
        (`pmr.report.document.write_report`).
        """
        with suppress(BrokenExecutor, OSError):  # the process was killed, or there is no room for files
            if self._pool is not None:
                for drawn in self._drawn:
                    drawn.result()
                summaries = [result.summary for result in results]
                self._submit(self._pool, _write, folder.absolute(), summaries).result()
                return ReportFiles.in_folder(folder)
        from pmr.report.document import write_report

        return write_report(results, folder)

    def _submit(self, pool: ProcessPoolExecutor, function: Callable[..., None], *arguments: object) -> Future[None]:
        """Call a function in the second process, which reads its arguments from a file."""
        file = Path(self._folder.name, f"{len(self._drawn)}-{function.__name__}")
        try:
            file.write_bytes(pickle.dumps(arguments))
            return pool.submit(_call, function, file)
        except (BrokenExecutor, OSError) as error:
            failed = Future[None]()
            failed.set_exception(error)
            return failed


@contextmanager
def helper_process() -> Iterator[Executor | None]:
    """Yield an executor of one process, which starts at the first task; yield None if no core is free."""
    pool = ProcessPoolExecutor(1, get_context("spawn"), _begin_to_help) if has_free_core() else None
    try:
        yield pool
    finally:
        if pool is not None:
            pool.shutdown(wait=False, cancel_futures=True)


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


def _load() -> None:
    """Import the modules that draw, and compile the templates; the second process calls this while the run computes."""
    import pmr.report.document

    environment.import_package("weasyprint")
    for name in pmr.report.document.templates().list_templates():
        pmr.report.document.templates().get_template(name)


def _call(function: Callable[..., None], file: Path) -> None:
    """Call a function with the arguments that a file of this run's holds, in the second process."""
    function(*pickle.loads(file.read_bytes()))


def _draw(result: RunResult) -> None:
    """Draw the figures of a result and append (result, figures) to `_drawings`; called in the second process."""
    from pmr.report.document import draw_figures

    _drawings.append((result, draw_figures(result, len(_drawings) + 1)))


def _write(folder: Path, summaries: Sequence[dict[str, Any]]) -> None:
    """Write the report of the drawn results, with final summaries, into `folder`; called in the second process."""
    from pmr.report.document import write_report

    results = [replace(result, summary=summary) for (result, _), summary in zip(_drawings, summaries, strict=True)]
    write_report(results, folder, [figures for _, figures in _drawings])
