import math
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from study_tasks import add, square
from waiting import is_alive, wait_until

import pmr
from pmr.errors import environment
from pmr.studies.study import Store
from pmr.studies.tasks import Plan, Task, open_tasks, task_key
from pmr.studies.workers import OTHER_CODE, Order, Worker, code_of_tasks


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
    with pytest.raises(ValueError, match="needs b, which no task before it is"):
        Plan((Task("a", add, needs={"left": "b"}), Task("b", square)))


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


def nothing_done(digest: str) -> bool:
    return False


def task(key: str, *needs: str) -> Task:
    return Task(key, add, {"key": key}, {need: need for need in needs})


def order(plan: Plan) -> list[str]:
    """Keys of the open tasks of a plan, in their order."""
    return [task.key for task in open_tasks([plan], "", nothing_done).values()]


def test_tasks_follow_what_they_need_in_the_order_of_the_plan() -> None:
    plan = Plan((task("d"), task("b", "middle"), task("c")), (task("start"), task("unneeded"), task("middle", "start")))
    assert order(plan) == ["start", "middle", "d", "b", "c"]


def test_a_long_chain_is_no_problem() -> None:
    plan = Plan(tuple(task(f"t{i}", *([f"t{i - 1}"] if i else [])) for i in range(3000)))
    assert order(plan)[-1] == "t2999"


SLEEPER = """
import sys
from pmr.studies.workers import Order
from pmr.studies.workers import Worker
Worker(sys.path).run(Order("sleep", "abc", "study_tasks:sleep", {"file": sys.argv[1]}, {}, sys.argv[2]))
"""


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
def test_a_child_does_not_outlive_its_parent(tmp_path: Path) -> None:
    file = tmp_path / "pid"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    parent = subprocess.Popen([sys.executable, "-c", SLEEPER, str(file), str(tmp_path)], env=environment)
    wait_until(lambda: file.exists() and file.read_text(), parent)
    child = int(file.read_text())
    assert is_alive(child)
    os.kill(parent.pid, signal.SIGKILL)
    parent.wait()
    wait_until(lambda: not is_alive(child))


@pytest.mark.slow
def test_a_worker_goes_on_with_another_child(tmp_path: Path) -> None:
    store = Store(tmp_path)
    worker = Worker(sys.path)
    die = Order("die", "abc", "study_tasks:die", {"how": "exit"}, {}, str(tmp_path))
    square = Order("square", "def", "study_tasks:square", {"x": 3}, {}, str(tmp_path))
    failures = [worker.run(order) for order in (square, die, square)]
    assert [failure is None for failure in failures] == [True, False, True]
    assert store.read("def").record == {"square": 9.0, "is_large": False}
    worker.close()


@pytest.mark.slow
def test_what_is_edited_while_a_study_runs_gives_no_result_under_the_name_of_the_old_code(tmp_path: Path) -> None:
    """Neither a task that begins after the edit nor one that went on during it, and imported what was edited."""
    copy, store = tmp_path / "copy", Store(tmp_path / "tasks")
    shutil.copytree(Path(pmr.__file__).parent, copy / "pmr", ignore=shutil.ignore_patterns("__pycache__"))
    edited = {"file": str(copy / "pmr" / "kernel" / "src" / "scheme.c")}
    store.prepare()
    planned, worker = code_of_tasks(), Worker([str(copy), *sys.path])
    orders = [
        Order(name, name, f"study_tasks:{name}", arguments, {}, str(store.folder), planned)
        for name, arguments in (("square", {"x": 3}), ("edit", edited), ("add", {}))
    ]
    answers = [worker.run(order) for order in orders]
    worker.close()
    assert [answer and answer.reason for answer in answers] == [None, OTHER_CODE, OTHER_CODE]
    assert [store.is_sound(order.digest) for order in orders] == [True, False, False]


@pytest.mark.parametrize(("file", "counts"), [("report/blocks.py", False), ("kernel/src/scheme.c", True)])
def test_the_code_of_tasks_is_what_computes(file: str, counts: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    code, sources = code_of_tasks(), environment.source_texts()
    monkeypatch.setattr(environment, "source_texts", lambda: {**sources, file: "edited"})
    assert file in sources and (code_of_tasks() != code) == counts


@pytest.mark.slow
def test_a_function_that_is_not_there_fails_its_task(tmp_path: Path) -> None:
    worker = Worker(sys.path)
    answer = worker.run(Order("a", "abc", "study_tasks:nothing", {}, {}, str(tmp_path)))
    assert answer is not None and "has no attribute 'nothing'" in answer.reason
    worker.close()
