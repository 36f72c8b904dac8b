"""A short run of two sections, its page and its verdicts."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks import latency, pages, report, requirements, waited_for
from pmr.errors import environment


@pytest.mark.slow
def test_a_page_of_what_was_measured_needs_nothing_else(tmp_path: Path) -> None:
    sections = {"latency": latency.measure(50)}
    judged = requirements.judged(sections)
    about = {"seconds": 1.0, "load_before": 2.0, "commit": "abc", "long": False}
    results = {
        "sections": sections,
        "requirements": judged,
        "about": dict.fromkeys(sections, about),
        "machine": environment.describe_machine(),
        "versions": environment.package_versions(),
    }
    page = report.write(results, tmp_path).read_text()
    for name, times in sections["latency"]["ns"].items():
        quantiles = list(times.values())
        assert quantiles == sorted(quantiles) and name in page
    assert all(one["text"] in page for one in judged)
    assert "Other work was running" in page
    assert not re.search(r'(src|href)="(?!#|data:)', page)


def test_what_is_waited_for_stands_beside_what_was_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def take(place: waited_for.Place) -> waited_for.Taken:
        return waited_for.taken_by(place.folder, {}, sys.executable, "-c", "sum(range(3_000_000))")

    def beside(place: waited_for.Place) -> waited_for.Taken:
        return replace(place.taken["sum"].less(place.taken["sum"]), memory=3.0)

    row = waited_for.Row
    rows = (row("sum", 60.0, 9.0, take), row("memory", 2.0, 4.0, beside, "libraries", kind="memory"))
    monkeypatch.setattr(waited_for, "ROWS", (*rows, row("hours", 1.0, 2.0, lambda _: pytest.fail("taken"), long=True)))
    monkeypatch.setattr(waited_for.Place, "pmr", lambda *_: None)
    found = waited_for.measure()
    assert 0.0 < found["sum"]["here"] == found["sum"]["wall"] and 0.0 < found["sum"]["processor"]
    assert [(one["text"], one["holds"]) for one in requirements.judged({"waited for": found})] == [
        ("sum", True),
        ("memory", False),
    ]
    page = pages.waited_for(found, "waited")
    assert page.headline == "1 of 2 take no more than is asked."
    figures = ("4.00\xa0B", "2.00\xa0B", "3.00\xa0B", "0\xa0s", "0\xa0s")
    assert page.blocks[0].grids[0].rows[1] == ("memory", *figures, "–", "–", "libraries")
    with pytest.raises(subprocess.CalledProcessError):
        waited_for.taken_by(tmp_path, {}, sys.executable, "-c", "raise SystemExit(2)")


def test_what_is_asked_of_a_slower_machine_is_scaled_by_an_earlier_checkout_that_runs_in_turn(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The machine takes twice the 4 s of before: 1 s that was asked is 2 s here. The least of the turns counts."""
    times = iter([2.5, 9.0, 1.5, 8.0])

    def run(place: waited_for.Place) -> waited_for.Taken:
        assert (place.interpreter == sys.executable) == (place is places[0])
        return waited_for.Taken(0.0, next(times))

    places = list[waited_for.Place]()
    monkeypatch.setattr(waited_for.Place, "pmr", lambda place, *_: places.append(place))
    monkeypatch.setattr(waited_for, "ROWS", (waited_for.Row("run", 1.0, 4.0, run, turns=2, command=True),))
    found = waited_for.measure(earlier=tmp_path)
    assert (found["run"]["here"], found["run"]["earlier"], waited_for.allowed(found["run"])) == (1.5, 8.0, 2.0)
    assert places[1].interpreter == str(tmp_path / ".venv" / "bin" / "python")
    assert [one["holds"] for one in requirements.judged({"waited for": found})] == [True]
    assert pages.waited_for(found, "waited").blocks[0].grids[0].rows[0][-2:] == ("5.33\xa0×", "holds")


def test_a_load_chart_takes_no_longer_than_is_asked() -> None:
    times = {"wall": 9.0, "processor": 14.0, "cores": 2.0}
    found = {"first": times | {"asked": 60.0}, "later": times | {"asked": 8.0}}
    assert [one["holds"] for one in requirements.judged({"chart": found})] == [True, False]
    page = pages.chart(found, "chart")
    assert page.headline == "112\xa0% of the time that is asked for, at most."
    assert page.blocks[0].grids[0].rows[1] == ("later", "9.00\xa0s", "14.0\xa0s", "8.00\xa0s")


def test_a_requirement_is_met_or_missed() -> None:
    sections = {"fmu": {"seconds": {"beam": {"median": 4e-6}}}}
    assert [one["holds"] for one in requirements.judged(sections)] == [True]
    sections["fmu"]["seconds"]["boom"] = {"median": 6e-6}
    assert [(one["holds"], one["value"]) for one in requirements.judged(sections)] == [(True, 4e-6), (False, 6e-6)]
