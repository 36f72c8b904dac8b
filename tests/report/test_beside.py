"""A report that another process draws: the same page, and nothing of that process is left, however a run ends."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from waiting import PATIENCE

from pmr.report import beside
from pmr.report.beside import Beside, drawn_beside
from pmr.report.document import dated, page
from pmr.report.sections import chapter
from pmr.results import RunResult

MEASURED = {"model": {"beside": None, "reason": "not measured: this says so last"}}


@pytest.fixture
def apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Another process draws, though this one could."""
    monkeypatch.setattr(beside, "_saves_time", lambda: True)


@pytest.mark.slow
@pytest.mark.usefixtures("apart")
def test_the_page_is_the_same_with_what_was_measured_last(boom: RunResult, tmp_path: Path) -> None:
    summary = dict(boom.summary)
    result = RunResult(**{**vars(boom), "summary": summary})
    with drawn_beside() as report:
        report.draw(result)
        summary["budget"] = MEASURED
        written = report.write([result], tmp_path)
        assert report.process.returncode == 0
    alone = page([chapter(result, "case-1")], dated("Simulation report", [summary]))
    assert "this says so last" in alone
    assert written.html.read_text(encoding="utf-8") == alone
    assert written.pdf.read_bytes().startswith(b"%PDF-")


@pytest.mark.slow
@pytest.mark.usefixtures("apart")
def test_no_process_is_left() -> None:
    with drawn_beside() as report:
        left = report.process
        left.stdin.close()  # as the system does with whatever ends its parent
        assert left.wait(PATIENCE) == -signal.SIGKILL
    with pytest.raises(KeyboardInterrupt), drawn_beside() as report:
        left = report.process
        raise KeyboardInterrupt
    assert left.returncode == -signal.SIGKILL


@pytest.mark.usefixtures("undrawn")
def test_where_the_process_ends_this_one_writes_the_report(boom: RunResult, tmp_path: Path) -> None:
    gone = subprocess.Popen([sys.executable, "-S", "-c", "raise SystemExit(1)"], stdin=subprocess.PIPE)
    gone.wait()
    signals = list[int]()
    before = signal.signal(signal.SIGPIPE, lambda number, _: signals.append(number))
    report = Beside(gone)
    report.draw(boom)
    report.close()
    signal.signal(signal.SIGPIPE, before)
    assert not signals  # which would have ended this process: PETSc sets them as the system has them
    assert report.write([boom], tmp_path).html.read_text(encoding="utf-8").startswith("<!doctype html>")
    with drawn_beside(wanted=False) as none:
        assert none.process is None
