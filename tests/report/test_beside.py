"""A report that another process draws: the same page."""

from __future__ import annotations

from pathlib import Path

import pytest

from pmr.errors.aside import Aside
from pmr.report.beside import Beside
from pmr.report.document import dated, page
from pmr.report.sections import chapter
from pmr.results import RunResult

MEASURED = {"model": {"beside": None, "reason": "not measured: this says so last"}}


@pytest.mark.slow
def test_the_page_is_the_same_with_what_was_measured_last(boom: RunResult, tmp_path: Path) -> None:
    summary = dict(boom.summary)
    result, aside = RunResult(**{**vars(boom), "summary": summary}), Aside.started()
    report = Beside(aside)
    report.draw(result)
    summary["budget"] = MEASURED
    written = report.write([result], tmp_path)
    assert [well for well, _ in aside.answers] == [True] * 3
    aside.close()
    alone = page([chapter(result, "case-1")], dated("Simulation report", [summary]))
    assert "this says so last" in alone
    assert written.html.read_text(encoding="utf-8") == alone
    assert written.pdf.read_bytes().startswith(b"%PDF-")


@pytest.mark.usefixtures("undrawn")
def test_where_there_is_no_such_process_this_one_writes_the_report(boom: RunResult, tmp_path: Path) -> None:
    report = Beside(Aside())
    report.draw(boom)
    assert report.write([boom], tmp_path).html.read_text(encoding="utf-8").startswith("<!doctype html>")
