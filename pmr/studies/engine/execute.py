"""The child process of a worker: it takes orders line by line, runs the task, stores the result, answers.

It has one thread and one MPI process of its own, whatever launched its parent.  What a library prints goes to the
error stream, never between the answers.  When the parent dies the child goes too.
"""

from __future__ import annotations

import importlib
import json
import logging
import math
import os
import queue
import signal
import threading
import time
import traceback
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np

from pmr.studies.engine.store import Store, Stored
from pmr.studies.engine.task import Scalar, TaskFunction, TaskResult
from pmr.studies.engine.worker import Answer, Order, code_of_tasks

OTHER_CODE = "pmr was edited since the study was planned, or is another one on this machine; call the study again"
REMEMBERED = 256 * 2**20  # bytes of results that a child remembers for the next tasks that need them


def main() -> None:
    """Serve orders until the input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    lines, answers = os.fdopen(os.dup(0)), os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    notes = _Notes()
    logging.getLogger().addHandler(notes)
    orders: queue.SimpleQueue[str | None] = queue.SimpleQueue()
    busy = threading.Event()

    def listen() -> None:
        for line in lines:
            orders.put(line)
        if busy.is_set():
            os._exit(1)  # nobody is left to tell
        orders.put(None)

    threading.Thread(target=listen, daemon=True).start()
    memory = _Memory()
    while (line := orders.get()) is not None:
        busy.set()
        answer = _answer(Order(**json.loads(line)), memory, notes)
        busy.clear()
        try:
            print(json.dumps(asdict(answer)), file=answers, flush=True)  # noqa: T201  (the answer)
        except BrokenPipeError:
            os._exit(1)


def _answer(order: Order, memory: _Memory, notes: _Notes) -> Answer:
    start = time.perf_counter()
    if order.code not in ("", code_of_tasks()):
        return Answer("failed", 0.0, OTHER_CODE)
    notes.found.clear()
    try:
        store = Store(Path(order.store))
        needs = {name: memory.result(store, digest) for name, digest in order.needs.items()}
        function = _function(order.address)
        begin = time.perf_counter()
        result = function(order.arguments, needs)
        seconds = {"task": time.perf_counter() - begin} | dict(result.seconds)
        warnings = tuple(dict.fromkeys((*result.warnings, *notes.found)))
        result = TaskResult(_check_record(result.record), result.arrays, seconds, warnings)
        if order.code not in ("", code_of_tasks()):  # modules that the task imported may be those of the edited files
            return Answer("failed", time.perf_counter() - start, OTHER_CODE)
        store.write(order.digest, Stored(order.key, result))
    except (Exception, SystemExit) as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        return Answer("failed", time.perf_counter() - start, reason, traceback.format_exc())
    return Answer("done", time.perf_counter() - start)


def _function(address: str) -> TaskFunction:
    module, _, name = address.partition(":")
    function: TaskFunction = getattr(importlib.import_module(module), name)
    return function


def _check_record(record: Mapping[str, Scalar]) -> dict[str, Scalar]:
    """Plain Python scalars, all finite."""
    plain: dict[str, Scalar] = {}
    for name, value in record.items():
        value = value.item() if isinstance(value, np.generic) else value
        if not isinstance(value, (float, int, bool, str, type(None))):
            raise TypeError(f"{name} is a {type(value).__name__}; a record holds scalars")
        if isinstance(value, float) and not math.isfinite(value):
            raise ValueError(f"{name} = {value} is not finite")
        plain[name] = value
    return plain


class _Memory:
    """The results read last, up to `REMEMBERED` bytes."""

    def __init__(self) -> None:
        self._remembered: OrderedDict[str, TaskResult] = OrderedDict()

    def result(self, store: Store, digest: str) -> TaskResult:
        if digest not in self._remembered:
            self._remembered[digest] = store.read(digest).result
        self._remembered.move_to_end(digest)
        while len(self._remembered) > 1 and sum(map(_size, self._remembered.values())) > REMEMBERED:
            self._remembered.popitem(last=False)
        return self._remembered[digest]


def _size(result: TaskResult) -> int:
    return sum(array.nbytes for array in result.arrays.values())


class _Notes(logging.Handler):
    """Collects what is logged as a warning or worse."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.found: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        text = record.getMessage()
        if text not in self.found:
            self.found.append(text)


if __name__ == "__main__":
    main()
