"""A report that another process draws: the same page, and nothing is left of that process."""

from __future__ import annotations

import multiprocessing
import multiprocessing.context
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from waiting import PATIENCE, wait_until

from pmr import InputError, RunResult
from pmr.errors import environment
from pmr.report.background import BackgroundReport, has_free_core
from pmr.report.document import render_runs, with_date
from pmr.report.sections import chapter

MEASURED = {"model": {"beside": None, "reason": "not measured: this says so last"}}
KILLED = """
import multiprocessing, sys, time
from pmr.errors import InputError, environment
from pmr.report.background import BackgroundReport

environment.available_cores = lambda: 2
if __name__ == "__main__":
    with BackgroundReport() as report:
        print(multiprocessing.active_children()[0].pid, flush=True)
        time.sleep(600.0)
"""


def end_children() -> None:
    """Kill what this process started, as a system does that has no memory left, and wait until it is seen."""
    for process in multiprocessing.active_children():
        process.kill()
        process.join(PATIENCE)


@pytest.fixture
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environment, "available_cores", lambda: 2)


@pytest.mark.slow
@pytest.mark.usefixtures("two_cores")
def test_the_page_is_the_same_with_what_was_measured_last(boom: RunResult, tmp_path: Path) -> None:
    summary = dict(boom.summary)
    result = RunResult(**{**vars(boom), "summary": summary})
    with BackgroundReport() as report:
        report.draw(result)
        summary["budget"] = MEASURED
        written = report.write([result], tmp_path)
    text = render_runs([chapter(result, "case-1")], with_date("Simulation report", [summary]))
    assert "this says so last" in text
    assert written.html.read_text(encoding="utf-8") == text
    assert written.pdf.read_bytes().startswith(b"%PDF-")


@pytest.mark.parametrize(("cores", "launched"), [(2, 1), (1, 1), (2, 2)])
def test_another_process_draws_where_it_has_a_core_and_there_are_no_ranks(
    monkeypatch: pytest.MonkeyPatch, cores: int, launched: int
) -> None:
    monkeypatch.setattr(environment, "available_cores", lambda: cores)
    monkeypatch.setattr(environment, "launched_process_count", lambda: launched)
    assert has_free_core() == (cores == 2 and launched == 1)


@pytest.mark.usefixtures("undrawn")
def test_without_another_process_this_one_writes_the_report(boom: RunResult, tmp_path: Path) -> None:
    with BackgroundReport() as report:
        report.draw(boom)
        assert report.write([boom], tmp_path).html.read_text(encoding="utf-8").startswith("<!doctype html>")


@pytest.mark.parametrize("killed", ["before it draws", "before it writes"])
@pytest.mark.usefixtures("two_cores", "undrawn")
def test_where_the_other_process_is_killed_this_one_writes_the_report(
    killed: str, boom: RunResult, tmp_path: Path
) -> None:
    with BackgroundReport() as report:
        if killed == "before it draws":
            end_children()
        report.draw(boom)
        if killed == "before it writes":
            end_children()
        assert report.write([boom], tmp_path).html.read_text(encoding="utf-8").startswith("<!doctype html>")


@pytest.mark.usefixtures("two_cores")
def test_a_run_that_is_refused_does_not_wait_for_the_other_process() -> None:
    with pytest.raises(InputError), BackgroundReport():
        (process,) = multiprocessing.active_children()
        raise InputError("scene.toml", "time.end", -1.0, "more than 0 is allowed")
    wait_until(lambda: not process.is_alive())
    assert process.exitcode == -signal.SIGTERM


@pytest.mark.usefixtures("two_cores", "undrawn")
def test_where_no_process_can_be_started_this_one_writes_the_report(
    boom: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(process: object) -> None:
        raise BlockingIOError("Resource temporarily unavailable")

    monkeypatch.setattr(multiprocessing.context.SpawnProcess, "start", refuse)
    with BackgroundReport() as report:
        report.draw(boom)
        assert report.write([boom], tmp_path).html.is_file()


@pytest.mark.slow
@pytest.mark.usefixtures("two_cores")
def test_what_can_not_be_drawn_is_said_when_the_report_is_written(boom: RunResult, tmp_path: Path) -> None:
    with BackgroundReport() as report:
        report.draw(replace(boom, responses={}))
        with pytest.raises(KeyError, match="reduced"):
            report.write([boom], tmp_path)
    assert not (tmp_path / "report.html").exists()


@pytest.mark.slow
def test_the_other_process_ends_with_one_that_is_killed(tmp_path: Path) -> None:
    (tmp_path / "run.py").write_text(KILLED)
    with subprocess.Popen([sys.executable, str(tmp_path / "run.py")], stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        drawing = int(run.stdout.readline())
        os.kill(drawing, signal.SIGINT)  # as a terminal sends to both
        run.kill()
        run.wait(PATIENCE)
        wait_until(lambda: not Path("/proc", str(drawing)).exists())


REFUSED = """
import multiprocessing, numpy, os, signal, sys, time
from pmr.errors import environment
from pmr.report.background import BackgroundReport

environment.available_cores = lambda: 2
if __name__ == "__main__":
    with BackgroundReport() as report:
        (process,) = multiprocessing.active_children()
        if sys.argv[1] == "idle":
            report.draw(None)
            report._drawn[0].exception()
            os.kill(process.pid, signal.SIGSTOP)
        report.draw(numpy.zeros(1_000_000))
        if sys.argv[1] == "idle":
            time.sleep(0.5)
            process.kill()
        sys.exit(3)
"""


@pytest.mark.parametrize("state", ["loading", pytest.param("idle", marks=pytest.mark.slow)])
def test_a_run_that_fails_ends_although_its_result_is_larger_than_a_pipe_holds(state: str, tmp_path: Path) -> None:
    """The process that would draw is terminated before it has read the result, or killed while it reads."""
    (script := tmp_path / "refused.py").write_text(REFUSED)
    assert subprocess.run([sys.executable, str(script), state], check=False, timeout=PATIENCE).returncode == 3
