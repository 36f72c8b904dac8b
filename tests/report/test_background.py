"""A process that helps a run: it is there where it has a core, and nothing is left of it."""

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor
from pathlib import Path

import pytest
from waiting import PATIENCE, wait_until

from pmr import InputError
from pmr.cli.run import has_free_core, helper_process
from pmr.errors import environment
from pmr.report.blocks import Block
from pmr.report.sections import chapter
from pmr.results import RunResult

KILLED = """
import multiprocessing, time
from pmr.errors import environment
from pmr.cli.run import helper_process

environment.available_cores = lambda: 2
if __name__ == "__main__":
    with helper_process() as helper:
        helper.submit(time.sleep, 600.0)
        print(multiprocessing.active_children()[0].pid, flush=True)
        time.sleep(600.0)
"""


@pytest.mark.parametrize(("cores", "launched"), [(2, 1), (1, 1), (2, 2)])
def test_another_process_helps_where_it_has_a_core_and_there_are_no_ranks(
    monkeypatch: pytest.MonkeyPatch, cores: int, launched: int
) -> None:
    monkeypatch.setattr(environment, "available_cores", lambda: cores)
    monkeypatch.setattr(environment, "launched_process_count", lambda: launched)
    assert has_free_core() == (cores == 2 and launched == 1)
    with helper_process() as helper:
        assert (helper is not None) == has_free_core()


def test_a_run_that_is_refused_does_not_wait_for_the_other_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environment, "available_cores", lambda: 2)
    with pytest.raises(InputError), helper_process() as helper:
        assert helper is not None
        helper.submit(time.sleep, 600.0)
        (process,) = multiprocessing.active_children()
        raise InputError("scene.toml", "time.end", -1.0, "more than 0 is allowed")
    wait_until(lambda: not process.is_alive())
    assert process.exitcode == -signal.SIGTERM


@pytest.mark.slow
def test_the_other_process_ends_with_one_that_is_killed(tmp_path: Path) -> None:
    (tmp_path / "run.py").write_text(KILLED)
    with subprocess.Popen([sys.executable, str(tmp_path / "run.py")], stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        helping = int(run.stdout.readline())
        os.kill(helping, signal.SIGINT)  # as a terminal sends to both
        run.kill()
        run.wait(PATIENCE)
        wait_until(lambda: not Path("/proc", str(helping)).exists())


class EndedExecutor(Executor):
    """An executor whose process was ended while it drew."""

    def submit(self, *_: object, **__: object) -> Future[list[Block | None]]:
        future = Future[list[Block | None]]()
        future.set_exception(BrokenExecutor())
        return future


@pytest.mark.usefixtures("without_figures")
def test_a_chapter_has_the_same_sections_in_order_with_help_and_where_the_helper_was_ended(
    whole: RunResult,
) -> None:
    alone = [block.heading for block in chapter(whole, "case-1").blocks]
    assert len(alone) > 3
    for helper in (ThreadPoolExecutor(1), EndedExecutor()):
        with helper:
            assert [block.heading for block in chapter(whole, "case-1", helper).blocks] == alone
