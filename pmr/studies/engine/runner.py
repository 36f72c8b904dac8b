"""Has the open tasks of plans done by a pool, each as soon as what it needs is there."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass, replace

from pmr.errors.text import duration
from pmr.studies.engine.graph import Node, Ready
from pmr.studies.engine.pools import Pool
from pmr.studies.engine.store import Store
from pmr.studies.engine.worker import Answer, Order, code_of_tasks

WATCH_EVERY = 1.0  # s
NAMED = 4  # tasks that a line of progress names


@dataclass(frozen=True)
class Failure:
    """Why there is no result: the task failed itself, or was skipped because one that it needs did."""

    status: str  # "failed" or "skipped"
    reason: str
    detail: str = ""


@dataclass(frozen=True)
class Progress:
    """How far it is: numbers of tasks, and seconds."""

    done: int
    failed: int
    total: int
    elapsed: float
    left: float | None  # estimated; None before the first task is done
    running: tuple[str, ...] = ()  # keys of the tasks that are computed now

    @property
    def text(self) -> str:
        """One line."""
        failed = f", {self.failed} failed or skipped" if self.failed else ""
        time_left = f", about {duration(self.left)} left" if self.left and self.done + self.failed < self.total else ""
        now = f"; now {', '.join(self.running[:NAMED])}{' ...' * (len(self.running) > NAMED)}" if self.running else ""
        return f"{self.done} of {self.total} tasks done{failed} after {duration(self.elapsed)}{time_left}{now}"


Watch = Callable[[Progress], None]


def run(
    nodes: Mapping[str, Node], store: Store, pool: Pool, watch: Watch = lambda progress: None
) -> dict[str, Failure]:
    """Compute nodes as `open_nodes` returns them; what comes out is in the store, and here is what failed, by digest.

    `watch` is called with the progress whenever a task ends, and every second.
    """
    ready, state, code = Ready(nodes), _State(nodes), code_of_tasks()
    running: dict[Future[Answer], Node] = {}
    alone: deque[Node] = deque()
    while ready or alone or running:
        while ready and len(running) < 2 * pool.slots:  # one waits behind each that runs, so that no worker does
            node = ready.pop()
            if node.task.alone:
                alone.append(node)
            else:
                running[pool.submit(_order(node, store, code))] = node
        if alone and not running:
            node = alone.popleft()
            running[pool.submit(_order(node, store, code))] = node
            wait(running)
        finished, _ = wait(running, timeout=WATCH_EVERY, return_when=FIRST_COMPLETED)
        for future in [
            future_of_node for future_of_node in running if future_of_node in finished
        ]:  # as submitted: which failure is named does not vary
            node, answer = running.pop(future), _answer(future)
            if answer.status == "done":
                state.done(node)
                ready.done(node.digest)
                continue
            state.fail(node, Failure("failed", answer.reason, answer.detail))
            reason = f"needs {node.task.key}, which failed: {answer.reason}"
            for digest in ready.dependents(node.digest):
                state.fail(nodes[digest], Failure("skipped", reason))
        now = [node.task.key for node in running.values()][: pool.slots]
        watch(replace(state.progress, running=tuple(now)))
    return state.failures


def _answer(future: Future[Answer]) -> Answer:
    try:
        return future.result()
    except Exception as error:  # the machine could not even start a process, say
        return Answer("failed", 0.0, " ".join(f"{type(error).__name__}: {error}".split()))


def _order(node: Node, store: Store, code: str) -> Order:
    task = node.task
    return Order(task.key, node.digest, task.address, task.arguments, node.needs, str(store.folder), code)


class _State:
    """State of the nodes so far."""

    def __init__(self, nodes: Mapping[str, Node]) -> None:
        self.failures: dict[str, Failure] = {}
        self._total, self._done = len(nodes), 0
        self._cost_done, self._cost_left = 0.0, sum(node.task.cost for node in nodes.values())
        self._begin = time.monotonic()

    def done(self, node: Node) -> None:
        self._done += 1
        self._cost_done += node.task.cost
        self._cost_left -= node.task.cost

    def fail(self, node: Node, failure: Failure) -> None:
        if node.digest not in self.failures:
            self.failures[node.digest] = failure
            self._cost_left -= node.task.cost

    @property
    def progress(self) -> Progress:
        elapsed = time.monotonic() - self._begin
        seconds_left = elapsed * max(self._cost_left, 0.0) / self._cost_done if self._cost_done else None
        return Progress(self._done, len(self.failures), self._total, elapsed, seconds_left)
