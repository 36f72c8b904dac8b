"""A report that is drawn beside the run it is about, by a process that loads meanwhile what draws.

Results go there as soon as they are found, in the end the summaries, which are all that may have changed.  Whatever
goes wrong there is done again here, so that an error reaches the user as if there were no other process.
"""

from __future__ import annotations

import os
import pickle
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

from pmr.errors import environment
from pmr.report.blocks import ReportFiles
from pmr.results import RunResult

#: What the process executes; it finds modules where this one does.
START = "import sys; sys.path[:] = {path!r}; from pmr.report.beside import main; main()"


@contextmanager
def drawn_beside(wanted: bool = True) -> Iterator[Beside]:
    """Who draws the report; without a process of its own where none is `wanted` or it would save no time."""
    beside = Beside(_started() if wanted and _saves_time() else None)
    try:
        yield beside
    finally:
        beside.close()


class Beside:
    """This process's side of the one that draws, which may be missing."""

    def __init__(self, process: subprocess.Popen[bytes] | None = None) -> None:
        self.process = process

    def draw(self, result: RunResult) -> None:
        """Let its figures be drawn: of all in a summary they only don't show ``budget``."""
        self._say(result)

    def write(self, results: Sequence[RunResult], folder: Path) -> ReportFiles:
        """The report of all results, which were handed to `draw` in this order: see `pmr.report.document`."""
        self._say((folder.absolute(), [result.summary for result in results]))
        if self.process is not None and self.process.wait() == 0:
            return ReportFiles.within(folder)
        from pmr.report.document import write_report

        return write_report(results, folder)

    def close(self) -> None:
        """End the process, and what it has started to make pictures."""
        if self.process is None:
            return
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGKILL)
            self.process.wait()
        self._stop_saying()

    def _say(self, what: Any) -> None:
        if self.process is None or self.process.stdin is None or self.process.stdin.closed:
            return
        try:
            with _without_sigpipe():
                pickle.dump(what, self.process.stdin, protocol=pickle.HIGHEST_PROTOCOL)
                self.process.stdin.flush()
        except BrokenPipeError:  # it has ended already: `write` sees it
            self._stop_saying()

    def _stop_saying(self) -> None:
        """What was not taken must not be written again when this process ends."""
        with _without_sigpipe(), suppress(BrokenPipeError):
            if self.process is not None and self.process.stdin is not None:
                self.process.stdin.close()


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
    """Whether another process runs beside this one, which hasn't loaded what draws; groups of processes end as one."""
    return os.name == "posix" and environment.cores() > 1 and "matplotlib" not in sys.modules


def _started() -> subprocess.Popen[bytes] | None:
    """In a group of its own: an interrupt from the keyboard reaches this process alone, which ends the other."""
    command = [sys.executable, "-W", "ignore:A NumPy version", "-c", START.format(path=sys.path)]
    try:
        return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, start_new_session=True)
    except OSError:
        return None


def main() -> None:
    """What the process does; it is gone as soon as the one that started it is, however that ends."""
    try:
        _work()
    except Exception:
        os._exit(1)
    os._exit(0)  # the thread that listens may not be asked to end


def _work() -> None:
    heard: queue.SimpleQueue[Any] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(sys.stdin.buffer, heard), daemon=True).start()
    with environment.uncollected():
        import matplotlib.backends.backend_svg  # noqa: F401 (each takes its time to load)
        import weasyprint  # noqa: F401

        from pmr.report.document import drawn, write_report

        results, figures = list[RunResult](), []
        while not isinstance(said := heard.get(), tuple):
            results.append(said)
            figures.append(drawn(said, len(results)))
        folder, summaries = said
        final = [replace(one, summary=summary) for one, summary in zip(results, summaries, strict=True)]
        write_report(final, folder, figures)


def _listen(stream: IO[bytes], heard: queue.SimpleQueue[Any]) -> None:
    try:
        while True:
            heard.put(pickle.load(stream))
    finally:  # nobody is left to ask for anything
        os.killpg(0, signal.SIGKILL)
