"""A report that is drawn beside the run it is about, by a process that loads meanwhile what draws.

It is a copy of this one, made before MPI starts, which no copy survives: what both need is loaded once.  Results go
there as soon as they are found, in the end the summaries, which are all that may have changed.  Whatever goes wrong
there is done again here, so that an error reaches the user as if there were no other process.
"""

from __future__ import annotations

import gc
import os
import queue
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from multiprocessing import get_context
from multiprocessing.connection import Connection, Pipe
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from pmr.errors import environment
from pmr.report.blocks import ReportFiles
from pmr.results import RunResult

#: Once one of these is loaded a copy of the process would not do, or save no time.
TOO_LATE = ("mpi4py.MPI", "petsc4py.PETSc", "matplotlib")


@contextmanager
def drawn_beside(wanted: bool = True) -> Iterator[Beside]:
    """Who draws the report; without a process of its own where none is `wanted` or it would save no time."""
    beside = Beside.started() if wanted and _saves_time() else Beside()
    try:
        yield beside
    finally:
        beside.close()


@dataclass
class Beside:
    """This process's side of the one that draws, which may be missing."""

    process: BaseProcess | None = None
    there: Connection | None = None  # None as well where the process takes nothing more

    @classmethod
    def started(cls) -> Beside:
        """With a process, where the system lets one start."""
        heard, said = Pipe(duplex=False)
        process = get_context("fork").Process(target=_draw, args=(heard, said), daemon=True)
        try:
            process.start()
        except OSError:
            return cls()
        finally:
            heard.close()
        return cls(process, said)

    def draw(self, result: RunResult) -> None:
        """Let its figures be drawn: of all in a summary they only don't show ``budget``."""
        self._say(result)

    def write(self, results: Sequence[RunResult], folder: Path) -> ReportFiles:
        """The report of all results, which were handed to `draw` in this order: see `pmr.report.document`."""
        self._say((folder.absolute(), [result.summary for result in results]))
        if self.process is not None:
            self.process.join()
            if self.process.exitcode == 0:
                return ReportFiles.within(folder)
        from pmr.report.document import write_report

        return write_report(results, folder)

    def close(self) -> None:
        """End the process, and what it has started to make pictures."""
        if self.process is not None and self.process.is_alive():
            with suppress(ProcessLookupError):  # it has a group only once it is under way
                os.killpg(self.process.pid or 0, signal.SIGKILL)
            self.process.kill()
            self.process.join()

    def _say(self, what: Any) -> None:
        if self.there is None:
            return
        try:
            with _without_sigpipe():
                self.there.send(what)
        except BrokenPipeError:  # it has ended already: `write` sees it
            self.there = None


@contextmanager
def _without_sigpipe() -> Iterator[None]:
    """Writing to a process that is gone raises BrokenPipeError; after PETSc is loaded the signal would end this one."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGPIPE})
    try:
        yield
    finally:
        if signal.SIGPIPE in signal.sigpending():
            signal.sigwait({signal.SIGPIPE})
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _saves_time() -> bool:
    """Whether a copy of this process can run beside it; what only one thread knows would be lost in it."""
    alone = environment.launched() == 1 and threading.active_count() == 1 and not any(map(sys.modules.get, TOO_LATE))
    return sys.platform == "linux" and environment.cores() > 1 and alone


def _draw(heard: Connection, said: Connection) -> None:
    """What the process does; it is gone as soon as the one that started it is, however that ends.

    In a group of its own: an interrupt from the keyboard reaches the other process alone, which ends this one.
    """
    try:
        os.setsid()
        said.close()
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        _work(heard)
    except BaseException:  # which its tests or those who interrupt it need not see: it is done again there
        os._exit(1)
    os._exit(0)  # the thread that listens may not be asked to end


def _work(heard: Connection) -> None:
    results, figures, wanted = list[RunResult](), [], queue.SimpleQueue[Any]()
    threading.Thread(target=_listen, args=(heard, wanted), daemon=True).start()
    gc.freeze()  # what is there stays
    with environment.uncollected():
        import matplotlib.backends.backend_svg  # noqa: F401 (each takes its time to load)
        import weasyprint  # noqa: F401

        from pmr.report.document import drawn, write_report

        while not isinstance(asked := wanted.get(), tuple):
            results.append(asked)
            figures.append(drawn(asked, len(results)))
        folder, summaries = asked
        final = [replace(one, summary=summary) for one, summary in zip(results, summaries, strict=True)]
        write_report(final, folder, figures)


def _listen(heard: Connection, wanted: queue.SimpleQueue[Any]) -> None:
    try:
        while True:
            wanted.put(heard.recv())
    finally:  # nobody is left to ask for anything
        os.killpg(0, signal.SIGKILL)
