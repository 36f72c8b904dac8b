"""A second process that works beside this one, which it is a copy of: what both need is loaded once.

It is made before MPI starts, which no copy survives.  Whatever goes wrong there is done again here, so that an error
reaches the user as if there were no other process.
"""

from __future__ import annotations

import os
import queue
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context
from multiprocessing.connection import Connection, Pipe
from multiprocessing.process import BaseProcess
from typing import Any

from pmr.errors import environment

#: Once one of these is loaded a copy of the process would not do, or save no time.
TOO_LATE = ("mpi4py.MPI", "petsc4py.PETSc", "matplotlib")


@contextmanager
def worked_aside(wanted: bool = True) -> Iterator[Aside]:
    """Who works aside; nobody where that is not `wanted` or would save no time."""
    aside = Aside.started() if wanted and _saves_time() else Aside()
    try:
        yield aside
    finally:
        aside.close()


@dataclass
class Aside:
    """This process's side of the other one, which may be missing."""

    process: BaseProcess | None = None
    there: Connection | None = None  # None as well where the process says nothing more
    answers: list[tuple[bool, Any]] = field(default_factory=list)  # whether it went well, and what came of it
    asked: int = 0

    @classmethod
    def started(cls) -> Aside:
        """With a process, where the system lets one start."""
        there, here = Pipe()
        process = get_context("fork").Process(target=_work, args=(there, here), daemon=True)
        try:
            process.start()
        except OSError:
            return cls()
        finally:
            there.close()
        return cls(process, here)

    def ask(self, work: Callable[..., Any], *arguments: Any) -> Callable[[], tuple[bool, Any]]:
        """Let it work on its own, one after the other; what is given back waits for the end.

        Then it says whether that went well there, and what came of it.  Functions and arguments go there by `pickle`.
        """
        if self.there is not None:
            try:
                with _without_sigpipe():
                    self.there.send((work, arguments))
            except OSError:  # it has ended already
                self.there = None
        self.asked += 1
        return partial(self._answer, self.asked - 1)

    def done(self, work: Callable[..., Any], *arguments: Any) -> Callable[[], Any]:
        """The same of work that is done here where it did not go well there."""
        answer = self.ask(work, *arguments)

        def result() -> Any:
            well, found = answer()
            return found if well else work(*arguments)

        return result

    def close(self) -> None:
        """End the process, and what it has started."""
        if self.process is not None:
            with suppress(ProcessLookupError):  # it has a group only once it is under way
                os.killpg(self.process.pid or 0, signal.SIGKILL)
            self.process.kill()
            self.process.join()

    def _answer(self, number: int) -> tuple[bool, Any]:
        while self.there is not None and len(self.answers) <= number:
            try:
                self.answers.append(self.there.recv())
            except (EOFError, OSError):
                self.there = None
        return self.answers[number] if number < len(self.answers) else (False, None)


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


def _work(there: Connection, here: Connection) -> None:
    """What the process does; it is gone as soon as the one that started it is, however that ends.

    In a group of its own: an interrupt from the keyboard reaches the other process alone, which ends this one.
    """
    try:
        os.setsid()
        here.close()
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        environment.collected_seldom()
        wanted, found = queue.SimpleQueue[Any](), queue.SimpleQueue[Any]()
        threading.Thread(target=_listen, args=(there, wanted), daemon=True).start()
        threading.Thread(target=_tell, args=(there, found), daemon=True).start()
        while True:
            work, arguments = wanted.get()
            try:
                found.put((True, work(*arguments)))
            except Exception:
                found.put((False, None))
    finally:
        os._exit(1)


def _listen(there: Connection, wanted: queue.SimpleQueue[Any]) -> None:
    try:
        while True:
            wanted.put(there.recv())
    finally:  # nobody is left to ask for anything
        os.killpg(0, signal.SIGKILL)


def _tell(there: Connection, found: queue.SimpleQueue[Any]) -> None:
    """Send what was found; work goes on while nobody asks for it yet."""
    try:
        while True:
            there.send(found.get())
    finally:
        os.killpg(0, signal.SIGKILL)
