"""Tasks that measure time: nothing runs beside them."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import pytest
import study_tasks

from pmr.studies.study import StudyBase
from pmr.studies.tasks import Plan, Task


class Intervals(StudyBase):
    """Four tasks beside each other, which end when two have begun, three alone, one that needs one of these."""

    kind: Literal["intervals"] = "intervals"
    title: str = "Intervals"
    meeting: Path

    def plan(self) -> Plan:
        beside = [Task(f"beside-{i}", study_tasks.interval, {"number": i, "meet": str(self.meeting)}) for i in range(4)]
        alone = [Task(f"alone-{i}", study_tasks.interval, {"number": 4 + i}, alone=True) for i in range(3)]
        return Plan((*alone, *beside, Task("after", study_tasks.interval, needs={"one": "alone-0"})))


@pytest.mark.slow
def test_what_measures_time_runs_alone_and_after_the_others(tmp_path: Path) -> None:
    meeting = tmp_path / "meeting"
    meeting.mkdir()
    results = study_tasks.run(tmp_path, Intervals(meeting=meeting)).results[""]
    assert results.is_complete
    spans = {run.key: results.arrays(run.key)["interval"] for run in results.runs}

    def overlap(a: str, b: str) -> bool:
        return bool(spans[a][0] < spans[b][1] and spans[b][0] < spans[a][1])

    alone = [key for key in spans if key.startswith("alone")]
    assert not any(overlap(a, b) for a in alone for b in spans if a != b)
    beside = [key for key in spans if key.startswith("beside")]
    assert any(overlap(a, b) for a in beside for b in beside if a != b)
    assert max(spans[key][1] for key in beside) <= min(spans[key][0] for key in alone)
    assert spans["after"][0] >= spans["alone-0"][1]
