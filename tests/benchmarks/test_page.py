"""A short run of two sections, its page and its verdicts."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks import latency, limit, report, requirements
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


def test_a_requirement_is_met_or_missed() -> None:
    sections = {"limit": {"sizes": [{"factor": 2.9}, {"factor": 1.0}]}}
    assert [one["holds"] for one in requirements.judged(sections)] == [True]
    sections["limit"]["sizes"].append({"factor": 3.1})
    assert [(one["holds"], one["value"]) for one in requirements.judged(sections)] == [(False, 3.1)]
