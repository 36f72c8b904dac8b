from __future__ import annotations

import pytest
from study_tasks import add, square

from pmr.studies.tasks import Plan, ReadyQueue, Task, digests, open_nodes


def nothing_done(digest: str) -> bool:
    return False


def task(key: str, *needs: str, cost: float = 1.0) -> Task:
    return Task(key, add, {"key": key}, {need: need for need in needs}, cost=cost)


def order(plan: Plan) -> list[str]:
    """Keys in the order in which one worker would take them."""
    ready, keys = ReadyQueue(open_nodes([plan], "", nothing_done)), []
    while ready:
        node = ready.pop()
        keys.append(node.task.key)
        ready.mark_done(node.digest)
    return keys


def test_the_start_of_the_longest_chain_goes_first() -> None:
    plan = Plan((task("short", cost=4.5), task("end", "middle", cost=3.0)), (task("middle", "start"), task("start")))
    assert order(plan) == ["start", "short", "middle", "end"]


def test_equally_urgent_tasks_keep_the_order_of_the_plan() -> None:
    plan = Plan(tuple(task(key) for key in "dbca"))
    assert order(plan) == list("dbca")


def test_a_task_waits_for_all_it_needs() -> None:
    plan = Plan((task("sum", "a", "b", cost=9.0), task("last")), (task("a"), task("b")))
    ready = ReadyQueue(open_nodes([plan], "", nothing_done))
    a, b = ready.pop(), ready.pop()
    ready.mark_done(a.digest)
    assert (a.task.key, b.task.key, ready.pop().task.key, bool(ready)) == ("a", "b", "last", False)
    ready.mark_done(b.digest)
    assert ready.pop().task.key == "sum"


def test_what_is_done_needs_nothing_any_more() -> None:
    plan = Plan((task("one", "a"), task("two", "a", "b")), (task("a"), task("b")))
    digest = digests(plan, "")
    done = {digest["one"], digest["b"]}
    nodes = open_nodes([plan], "", done.__contains__)
    assert [node.task.key for node in nodes.values()] == ["a", "two"]
    assert nodes[digest["two"]].needs == {"a": digest["a"], "b": digest["b"]}


def test_equal_tasks_of_two_plans_are_one() -> None:
    plans = [Plan((Task(key, add, {}, {"of": f"{key}x"}),), (Task(f"{key}x", square, {"x": 2}),)) for key in "ab"]
    assert len(open_nodes(plans, "", nothing_done)) == 2


def test_a_circle_is_refused() -> None:
    with pytest.raises(ValueError, match="need one another's results"):
        digests(Plan((task("a", "b"), task("b", "a"))), "")


def test_a_long_chain_is_no_problem() -> None:
    plan = Plan(tuple(task(f"t{i}", *([f"t{i - 1}"] if i else [])) for i in range(3000)))
    assert order(plan)[-1] == "t2999"
