"""Tasks of a study, each a named call of a function; the plan of all tasks, and the graph of tasks to be computed."""

from __future__ import annotations

import hashlib
import heapq
import inspect
import json
import re
import sys
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from graphlib import CycleError, TopologicalSorter
from typing import Any

from numpy.typing import NDArray

from pmr.errors import InputError

#: Value of one cell of the table.
Scalar = float | int | bool | str | None
#: Length of the longest key of a task, and the pattern of keys, which are also names of files.
LONGEST = 120
KEY = re.compile(rf"[A-Za-z0-9][A-Za-z0-9._=,+-]{{0,{LONGEST - 1}}}")


def task_key(text: str) -> str:
    """Return a task key that resembles `text`: characters that keys can't contain are replaced by ``_``.

    The end of a text that is too long is replaced by a digest of the text; a ``0`` is put before a sign at the
    beginning.
    """
    key = re.sub(r"[^A-Za-z0-9._=,+-]+", "_", text)
    key = key if key[:1].isalnum() else f"0{key}"
    return key if len(key) <= LONGEST else f"{key[: LONGEST - 9]}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def cell_number(value: Scalar) -> float:
    """Return the value of a table's cell as a float; raises TypeError if the cell is empty (None) or a text."""
    if value is None or isinstance(value, str):
        raise TypeError(f"{value!r} is no number")
    return float(value)


@dataclass(frozen=True)
class TaskResult:
    """Result of a task: numbers for the table (`record`), arrays, times and warnings.

    Each entry of the `record` is a column of the table; its value must not depend on the machine.  Measured times,
    which differ from run to run, are in `seconds` instead.  `warnings` are the warnings of a run of the same scene, one
    line each; warnings that are logged while the task runs are added to them.
    """

    record: Mapping[str, Scalar] = field(default_factory=dict)  # a float must be finite; None leaves the cell empty
    arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict)  # for other tasks or the report; no objects
    seconds: Mapping[str, float] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Failure:
    """Why a task has no result: its function failed, or the task was skipped because a task that it needs failed."""

    reason: str  # one line, the same wherever the task fails
    detail: str = ""  # traceback or output that helps to find the cause
    status: str = "failed"  # or "skipped"

    @classmethod
    def from_error(cls, error: BaseException) -> Failure:
        """Return the failure of a task that raised `error`; `detail` is the traceback."""
        return cls(" ".join(f"{type(error).__name__}: {error}".split()), "".join(traceback.format_exception(error)))

    def of_skipped(self, key: str) -> Failure:
        """Return the failure of a task that is skipped because it needs the task `key`, which has this failure."""
        reason = self.reason if self.status == "skipped" else f"needs {key}, which failed: {self.reason}"
        return Failure(reason, status="skipped")


#: Arguments of a task, in types of JSON; results of the tasks that it needs, by the names that its function uses.
Arguments = Mapping[str, Any]
Needs = Mapping[str, TaskResult]
TaskFunction = Callable[[Arguments, Needs], TaskResult]


@dataclass(frozen=True)
class Task:
    """One call of a function of a module, in a process of its own.

    The function is called with `arguments` and the results of `needs`; it sees one MPI process and one thread, and its
    result depends on nothing else.
    """

    key: str  # unique in its plan: letters, digits and ``._=,+-``
    function: TaskFunction
    arguments: Mapping[str, Any] = field(default_factory=dict)  # of JSON types; with digests of files that it reads
    needs: Mapping[str, str] = field(default_factory=dict)  # name that the function uses -> key of the needed task
    parameters: Mapping[str, Scalar] = field(default_factory=dict)  # first columns of the table, also for failed runs
    cost: float = 1.0  # expected effort in any unit: long tasks start first, and the time left is estimated from it

    def __post_init__(self) -> None:
        """Raise ValueError for a key that can't name a file, and for a method or nested function as the function."""
        if not KEY.fullmatch(self.key):
            raise ValueError(f"task key {self.key!r}: {KEY.pattern} is allowed")
        if "." in self.function.__qualname__:
            raise ValueError(f"task {self.key}: {self.address} is no function of a module")

    @property
    def address(self) -> str:
        """The text ``"module:name"`` that names the function."""
        return f"{self.function.__module__}:{self.function.__qualname__}"

    def digest(self, code: str, needs: Mapping[str, str]) -> str:
        """Return the digest of everything that decides the result.

        It covers the digest `code` of the package's code, the function, the source of its module, the arguments, and
        `needs`, the digests of the results that the task needs, by name.
        """
        content = [code, self.address, _source(self.function.__module__), self.arguments, needs]
        return hashlib.sha256(json.dumps(content, sort_keys=True, allow_nan=False).encode()).hexdigest()[:24]


@lru_cache
def _source(module: str) -> str:
    """Return the source of an imported module."""
    return inspect.getsource(sys.modules[module])


@dataclass(frozen=True)
class Plan:
    """The tasks of one study: its runs, and tasks whose results several runs need."""

    runs: tuple[Task, ...]  # one row of the table each, in this order
    shared: tuple[Task, ...] = ()  # tasks without a row that several runs need; computed once if a run still needs them

    def __post_init__(self) -> None:
        """Raise InputError if two tasks have the same key, ValueError if a task needs a key that the plan lacks."""
        twice = [key for key, count in Counter(task.key.casefold() for task in self).items() if count > 1]
        if twice:
            allowed = f"two runs are called {', '.join(twice)}; names of scenes and cases, and values, must differ"
            raise InputError("study", "", None, allowed)
        keys = {task.key for task in self}
        for task in self:
            missing = set(task.needs.values()) - keys
            if missing:
                raise ValueError(f"task {task.key} needs {', '.join(sorted(missing))}, which the plan lacks")

    def __iter__(self) -> Iterator[Task]:
        """Iterate over all tasks: first those that runs share, then the runs."""
        return iter((*self.shared, *self.runs))


@dataclass(frozen=True)
class Node:
    """A task with its digest and, by name, the digests of all results on which it depends.

    `urgency` is the cost of the longest chain of tasks from this one on.  Starting the most urgent task first keeps all
    workers busy longest (list scheduling by upward rank; Topcuoglu, Hariri, Wu 2002, section 4.1).
    """

    digest: str
    task: Task
    needs: Mapping[str, str]
    urgency: float


def digests(plan: Plan, code: str) -> dict[str, str]:
    """Return the digest of each task of a plan, by key; raises ValueError if the needs of tasks form a cycle.

    `code` is the digest of the code that tasks compute with.
    """
    tasks, digest_of_task = {task.key: task for task in plan}, dict[str, str]()
    for key in _topological_order({key: task.needs.values() for key, task in tasks.items()}):
        task = tasks[key]
        digest_of_task[key] = task.digest(code, {name: digest_of_task[need] for name, need in task.needs.items()})
    return digest_of_task


def open_nodes(plans: Sequence[Plan], code: str, is_done: Callable[[str], bool]) -> dict[str, Node]:
    """Return the tasks to be computed, by digest: runs that are not done, and missing results of tasks they depend on.

    Each task comes after the tasks that it needs.  `is_done` returns for a digest whether its result is stored; `code`
    is the digest of the code.
    """
    tasks, needs, needed = dict[str, Task](), dict[str, dict[str, str]](), set[str]()
    for plan in plans:
        digest = digests(plan, code)
        for task in plan:
            tasks.setdefault(digest[task.key], task)
            needs[digest[task.key]] = {name: digest[key] for name, key in task.needs.items()}
        needed |= {digest[run.key] for run in plan.runs}
    order = _topological_order({digest: of_task.values() for digest, of_task in needs.items()})
    urgency, of_dependents = dict[str, float](), dict[str, float]()
    for key in reversed(order):  # each key before the keys that it needs
        if key in needed and not is_done(key):
            urgency[key] = tasks[key].cost + of_dependents.get(key, 0.0)
            needed.update(needs[key].values())
            for need in needs[key].values():
                of_dependents[need] = max(of_dependents.get(need, 0.0), urgency[key])
    return {key: Node(key, tasks[key], needs[key], urgency[key]) for key in order if key in urgency}


class ReadyQueue:
    """Queue of the nodes whose needs are met, most urgent first."""

    def __init__(self, nodes: Mapping[str, Node]) -> None:
        self._nodes = nodes
        self._rank = {digest: (-node.urgency, i) for i, (digest, node) in enumerate(nodes.items())}
        self._sorter = TopologicalSorter(
            {d: [n for n in node.needs.values() if n in nodes] for d, node in nodes.items()}
        )
        self._heap = list[tuple[tuple[float, int], str]]()
        self._sorter.prepare()
        self._add_ready()

    def __bool__(self) -> bool:
        """Whether a node is queued."""
        return bool(self._heap)

    def pop(self) -> Node:
        """Remove the most urgent node and return it."""
        return self._nodes[heapq.heappop(self._heap)[1]]

    def mark_done(self, digest: str) -> None:
        """Queue the nodes that waited only for the node with this digest, which has ended: with a result or failed."""
        self._sorter.done(digest)
        self._add_ready()

    def _add_ready(self) -> None:
        """Queue the nodes whose needs have been met since the last call."""
        for digest in self._sorter.get_ready():
            heapq.heappush(self._heap, (self._rank[digest], digest))


def _topological_order(needs: Mapping[str, Iterable[str]]) -> list[str]:
    """Return keys in an order in which each follows all keys that it needs; raises ValueError for a cycle."""
    try:
        return list(TopologicalSorter(needs).static_order())
    except CycleError as error:
        raise ValueError(f"{' and '.join(sorted(set(error.args[1])))} need one another's results") from None
