from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import study_tasks
from waiting import is_alive, wait_until

from pmr.errors import environment
from pmr.studies.engine.execute import _Memory
from pmr.studies.engine.store import Store, Stored
from pmr.studies.engine.task import TaskResult
from pmr.studies.engine.worker import Order, Worker

SLEEPER = """
import sys
from pmr.studies.engine.worker import Order
from pmr.studies.engine.worker import Worker
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
    assert [worker.run(order).status for order in (square, die, square)] == ["done", "failed", "done"]
    assert store.read("def").result.record == {"square": 9.0, "is_large": False}
    worker.close()


@pytest.mark.slow
def test_a_task_that_other_code_was_planned_by_is_refused(tmp_path: Path) -> None:
    """As where a file is edited while a study begins: no result stands under the name of the other code."""
    worker, planned = Worker(sys.path), environment.code_digest(environment.sources())
    edited = environment.code_digest({**environment.sources(), "errors/environment.py": ""})
    codes = (edited, planned)
    orders = [Order("square", code, "study_tasks:square", {"x": 3}, {}, str(tmp_path), code) for code in codes]
    assert [worker.run(order).status for order in orders] == ["failed", "done"]
    assert [Store(tmp_path).sound(code) for code in codes] == [False, True]
    worker.close()


@pytest.mark.slow
def test_a_function_that_is_not_there_fails_its_task(tmp_path: Path) -> None:
    worker = Worker(sys.path)
    answer = worker.run(Order("a", "abc", "study_tasks:nothing", {}, {}, str(tmp_path)))
    assert answer.status == "failed" and "has no attribute 'nothing'" in answer.reason
    worker.close()


def test_a_child_remembers_what_it_read_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pmr.studies.engine.execute.REMEMBERED", 2 * 8 * 4)
    store, memory = Store(tmp_path), _Memory()
    results = {}
    for digest in "abc":
        powers = study_tasks.square({"x": 2}, {}).arrays
        store.write(digest, Stored(digest, TaskResult(arrays=powers)))
        results[digest] = memory.result(store, digest)
    assert memory.result(store, "c") is results["c"] and memory.result(store, "b") is results["b"]
    assert memory.result(store, "a") is not results["a"]  # two fit
