from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import study_tasks
from waiting import is_alive, wait_until

import pmr
from pmr.errors import environment
from pmr.studies.engine.execute import OTHER_CODE, _Memory
from pmr.studies.engine.store import Store, Stored
from pmr.studies.engine.task import TaskResult
from pmr.studies.engine.worker import Order, Worker, code_of_tasks

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
    assert [answer.reason for answer in answers] == ["", OTHER_CODE, OTHER_CODE]
    assert [store.sound(order.digest) for order in orders] == [True, False, False]


@pytest.mark.parametrize(("file", "counts"), [("report/blocks.py", False), ("kernel/src/scheme.c", True)])
def test_the_code_of_tasks_is_what_computes(file: str, counts: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    code, sources = code_of_tasks(), environment.sources()
    monkeypatch.setattr(environment, "sources", lambda: {**sources, file: "edited"})
    assert file in sources and (code_of_tasks() != code) == counts


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
