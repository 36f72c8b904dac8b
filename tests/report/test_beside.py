"""A report that another process draws: the same page, and nothing of that process is left, however a run ends."""

from __future__ import annotations

import os
import signal
from multiprocessing import get_context
from multiprocessing.connection import Pipe
from pathlib import Path
from types import SimpleNamespace

import pytest
from waiting import PATIENCE

from pmr.errors import environment
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
        assert report.process.exitcode == 0
    alone = page([chapter(result, "case-1")], dated("Simulation report", [summary]))
    assert "this says so last" in alone
    assert written.html.read_text(encoding="utf-8") == alone
    assert written.pdf.read_bytes().startswith(b"%PDF-")


@pytest.mark.usefixtures("apart")
def test_no_process_is_left() -> None:
    with drawn_beside() as report:
        left = report.process
        report.there.close()  # as the system does with whatever ends its parent
        left.join(PATIENCE)
        assert left.exitcode == -signal.SIGKILL
    with pytest.raises(KeyboardInterrupt), drawn_beside() as report:
        left = report.process
        raise KeyboardInterrupt
    assert left.exitcode == -signal.SIGKILL


@pytest.mark.usefixtures("undrawn")
def test_where_the_process_ends_this_one_writes_the_report(boom: RunResult, tmp_path: Path) -> None:
    gone = get_context("fork").Process(target=os._exit, args=(1,))
    heard, there = Pipe(duplex=False)
    gone.start()
    gone.join(PATIENCE)
    heard.close()
    signals = list[int]()
    before = signal.signal(signal.SIGPIPE, lambda number, _: signals.append(number))
    report = Beside(gone, there)
    report.draw(boom)
    report.close()
    signal.signal(signal.SIGPIPE, before)
    assert not signals  # which would have ended this process: PETSc sets them as the system has them
    assert report.write([boom], tmp_path).html.read_text(encoding="utf-8").startswith("<!doctype html>")
    with drawn_beside(wanted=False) as none:
        assert none.process is None


@pytest.mark.parametrize("loaded", ["", *beside.TOO_LATE])
@pytest.mark.parametrize(("launched", "cores", "threads"), [(1, 2, 1), (2, 2, 1), (1, 1, 1), (1, 2, 2)])
def test_a_process_is_copied_only_where_it_is_alone(
    monkeypatch: pytest.MonkeyPatch, loaded: str, launched: int, cores: int, threads: int
) -> None:
    monkeypatch.setattr(environment, "launched", lambda: launched)
    monkeypatch.setattr(environment, "cores", lambda: cores)
    monkeypatch.setattr(beside.threading, "active_count", lambda: threads)
    monkeypatch.setattr(beside, "sys", SimpleNamespace(platform="linux", modules={loaded: beside}))
    assert beside._saves_time() == ((loaded, launched, cores, threads) == ("", 1, 2, 1))
