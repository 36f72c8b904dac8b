"""A report that another process draws while its run goes on."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Sequence
from concurrent.futures import BrokenExecutor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from multiprocessing import active_children, get_context, parent_process
from pathlib import Path
from typing import Any

from pmr.errors import environment
from pmr.report.blocks import Figures, ReportFiles
from pmr.results import RunResult

#: In the process that draws: results with their figures.
_drawings = list[tuple[RunResult, Figures]]()


class BackgroundReport:
    """The report of a run: drawn by another process where there is a core for it, else by this one in the end.

    Results are handed over in turn, each when the process is idle and reads it at once: Python before 3.11.5 waits for
    ever where a process ends in front of a result that is larger than a pipe holds.
    """

    def __init__(self) -> None:
        self._drawn = list[Future[None]]()
        self._pool: ProcessPoolExecutor | None = None
        self._turns = ThreadPoolExecutor(1)

    def __enter__(self) -> BackgroundReport:
        if has_free_core():
            pool = ProcessPoolExecutor(1, get_context("spawn"), _follow_parent)
            with suppress(OSError):  # no process can be started: this one draws
                self._turns.submit(pool.submit(_load).result)
                self._pool = pool
        return self

    def __exit__(self, *error: object) -> None:
        self._turns.shutdown(wait=False, cancel_futures=True)
        if self._pool is not None:
            self._pool.shutdown(wait=False, cancel_futures=True)
            for process in active_children():  # a run that was refused does not wait for what it no longer needs
                process.terminate()

    def draw(self, result: RunResult) -> None:
        """Let the figures of a result be drawn, which do not show ``budget`` of its summary."""
        if self._pool is not None:
            pool = self._pool
            self._drawn.append(self._turns.submit(lambda: pool.submit(_draw, result).result()))

    def write(self, results: Sequence[RunResult], folder: Path) -> ReportFiles:
        """Write the report of all results, in the order of `draw`: see `pmr.report.document.write_report`."""
        with suppress(BrokenExecutor):  # the process was killed
            if self._pool is not None:
                for drawn in self._drawn:
                    drawn.result()
                self._pool.submit(_write, folder.absolute(), [result.summary for result in results]).result()
                return ReportFiles.within(folder)
        from pmr.report.document import write_report

        return write_report(results, folder)


def has_free_core() -> bool:
    """Whether a process beside this one would have a core for itself."""
    return environment.cores() > 1 and environment.launched() == 1


def _follow_parent() -> None:
    """Leave interrupts to the process that this one works for, and end with it, however that ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    if (parent := parent_process()) is not None:
        parent.join()
        os._exit(1)


def _load() -> None:
    """Import what draws while the run imports what computes."""
    import pmr.report.document

    pmr.report.document.weasyprint()
    for name in pmr.report.document.templates().list_templates():
        pmr.report.document.templates().get_template(name)


def _draw(result: RunResult) -> None:
    from pmr.report.document import draw_figures

    _drawings.append((result, draw_figures(result, len(_drawings) + 1)))


def _write(folder: Path, summaries: Sequence[dict[str, Any]]) -> None:
    from pmr.report.document import write_report

    results = [replace(result, summary=summary) for (result, _), summary in zip(_drawings, summaries, strict=True)]
    write_report(results, folder, [figures for _, figures in _drawings])
