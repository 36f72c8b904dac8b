from __future__ import annotations

import math

import pytest
from study_tasks import add, square

from pmr.studies.tasks import Plan, Task, task_key


@pytest.mark.parametrize("key", ["", "a/b", "a b", ".hidden", "x" * 121, "ä", "a\n"])
def test_a_key_must_be_fit_for_a_file(key: str) -> None:
    with pytest.raises(ValueError, match="allowed"):
        Task(key, square)


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("my scene", "my_scene"),
        ("paper_simple", "paper_simple"),
        ("modes=4,s=-1.5e-3", "modes=4,s=-1.5e-3"),
        ("größe/2", "gr_e_2"),
        ("", "0"),
        (".hidden", "0.hidden"),
        ("ü", "0_"),
        ("x" * 120, "x" * 120),
    ],
)
def test_every_text_has_a_key(text: str, key: str) -> None:
    assert task_key(text) == key and Task(key, square).key == key


def test_long_keys_that_differ_at_their_ends_still_differ() -> None:
    one, other = (task_key(130 * "x" + end) for end in "ab")
    assert one != other and len(one) == len(other) == 120 and Task(one, square).key.startswith(110 * "x")


def test_a_task_is_a_function_of_a_module() -> None:
    assert Task("a", square).address == "study_tasks:square"
    with pytest.raises(ValueError, match="no function of a module"):
        Task("a", lambda arguments, needs: square(arguments, needs))


def test_a_plan_knows_every_key_once() -> None:
    with pytest.raises(ValueError, match="two runs are called a;"):
        Plan((Task("a", square), Task("A", square)))  # one file on some systems
    with pytest.raises(ValueError, match="needs b, which the plan lacks"):
        Plan((Task("a", add, needs={"left": "b"}),))


def test_the_digest_changes_with_what_decides_the_result_only() -> None:
    def digest(task: Task, code: str = "1", left: str = "x") -> str:
        return task.digest(code, {"left": left})

    task = Task("a", square, {"x": 1, "y": 2.0})
    assert digest(task) == digest(Task("b", square, {"y": 2.0, "x": 1}, parameters={"p": 1}, cost=5.0))
    others = [Task("a", square, {"x": 1, "y": 2.5}), Task("a", add, {"x": 1, "y": 2.0})]
    found = {digest(task), *map(digest, others), digest(task, code="2"), digest(task, left="z")}
    assert len(found) == 5


def test_arguments_that_json_lacks_are_refused() -> None:
    for value in (math.nan, {1, 2}):
        with pytest.raises((TypeError, ValueError)):
            Task("a", square, {"x": value}).digest("", {})
