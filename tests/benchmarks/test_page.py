"""A short run of two sections, its page and its verdicts.
Two checkouts side by side, with runs that are made up.
Ways taken in turn, their least and median times, and the exponent of a power law.
Messages are counted exactly: a program whose messages are known, and the page of made-up records.
"""

import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from waiting import PATIENCE

from benchmarks import latency, messages, pages, report, requirements, waited_for
from benchmarks.ranks import Bounds, record_of
from benchmarks.timing import Times, exponent, side_by_side
from pmr.errors import environment


@pytest.mark.slow
def test_a_page_of_what_was_measured_needs_nothing_else(tmp_path: Path) -> None:
    sections = {"latency": latency.measure(50)}
    judged = requirements.judged(sections)
    about = {"seconds": 1.0, "load_before": 2.0, "commit": "abc", "long": False}
    results = {
        "sections": sections, "requirements": judged, "about": dict.fromkeys(sections, about),
        "machine": environment.describe_machine(), "versions": environment.package_versions(),
    }  # fmt: skip
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


def test_a_requirement_is_met_or_missed() -> None:
    sections = {"fmu": {"seconds": {"beam": {"median": 4e-6}}}}
    assert [one["holds"] for one in requirements.judged(sections)] == [True]
    sections["fmu"]["seconds"]["boom"] = {"median": 6e-6}
    assert [(one["holds"], one["value"]) for one in requirements.judged(sections)] == [(True, 4e-6), (False, 6e-6)]


def test_ways_take_turns_and_may_say_how_long_they_took() -> None:
    order: list[str] = []
    values = iter([3.0, 1.0, 2.0])

    def one() -> float:
        order.append("one")
        return next(values)

    def other() -> None:
        order.append("other")
        np.linalg.svd(np.ones((60, 60)))

    times = side_by_side({"one": one, "other": other}, repeats=3)
    assert order == ["one", "other"] * 3
    assert times["one"] == Times((3.0, 1.0, 2.0))
    assert times["one"].summary() == {"min": 1.0, "median": 2.0, "repeats": 3}
    assert times["other"].least > 0.0
    assert times["one"].times(10.0).least == 10.0


def test_the_exponent_of_a_power_law() -> None:
    size = np.array([10.0, 100.0, 1000.0])
    assert exponent(size, 3.0 * size**1.7) == pytest.approx(1.7)


KNOWN = """
import ctypes, json, sys
counting = ctypes.CDLL(sys.argv[1], ctypes.RTLD_GLOBAL).pmr_messages
import numpy as np
from mpi4py import MPI
comm, before, after = MPI.COMM_WORLD, (ctypes.c_longlong * 5)(), (ctypes.c_longlong * 5)()
other, doubles = 1 - comm.rank, np.zeros(100)
answer = np.zeros(100)
counting(before)
comm.Sendrecv(doubles, other, recvbuf=answer, source=other)  # 800 bytes
sending = comm.Send_init(doubles[:50], other)
receiving = comm.Recv_init(answer[:50], other)
for _ in range(3):  # 400 bytes each
    receiving.Start(), sending.Start(), receiving.Wait(), sending.Wait()
comm.Isend(doubles[:1], comm.rank).Free(), comm.Recv(answer[:1], comm.rank)  # to itself: none
comm.Allreduce(doubles[:3], answer[:3])  # 24 bytes
comm.Alltoallv([doubles[:5], ([2, 3] if comm.rank else [3, 2])], [answer[:5], ([2, 3] if comm.rank else [3, 2])])  # 16
kind = MPI.DOUBLE.Create_vector(4, 1, 2).Commit()
comm.Alltoallw([doubles, ([1, 1], [0, 400]), [kind, kind]], [answer, ([1, 1], [0, 400]), [kind, kind]])  # 32
MPI.COMM_SELF.Allreduce(doubles, answer)  # alone: none
counting(after)
found = comm.gather([b - a for a, b in zip(before, after)])
if comm.rank == 0:
    print(json.dumps({"found": found}))
"""


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("mpicc") is None, reason="no MPI compiler")
def test_what_is_sent_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "known.py").write_text(KNOWN)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    record = record_of("known", [str(messages.library(tmp_path))], 2, Bounds(PATIENCE))
    assert record["found"] == [[4, 800 + 3 * 400, 3, 24 + 16 + 32, 0]] * 2, json.dumps(record)
