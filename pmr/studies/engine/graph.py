"""The tasks of one or several plans as one graph: equal tasks once, what is there already left out."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from graphlib import CycleError, TopologicalSorter

from pmr.studies.engine.task import Plan, Task


@dataclass(frozen=True)
class Node:
    """A task with the digests of what it needs, by name.

    `urgency` is the cost of the longest chain of tasks that begins here: the most urgent first keeps all workers busy
    longest (list scheduling by upward rank; Topcuoglu, Hariri, Wu 2002, section 4.1).
    """

    digest: str
    task: Task
    needs: Mapping[str, str]
    urgency: float


def digests(plan: Plan, code: str) -> dict[str, str]:
    """Digest of each task of a plan, by key; raises ValueError if tasks need each other in a circle."""
    tasks, digest_of_task = {task.key: task for task in plan}, dict[str, str]()
    for key in _in_order({key: task.needs.values() for key, task in tasks.items()}):
        task = tasks[key]
        digest_of_task[key] = task.digest(code, {name: digest_of_task[need] for name, need in task.needs.items()})
    return digest_of_task


def open_nodes(plans: Sequence[Plan], code: str, is_done: Callable[[str], bool]) -> dict[str, Node]:
    """Tasks that are to be computed, by digest, in an order in which nothing precedes what it needs.

    These are the runs that are not done and, of what is shared, only what they still need.
    """
    tasks: dict[str, Task] = {}
    needs: dict[str, dict[str, str]] = {}
    digests_to_check: list[str] = []
    for plan in plans:
        digest = digests(plan, code)
        for task in plan:
            tasks.setdefault(digest[task.key], task)
            needs[digest[task.key]] = {name: digest[key] for name, key in task.needs.items()}
        digests_to_check += [digest[run.key] for run in plan.runs]
    is_done, missing = cache(is_done), set[str]()
    while digests_to_check:
        digest_ = digests_to_check.pop()
        if digest_ not in missing and not is_done(digest_):
            missing.add(digest_)
            digests_to_check += needs[digest_].values()
    open_needs = {d: [need for need in needs[d].values() if need in missing] for d in tasks if d in missing}
    order = _in_order(open_needs)
    urgency: dict[str, float] = {}
    for digest_ in reversed(order):
        cost_of_chain = tasks[digest_].cost + urgency.get(digest_, 0.0)
        urgency[digest_] = cost_of_chain
        for need in open_needs[digest_]:
            urgency[need] = max(urgency.get(need, 0.0), cost_of_chain)
    return {d: Node(d, tasks[d], needs[d], urgency[d]) for d in order}


class Ready:
    """The nodes whose needs are met, most urgent first."""

    def __init__(self, nodes: Mapping[str, Node]) -> None:
        self._nodes = nodes
        self._rank = {digest: (-node.urgency, i) for i, (digest, node) in enumerate(nodes.items())}
        waits_for = {d: [n for n in node.needs.values() if n in nodes] for d, node in nodes.items()}
        self._dependents: dict[str, list[str]] = {}
        for digest, needs in waits_for.items():
            for need in needs:
                self._dependents.setdefault(need, []).append(digest)
        self._sorter, self._heap = TopologicalSorter(waits_for), list[tuple[tuple[float, int], str]]()
        self._sorter.prepare()
        self._let_go()

    def __bool__(self) -> bool:
        return bool(self._heap)

    def pop(self) -> Node:
        """The most urgent one."""
        return self._nodes[heapq.heappop(self._heap)[1]]

    def done(self, digest: str) -> None:
        """Let those go on that waited for this one."""
        self._sorter.done(digest)
        self._let_go()

    def _let_go(self) -> None:
        for digest in self._sorter.get_ready():
            heapq.heappush(self._heap, (self._rank[digest], digest))

    def dependents(self, digest: str) -> Iterator[str]:
        """All that need this one, directly or not, each once."""
        visited, stack = set[str](), list(self._dependents.get(digest, ()))
        while stack:
            dependent = stack.pop()
            if dependent not in visited:
                visited.add(dependent)
                stack += self._dependents.get(dependent, ())
                yield dependent


def _in_order(needs: Mapping[str, Iterable[str]]) -> list[str]:
    """Keys such that each stands behind all it needs."""
    try:
        return list(TopologicalSorter(needs).static_order())
    except CycleError as error:
        raise ValueError(f"{' and '.join(sorted(set(error.args[1])))} need each other") from None
