"""A short run of two sections, its page and its verdicts."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks import latency, limit, pages, report, requirements, waited_for
from pmr.errors import environment


@pytest.mark.slow
def test_a_page_of_what_was_measured_needs_nothing_else(tmp_path: Path) -> None:
    sections = {"latency": latency.measure(500, python_calls=50), "limit": limit.measure((6, 20), repeats=3)}
    judged = requirements.judged(sections)
    about = {"seconds": 1.0, "load_before": 2.0, "commit": "abc", "long": False}
    results = {
        "sections": sections,
        "requirements": judged,
        "about": dict.fromkeys(sections, about),
        "machine": environment.machine(),
        "versions": environment.versions(),
    }
    page = report.write(results, tmp_path).read_text()
    for name, times in sections["latency"]["ns"].items():
        quantiles = list(times["compiled"].values())
        assert quantiles == sorted(quantiles) and name in page
    assert [size["r"] for size in sections["limit"]["sizes"]] == [6, 20]
    assert all(one["text"] in page for one in judged)
    assert "Other work was running" in page
    assert not re.search(r'(src|href)="(?!#|data:)', page)


def test_what_is_waited_for_stands_beside_what_was_asked(tmp_path: Path) -> None:
    found = {"pmr --help": {"seconds": 0.2, "asked": 0.3}, "pmr info": {"seconds": 0.9, "asked": 0.8}}
    assert [one["holds"] for one in requirements.judged({"waited for": found})] == [True, False]
    assert pages.waited_for(found, "waited").headline == "1 of 2 commands take no more than is asked."
    assert waited_for.seconds_of(tmp_path, {}, sys.executable, "-c", "sum(range(3_000_000))") > 0.0
    with pytest.raises(subprocess.CalledProcessError):
        waited_for.seconds_of(tmp_path, {}, sys.executable, "-c", "raise SystemExit(2)")


def test_a_load_chart_takes_no_longer_than_is_asked() -> None:
    times = {"wall": 9.0, "processor": 14.0, "cores": 2.0}
    found = {"first": times | {"asked": 60.0}, "later": times | {"asked": 8.0}}
    assert [one["holds"] for one in requirements.judged({"chart": found})] == [True, False]
    page = pages.chart(found, "chart")
    assert page.headline == "112\xa0% of the time that is asked for, at most."
    assert page.blocks[0].grids[0].rows[1] == ("later", "9.00\xa0s", "14.0\xa0s", "8.00\xa0s")


def test_a_requirement_is_met_or_missed() -> None:
    sections = {"limit": {"sizes": [{"factor": 2.9}, {"factor": 1.0}]}}
    assert [one["holds"] for one in requirements.judged(sections)] == [True]
    sections["limit"]["sizes"].append({"factor": 3.1})
    assert [(one["holds"], one["value"]) for one in requirements.judged(sections)] == [(False, 3.1)]
