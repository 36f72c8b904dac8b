"""Two checkouts side by side, with runs that are made up."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks import before_after
from benchmarks.ranks import HERE, Bounds
from benchmarks.scale import STAGES


def test_both_are_run_in_turn_and_compared(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    runs = []

    def made_up(module: str, arguments: list[str], ranks: int, bounds: Bounds, checkout: Path) -> dict[str, Any]:
        assert module == "benchmarks.scale_run" and 0.0 < bounds.seconds <= 720.0
        runs.append((float(arguments[0]), ranks, checkout))
        if arguments[0] == "0.3":
            return {"notes": ["failed: too coarse"]}
        seconds = (9.0 if checkout == HERE else 21.0) / ranks
        stages = dict.fromkeys(STAGES, 1.0) | {"total": seconds}
        memory = {"peak_MB": [300.0] * ranks, "loaded_MB": [200.0] * ranks}
        return {"size": 1000, "ranks": ranks, "seconds": stages, "processor": 1.0} | memory

    monkeypatch.setattr(before_after, "record_of", made_up)
    monkeypatch.setattr(before_after, "difference", lambda one, other: {"rows": 1e-11})
    monkeypatch.setattr(sys, "argv", ["", str(tmp_path), "--sizes", "0.1", "--alone", "0.3"])
    assert before_after.main() == 0
    pairs = [(0.1, ranks, folder) for ranks in (1, 2) for folder in (tmp_path, HERE)]
    assert runs == 2 * [*pairs, (0.3, 1, HERE), (0.3, 2, HERE)]
    said = capsys.readouterr().out
    assert "0.1 m, 1 rank(s): 21.00 -> 9.00 s, 2.33 times; apart: rows 1.0e-11" in said
    assert "0.1 m: two ranks are 2.00 times as fast as one" in said
    assert "0.3 m, 2 ranks, now: failed: too coarse" in said and "0.3 m: two" not in said
